"""Screen 4: where the model fails, which effect is missing, and what adding it brought."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from rich.console import Group, RenderableType
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import DataTable, Static

from rigctl.console.marking import ask_why
from rigctl.console.messages import AnalysisAsked, Noted, RunAsked, WriteAsked
from rigctl.console.widgets.dialogs import PickDialog
from rigctl.console.widgets.pages import Page, Pages
from rigctl.console.widgets.plot import Plot
from rigctl.console.writing import KINDS, OF_THE_WORKBENCH
from rigctl.report.picture import MARKS, Line, Picture
from rigctl.report.quantities import number, probability

if TYPE_CHECKING:
    from rigctl.core.arrays import FloatArray
    from rigctl.report.shown import RecordedRun

Document = Mapping[str, Any]
MAX_SERIES = len(MARKS)
UNKNOWN_MODEL = "the model is not known: it is still being read, or no store is open (o)"
TOGETHER = " + "
"""Between effects that are added as one version."""


class WorkbenchPane(Vertical):
    """Model, residuals, ranking and ladder of the store that is open."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "ask('fit')", "Fit"),
        Binding("g", "ask('diagnose')", "Diagnose"),
        Binding("a", "add", "Add"),
        Binding("x", "remove", "Remove"),
        Binding("n", "ask('recommend')", "Next"),
        # The page of the residuals tells of it.
        Binding("v", "covariate", "Covariate", show=False),
        Binding("m", "mark", "Mark", show=False),
        Binding("w", "write", "Write"),
    ]

    def __init__(self, covariate: str) -> None:
        super().__init__(id="workbench")
        self.covariate = covariate
        self._effects: list[str] = []
        self._catalogue: dict[str, str] = {}
        self._covariates: list[str] = []
        self._suggested: list[str] = []
        self._ranked: list[Document] = []
        self._version = 0
        self._run: RecordedRun | None = None
        self._one_run = asyncio.Lock()

    def compose(self) -> ComposeResult:
        """A line that says where one stands, and five pages."""
        yield Static("", id="model-line")
        yield Pages(
            Page(
                "Model",
                VerticalScroll(Static("f fits the current model of the store that is open.", id="fit")),
                id="tab-model",
            ),
            Page(
                "Residuals",
                Static("v picks what the residuals are shown against.", id="residual-line"),
                Plot(Picture("residuals / σ"), id="residuals"),
                id="tab-residuals",
            ),
            Page(
                "Ranking",
                Static("g diagnoses: which physical effect is missing?", id="verdict"),
                DataTable(id="ranking", cursor_type="row"),
                Static("", id="rank-detail"),
                id="tab-ranking",
            ),
            Page(
                "Ladder",
                Static("", id="ladder"),
                Plot(Picture("error, 1.00 = noise"), id="ladder-plot"),
                id="tab-ladder",
            ),
            Page(
                "Run",
                Static(
                    "Enter on a point of a plot, or on a run among a campaign's steps, shows the run.", id="run-line"
                ),
                VerticalScroll(id="run-plots"),
                id="tab-run",
            ),
            Page("Next", VerticalScroll(Static("n asks what to measure next.", id="next")), id="tab-next"),
            id="workbench-tabs",
        )

    @property
    def run_id(self) -> str:
        """Of the run that is shown; "" while none is."""
        return "" if self._run is None else self._run.run_id

    def rest(self) -> Widget:
        """Where the focus is while nothing else is asked for."""
        return self.query_one(Pages).rest()

    # What is shown

    def show_model(self, model: Document) -> None:
        """`rigctl model show`."""
        self._effects = list(model["effects"])
        self._catalogue = dict(model["catalogue"])
        self._tell(f"model version {model['version']}: {' + '.join(['baseline', *self._effects])}")

    def show_fit(self, fit: Document) -> None:
        """`rigctl fit`."""
        # What writes tables and sentences is imported with the first of them: the first paint needs none.
        from rigctl.report.tables.result_table import rich_table
        from rigctl.report.tables.workbench import parameters_table

        table = parameters_table(fit)
        shown = Group(*map(Text, table.notes), Text(), rich_table(table, box=None, pad_edge=False))
        self.query_one("#fit", Static).update(shown)

    def show_residuals(self, residuals: Document) -> None:
        """`rigctl compare`, against one covariate."""
        self._covariates = list(residuals["covariates"])
        self.covariate = str(residuals["covariate"])
        self._version = int(residuals["version"])
        self.query_one("#residual-line", Static).update(Text(residuals["sentence"]))
        lines = []
        for place, (name, points) in enumerate(list(residuals["series"].items())[:MAX_SERIES]):
            x, y = _columns(points)
            labels = tuple(str(point[2]) for point in points)
            lines.append(Line(x, y, name, MARKS[place], place, labels=labels))
        levels = ((-3.0, "-3σ"), (0.0, "0"), (3.0, "+3σ"))
        title = f"residuals / σ, version {residuals['version']}"
        # Residuals of a wrong model reach hundreds of sigma.
        picture = Picture(title, tuple(lines), residuals["label"], levels=levels, y_scale="symlog")
        self.query_one("#residuals", Plot).show(picture)

    def show_diagnosis(self, diagnosis: Document) -> None:
        """`rigctl diagnose`."""
        from rigctl.report.verdicts import fitted_choice, named, sizes, verdict_sentence

        self._suggested = list(diagnosis["suggested"])
        self._ranked = list(diagnosis["ranking"])
        text = Text(verdict_sentence(diagnosis))
        if self._suggested:
            text.append(f"  a adds {', '.join(self._suggested)}.", style="bold")
        if diagnosis["unexplained"]:
            text.append(f"\nunexplained: {diagnosis['unexplained']['description']}")
        self.query_one("#verdict", Static).update(text)
        table = self.query_one(DataTable)
        # Columns too: their widths follow the window's.
        table.clear(columns=True)
        for name, width in zip(("effect", "p corr.", "size", "held out"), self._widths(), strict=True):
            table.add_column(name, key=name, width=width)
        for rank in self._ranked:
            star = "*" if rank["effect"] in self._suggested else " "
            size = "; ".join(sizes(rank)) or "-"
            table.add_row(
                Text(f"{star} {named(rank['effect'], fitted_choice(rank))}"),
                probability(rank["p_value_corrected"]),
                Text(size),
                number(rank["held_out_error_ratio"]),
            )
        self._show_rank(0)

    def _widths(self) -> tuple[int, int, int, int]:
        """Of the ranking's columns: what 80 columns leave is little, so names and sizes get all there is beyond."""
        more = max(self.size.width - 80, 0)
        return 27 + more // 3, 8, 24 + more - more // 3, 8

    def show_history(self, rungs: Sequence[Document]) -> None:
        """`rigctl model history`."""
        from rigctl.report.tables.result_table import rich_table
        from rigctl.report.tables.workbench import ladder_table

        self.query_one("#ladder", Static).update(
            rich_table(ladder_table(rungs, results=False), box=None, pad_edge=False)
        )
        lines = []
        for place, (key, name) in enumerate((("error_fit", "fitted"), ("error_held_out", "held out"))):
            known = [(float(rung["version"]), float(rung[key])) for rung in rungs if rung[key]]
            if known:
                x, y = _columns(known)
                # A line and its marks; the legend needs the name once.
                labels = tuple(f"version {round(version)}" for version in x)
                lines += [Line(x, y, "", "", place), Line(x, y, name, MARKS[place], place, labels=labels)]
        versions = (rungs[0]["version"] - 0.5, rungs[-1]["version"] + 0.5) if rungs else None
        picture = Picture("error / noise", tuple(lines), "version", versions, levels=((1.0, "noise"),), y_scale="log")
        self.query_one("#ladder-plot", Plot).show(picture)

    def show_next(self, recommendation: Document) -> None:
        """`rigctl next`."""
        from rigctl.report.tables.result_table import rich_table
        from rigctl.report.terminal_workbench import runs_table

        parts: list[RenderableType] = [Text(recommendation["description"])]
        if recommendation["runs"]:
            table = runs_table(recommendation["runs"])
            parts += [Text(), Text(table.title), rich_table(table)]
        self.query_one("#next", Static).update(Group(*parts))

    async def show_run(self, run: RecordedRun) -> None:
        """What a run recorded."""
        self._run = run
        line = Text(f"{run.run_id}  ", style="bold")
        if not run.valid:
            line.append(f"left out: {run.reason}  ", style="reverse")
        line.append(", ".join(run.facts), style="dim")
        self.query_one("#run-line", Static).update(line)
        box = self.query_one("#run-plots", VerticalScroll)
        # Awaited, and one at a time: two runs may be asked for at once.
        async with self._one_run:
            had = box.has_focus_within
            await box.remove_children()
            await box.mount_all(map(Plot, run.pictures))
            if had:
                self.screen.set_focus(self.rest())

    def _tell(self, text: str) -> None:
        self.query_one("#model-line", Static).update(Text(text, no_wrap=True, overflow="ellipsis"))

    def _go(self, tab: str) -> None:
        # By a key and at once: a page that came up when its contents are ready would take keys meant for another.
        self.query_one(Pages).show(tab)
        if self.has_focus_within:
            self.screen.set_focus(self.rest())

    def on_data_table_row_highlighted(self, event: DataTable.RowHighlighted) -> None:
        """More of the effect under the cursor."""
        self._show_rank(event.cursor_row)

    def _show_rank(self, row: int) -> None:
        if not 0 <= row < len(self._ranked):
            return
        from rigctl.report.verdicts import sizes

        rank = self._ranked[row]
        equivalents = f"  cannot be told from {', '.join(rank['equivalent_to'])}" if rank["equivalent_to"] else ""
        fall = f"chi2 falls by {number(rank['chi2_fall'])}, {100 * rank['keep']:.0f} % of it by no other effect"
        detail = f"{rank['effect']}: {fall}{equivalents}\n{'; '.join(sizes(rank))}"
        self.query_one("#rank-detail", Static).update(Text(detail))

    def on_plot_chosen(self, event: Plot.Chosen) -> None:
        """From a step of the ladder to its residuals, from one of these to its run."""
        if event.plot.id == "ladder-plot":
            self._go("tab-residuals")
            version = int(event.label.removeprefix("version "))
            self.post_message(AnalysisAsked("residuals", (self.covariate, version)))
        elif event.plot.id == "residuals":
            self.post_message(RunAsked(event.label))

    # What the operator asks

    def action_ask(self, what: str) -> None:
        """Fit the current model, diagnose which effect is missing, or recommend what to measure next."""
        self._go({"fit": "tab-model", "diagnose": "tab-ranking", "recommend": "tab-next"}[what])
        self.post_message(AnalysisAsked(what))

    def action_add(self) -> None:
        """Pick an effect: what is suggested first, then the one under the cursor, then the catalogue."""
        ranked = [str(rank["effect"]) for rank in self._ranked]
        row = self.query_one(DataTable).cursor_row
        under = ranked[row : row + 1] if self.query_one(Pages).active == "tab-ranking" else []
        order = dict.fromkeys([*self._suggested, *under, *ranked, *self._catalogue])
        options = [
            (name, ("suggested: " if name in self._suggested else "") + self._catalogue.get(name, ""))
            for name in order
            if name not in self._effects
        ]
        if len(missing := [name for name in self._suggested if name not in self._effects]) > 1:
            options.insert(0, (TOGETHER.join(missing), "all that is suggested, in one fit"))
        if not options:
            self.post_message(Noted(UNKNOWN_MODEL, "warning"))
            return
        self._pick("Add which effect?", options, "add")

    def action_remove(self) -> None:
        """Pick one that is in the model."""
        if not self._effects:
            told = "the model has no effects to remove" if self._catalogue else UNKNOWN_MODEL
            self.post_message(Noted(told, "warning"))
            return
        options = [(name, self._catalogue.get(name, "")) for name in self._effects]
        self._pick("Remove which effect?", options, "remove")

    def action_mark(self) -> None:
        """Leave the run that is shown out, or use it again, with a reason."""
        run = self._run
        if run is None:
            self.post_message(Noted("no run is shown: Enter on a point of the residuals shows one", "warning"))
        elif not run.can_be_marked:
            self.post_message(Noted(f"{run.run_id} is no run of its own: leave it out of the file", "warning"))
        else:
            ask_why(self, run.run_id, valid=run.valid, reason=run.reason)

    def action_covariate(self) -> None:
        """Pick what the residuals are shown against."""

        def go(name: str) -> None:
            self.covariate = name
            self._go("tab-residuals")
            self.post_message(AnalysisAsked("residuals", (name, self._version)))

        if self._covariates:
            PickDialog("Residuals against what?", [(name, "") for name in self._covariates]).ask(self.app, go)
        else:
            go(self.covariate)

    def _pick(self, title: str, options: Sequence[tuple[str, str]], what: str) -> None:
        def go(names: str) -> None:
            self.post_message(AnalysisAsked(what, (names.split(TOGETHER),)))

        PickDialog(title, options).ask(self.app, go)

    def action_write(self) -> None:
        """Ask what; under which name is asked then."""
        kinds = [(kind, KINDS[kind].explanation) for kind in OF_THE_WORKBENCH]
        PickDialog("Write what?", kinds).ask(self.app, lambda kind: self.post_message(WriteAsked(kind)))


def _columns(points: Sequence[Sequence[Any]]) -> tuple[FloatArray, FloatArray]:
    """x and y of points."""
    import numpy as np  # with the first numbers there are

    return np.array([point[0] for point in points]), np.array([point[1] for point in points])
