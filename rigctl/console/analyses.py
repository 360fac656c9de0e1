"""What is worked out from a store: asked of the analyst, shown on the screens once it is found."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import Severity
from rigctl.console.screens.panes import Panes
from rigctl.console.store_view import StoreView
from rigctl.core.errors import RigError
from rigctl.report.quantities import duration

if TYPE_CHECKING:
    from rigctl.console.analyst import Analyst


LIVE_S = 1.0
"""Least time between two null searches that are worked out while a campaign runs."""

Start = Callable[[str, Coroutine[Any, Any, None]], object]
"""Runs a coroutine beside the event loop's other work; one of a group follows the other or replaces it."""


class Analyses:
    """Asks for one thing after the other; whatever fails is one line to the operator."""

    def __init__(
        self, panes: Panes, plugins: Sequence[Path], start: Start, tell: Callable[[str, Severity], None]
    ) -> None:
        self._panes = panes
        self._plugins = plugins
        self._start = start
        self._tell = tell
        self._searched: tuple[object, ...] = ()
        self._searched_s = 0.0
        # One search at a time: asked after every run, they would queue up behind a slow one.
        self._searching = False

    def close(self) -> None:
        """End what is still being worked out."""
        if "_analyst" in vars(self):
            self._analyst.close()

    @cached_property
    def _analyst(self) -> Analyst:
        from rigctl.console.analyst import Analyst  # pools of processes are imported after the first paint

        return Analyst(self._plugins)

    def ask(self, store: Path, what: str, *arguments: Any, quiet: bool = False) -> None:
        """A function of `rigctl.console.analysis`; `quiet` ones nobody has asked for, and none is told of failing."""
        self._start("analysis", self._work_out(store, what, arguments, quiet))

    def dry_run(self, campaign: Path) -> None:
        """What a campaign file would do."""
        self._start("dry-run", self._try_out(campaign))

    def follow(self, view: StoreView) -> None:
        """While a campaign runs, and its screen is looked at, the response is worked out anew after every run."""
        if not view.runs:
            return
        signs = (view.path, len(view.runs))
        if signs == self._searched or self._searching or time.monotonic() - self._searched_s < LIVE_S:
            return
        # Noted before it is asked: a run that ends meanwhile is a reason to ask again.
        self._searched, self._searched_s = signs, time.monotonic()
        self._searching = True
        self._start("null-search", self._search(view.path))

    async def _search(self, store: Path) -> None:
        try:
            self._panes.campaign.show_null_search(await self._analyst.ask("null_search", store, live=True))
        except Exception:  # noqa: BLE001 - too few runs, or a model of one's own: the picture waits
            return
        finally:
            self._searching = False

    async def _try_out(self, campaign: Path) -> None:
        pane = self._panes.campaign
        pane.show_plan("… checking")
        try:
            pane.show_plan(plan_in_words(await self._analyst.ask("dry_run", campaign)))
        except Exception as error:  # noqa: BLE001 - told to the operator
            pane.show_plan(f"✗ {in_one_line(error)}")

    async def _work_out(self, store: Path, what: str, arguments: Sequence[Any], quiet: bool) -> None:
        if not quiet:
            self._panes.workbench.show_busy(f"{what.replace('_', ' ')} of {store.name} …")
        try:
            await self._show(store, what, await self._analyst.ask(what, store, *arguments))
        except Exception as error:  # noqa: BLE001 - told to the operator
            if not quiet:
                self._tell(in_one_line(error), "error")
        finally:
            # Whatever was asked may have changed the model, and its line shows "…" until it is told anew.
            if not quiet and what != "model":
                self.ask(store, "model", quiet=True)

    async def _show(self, store: Path, what: str, answer: Any) -> None:
        bench, results = self._panes.workbench, self._panes.results
        if not bench.is_running:  # on the way out
            return
        shows: Mapping[str, Callable[[Any], Awaitable[None] | None]] = {
            "result": lambda tables_and_pictures: results.show_result(*tables_and_pictures),
            "compare_with": results.show_comparison,
            "model": bench.show_model,
            "fit": bench.show_fit,
            "diagnose": bench.show_diagnosis,
            "recommend": bench.show_next,
            "history": bench.show_history,
            "residuals": bench.show_residuals,
            "add": self._tell_version,
            "remove": self._tell_version,
        }
        if (pending := shows[what](answer)) is not None:
            await pending
        if what in {"add", "remove"}:
            self.ask(store, "fit")
        if what == "fit":
            self.ask(store, "history", quiet=True)
            self.ask(store, "residuals", bench.covariate, quiet=True)

    def _tell_version(self, made: Sequence[Mapping[str, Any]]) -> None:
        version = made[-1]
        text = f"model version {version['version']}: {' + '.join(['baseline', *version['effects']])}"
        self._tell(text, "information")


def in_one_line(error: BaseException) -> str:
    """What the operator is told of a failure."""
    if isinstance(error, RigError):
        return str(error)
    return f"internal error: {type(error).__name__}: {' '.join(str(error).split())}"


def plan_in_words(plan: Mapping[str, Any]) -> str:
    """A dry run in words: what is known of every plan, then what its experiment says beyond."""
    mountings = list(plan.get("mountings", ()))
    seated = f" in {len(mountings)} mounting{'s' if len(mountings) > 1 else ''}" if mountings else ""
    lines = [f"{plan['experiment']}, {plan['procedure']}: {plan['runs_planned']} runs{seated}"]
    if mountings:
        shown = ", ".join(mountings[:6]) + (f", … {mountings[-1]}" if len(mountings) > 6 else "")
        lines.append(f"mountings   {shown}")
    lines.append(f"model       baseline{''.join(f' + {effect}' for effect in plan['effects'])}")
    if plan.get("theta0_sigma_arcsec") is not None:
        lines.append(f"accuracy    sigma(theta0) {plan['theta0_sigma_arcsec']:.3g} arcsec in each mounting")
    elif "theta0_sigma_arcsec" in plan:
        lines.append("accuracy    these runs do not determine theta0")
    if "rig_time_s" in plan:
        lines.append(
            f"rig time    {duration(plan['rig_time_s'])} in a room as noisy as allowed; mounting not counted"
        )
    known = {"experiment", "procedure", "mountings", "runs_planned", "effects", "theta0_sigma_arcsec", "rig_time_s"}
    for key, value in plan.items():
        if key not in known:
            several = "\n            ".join(map(str, value)) if isinstance(value, list) else value
            lines.append(f"{key:11} {several}")
    return "\n".join([*lines, "", "Checked against the rig's limits: everything can be reached. Nothing was moved."])
