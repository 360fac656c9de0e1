"""What is worked out from a store: asked of the analyst, shown on the screens once it is found."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import FileWritten, Severity
from rigctl.console.store_view import StoreView
from rigctl.core.errors import RigError
from rigctl.report.quantities import duration

if TYPE_CHECKING:
    from rigctl.analysis.run_misfit import RunMisfit
    from rigctl.console.analyst import Analyst
    from rigctl.console.screens.panes import Panes
    from rigctl.report.shown import Watch


@dataclass
class Job:
    """Something that was asked and is not there yet."""

    what: str
    store: Path
    since_s: float
    quiet: bool
    cancelled: bool = False

    def __str__(self) -> str:
        return f"{self.what.replace('_', ' ')} of {self.store.name}, {time.monotonic() - self.since_s:.0f} s"


@dataclass(frozen=True)
class Undoable:
    """A change of a store that was made here: in words, and what has to be asked to take it back."""

    told: str
    store: Path
    what: str
    arguments: tuple[Any, ...]


LIVE_S = 1.0
"""Least time between two looks at what runs tell while they come."""

LIVE_SHARE = 0.1
"""Of a core's time, what these looks take at most."""

OPPOSITE = {"add": "remove", "remove": "add"}

REFITTED = {"add", "remove", "mark"}
"""After these the model is fitted anew, and the ladder shows the difference."""

Start = Callable[[str, Coroutine[Any, Any, None]], object]
"""Runs a coroutine beside the event loop's other work; one of a group follows the other or replaces it."""


