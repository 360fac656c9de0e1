"""Pages under a line of names, while others take their place."""

from __future__ import annotations

import asyncio

import pytest
from textual.app import App, ComposeResult
from textual.widgets import Static

from rigctl.console.widgets.pages import Page, Pages


class Screen(App[None]):
    def compose(self) -> ComposeResult:
        yield Pages(Page("Result", Static("none yet"), id="tab-result"), Page("Compare", id="tab-compare"), id="tabs")


def test_a_key_finds_an_active_page_while_pages_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    async def sitting() -> None:
        async with Screen().run_test() as pilot:
            pages = pilot.app.query_one(Pages)
            mounting = type(pages).mount_all

            def pressed_meanwhile(self: Pages, *arguments: object, **named: object) -> object:
                pages.rest()
                pages.step(1)
                assert pages.active == "tab-scatter"
                return mounting(self, *arguments, **named)  # type: ignore[arg-type]

            monkeypatch.setattr(Pages, "mount_all", pressed_meanwhile)
            axes, scatter = Page("Axes", id="tab-axes"), Page("Scatter", id="tab-scatter")
            await pages.replace([axes, scatter], kept=("tab-compare",))
            assert (axes.display, scatter.display, pages.active) == (False, True, "tab-scatter")

    asyncio.run(sitting())
