"""Pictures of the console's screens, from the store of the shipped one-axis campaign.

Those of docs/console.md by `make console-pictures`; all sizes and themes, to be looked at, by `make console-looks`.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
from pathlib import Path

from rigctl.console.app import Console
from rigctl.console.themes import THEMES
from tests.console.conftest import Seat

PICTURES = Path(__file__).parents[2] / "docs" / "img"


async def draw(store: Path, out: Path, size: tuple[int, int], theme: str, state: Path) -> None:
    """Rig, campaign, results and workbench, as one who goes through the screens sees them; `state` keeps what it
    keeps, not the user's own directory."""
    app = Console(store, directory=state)
    async with app.run_test(size=size) as pilot:
        app.theme = theme
        seat = Seat(app, pilot)

        async def picture(name: str, *words: str) -> None:
            for word in words:
                await seat.sees(word, 120.0)
            await pilot.pause(0.5)
            (out / f"console-{name}.svg").write_text(app.export_screenshot(title=f"rigctl console {store.name}"))

        await seat.until(lambda: app._view)
        await seat.press("1")
        await picture("rig", "recorded", "required")
        await seat.press("2")
        await picture("campaign", "DONE", "θ − θ0")
        await seat.press("3")
        await picture("results", "Sensing axes")
        await seat.press("4", "f")
        await picture("workbench", "theta0[", "model version 1")
        await seat.press("full_stop")
        await seat.sees("residuals / σ, version", 120.0)
        await seat.press("pageup")
        await picture("residuals", "residuals / σ")
        await seat.press("enter")
        # The first of its plots: 80 x 24 shows no more without scrolling.
        await picture("run", "stage_x_mm / mm")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("--out", type=Path, default=PICTURES)
    parser.add_argument("--size", default="120x40", metavar="COLUMNSxLINES")
    parser.add_argument("--theme", default=next(iter(THEMES)), choices=list(THEMES))
    given = parser.parse_args()
    columns, lines = map(int, given.size.split("x"))
    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as state:
        asyncio.run(draw(given.store, given.out, (columns, lines), given.theme, Path(state)))


if __name__ == "__main__":
    main()