class Analyses:
    """Asks for one thing after the other; whatever fails is one line to the operator."""

    def __init__(
        self, panes: Panes, plugins: Sequence[Path], start: Start, tell: Callable[[str, Severity], None]
    ) -> None:
        self._panes = panes
        self.plugins = list(plugins)
        self._start = start
        self._tell = tell
        self._watched: tuple[object, ...] = ()
        self._watch_again_s = 0.0
        # One look at a time: asked after every run, they would queue up behind a slow one.
        self._watching = False
        self._far: tuple[Path, Sequence[RunMisfit]] | None = None
        self._jobs: list[Job] = []
        self._undoable: list[Undoable] = []

    def jobs(self) -> list[str]:
        """What somebody waits for, in words; k cancels it."""
        told = [str(job) for job in self._jobs if not job.quiet]
        return [*told[:-1], f"{told[-1]}  (k cancels)"] if told else []

    def cancel(self) -> bool:
        """Give up all that is being worked out; False when nothing is."""
        waited_for = [job for job in self._jobs if not job.quiet]
        for job in waited_for:
            job.cancelled = True
        if waited_for:
            self._analyst.cancel()
        return bool(waited_for)

    def undo(self, store: Path) -> str:
        """Take back the last change that was made here to what a store keeps; says what, "" when there is none."""
        change = next((each for each in reversed(self._undoable) if each.store == store), None)
        if change is None:
            return ""
        self._undoable.remove(change)
        self.ask(store, change.what, *change.arguments, undoes=change)
        return change.told

    def close(self) -> None:
        """End what is still being worked out."""
        if "_analyst" in vars(self):
            self._analyst.close()

    @cached_property
    def _analyst(self) -> Analyst:
        from rigctl.console.analyst import Analyst  # pools of processes are imported after the first paint

        return Analyst(self.plugins)

    def ask(
        self, store: Path, what: str, *arguments: Any, quiet: bool = False, undoes: Undoable | None = None
    ) -> None:
        """A function of `rigctl.console.analysis`; `quiet` ones nobody has asked for, and none is told of failing.

        What changes the store can be undone, unless it undoes something itself.
        """
        job = Job(what, store, time.monotonic(), quiet)
        # Before it begins: what was asked is to be seen at once.
        self._jobs.append(job)
        self._start("analysis", self._work_out(job, arguments, undoes))

    def dry_run(self, campaign: Path) -> None:
        """What a campaign file would do."""
        job = Job("dry_run", campaign, time.monotonic(), quiet=False)
        self._jobs.append(job)
        self._start("dry-run", self._try_out(job))

    def load(self, plugin: Path, store: Path | None) -> None:
        """Have the effects of a file in the catalogue from now on, if it can be loaded; again when it was changed."""
        job = Job("effects", plugin, time.monotonic(), quiet=False)
        self._jobs.append(job)
        self._start("analysis", self._load(job, store))

    def follow(self, view: StoreView) -> None:
        """What runs tell is worked out anew when there are others, as often as it does not keep a core busy."""
        if not view.status.get("runs_done"):
            return
        valid = sum(run.valid for run in view.runs)
        signs = (view.path, view.status["runs_done"], valid, view.alive)
        # Of a campaign that has ended this is the last look: nothing comes that would make up for it later.
        soon = view.alive and time.monotonic() < self._watch_again_s
        if signs == self._watched or self._watching or soon:
            return
        # Noted before it is asked: a run that ends meanwhile is a reason to ask again.
        self._watched, self._watching = signs, True
        self._start("watch", self._watch(view.path))

    def far(self, store: Path) -> Sequence[RunMisfit]:
        """The runs of a store that are far from its model, as last worked out."""
        return self._far[1] if self._far is not None and self._far[0] == store else ()

    async def _watch(self, store: Path) -> None:
        begun_s = time.monotonic()
        try:
            found: Watch = await self._analyst.ask("watched", store, live=True)
        except Exception:  # noqa: BLE001 - a model of one's own, or a store that is gone: the pictures wait
            return
        else:
            self._far = store, found.far
            self._panes.campaign.show_pictures(found.pictures)
        finally:
            took_s = time.monotonic() - begun_s
            self._watch_again_s = time.monotonic() + max(LIVE_S, took_s / LIVE_SHARE - took_s)
            self._watching = False

    async def _load(self, job: Job, store: Path | None) -> None:
        try:
            effects: Sequence[str] = await self._analyst.ask("effects", job.store)
        except Exception as error:  # noqa: BLE001 - told to the operator
            self._tell(f"cancelled: {job}" if job.cancelled else in_one_line(error), "error")
            return
        finally:
            self._jobs.remove(job)
        if job.store not in self.plugins:
            self.plugins.append(job.store)
        self._tell(f"{job.store}: {', '.join(effects)} can be added", "information")
        if store is not None:
            self.ask(store, "model", quiet=True)

    async def _try_out(self, job: Job) -> None:
        pane = self._panes.campaign
        pane.show_plan("… checking")
        try:
            pane.show_plan(plan_in_words(await self._analyst.ask("dry_run", job.store)))
        except Exception as error:  # noqa: BLE001 - told to the operator
            pane.show_plan("cancelled" if job.cancelled else f"✗ {in_one_line(error)}")
        finally:
            self._jobs.remove(job)

    async def _work_out(self, job: Job, arguments: Sequence[Any], undoes: Undoable | None) -> None:
        try:
            answer = await self._analyst.ask(job.what, job.store, *arguments)
            if undoes is None:
                self._note_undoable(job, arguments, answer)
            undoes = None
            await self._show(job, answer)
        except Exception as error:  # noqa: BLE001 - told to the operator
            if job.cancelled:
                self._tell(f"cancelled: {job}", "warning")
            elif not job.quiet:
                self._tell(in_one_line(error), "error")
        finally:
            self._jobs.remove(job)
            if undoes is not None:  # it was not taken back: it still can be
                self._undoable.append(undoes)

    def _note_undoable(self, job: Job, arguments: Sequence[Any], answer: Any) -> None:
        if job.what in OPPOSITE:
            told = f"{job.what} {', '.join(arguments[0])}"
            self._undoable.append(Undoable(told, job.store, OPPOSITE[job.what], tuple(arguments)))
        if job.what == "mark":
            told, before = f"mark of run {answer['run_id']}", answer["before"]
            # A run that was left out is left out again for its own reason.
            marked = answer["run_id"], before["valid"], before["reason"] or f"{told} taken back"
            self._undoable.append(Undoable(told, job.store, "mark", marked))

    async def _show(self, job: Job, answer: Any) -> None:
        store, what = job.store, job.what
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
            "run": bench.show_run,
            "add": self._tell_version,
            "remove": self._tell_version,
            "mark": self._tell_mark,
            "write": self._tell_written,
        }
        if (pending := shows[what](answer)) is not None:
            await pending
        if what in OPPOSITE:
            self.ask(store, "model", quiet=True)
        if what == "mark" and answer["run_id"] == bench.run_id:
            self.ask(store, "run", bench.run_id, quiet=True)
        if what in REFITTED:
            self._watched = ()
            self.ask(store, "fit")
        if what == "fit":
            self.ask(store, "history", quiet=True)
            self.ask(store, "residuals", bench.covariate, 0, quiet=True)

    def _tell_written(self, made: Mapping[str, Any]) -> None:
        self._panes.workbench.post_message(FileWritten(made["kind"], Path(made["written"])))

    def _tell_mark(self, made: Mapping[str, Any]) -> None:
        state = "valid" if made["valid"] else "invalid"
        self._tell(f"run {made['run_id']} is {state}: {made['reason']}", "information")

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
