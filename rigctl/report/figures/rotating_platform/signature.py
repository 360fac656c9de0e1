"""The signature of an effect of the rotating platform: what it adds by period and pattern, and after a turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.rotating_platform.model.model import PlatformModel
from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.cells import AFTER_S, BEFORE, BEFORE_S
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun, channel_run
from rigctl.experiments.rotating_platform.observe.patterns import named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.reducer import Reducer
from rigctl.experiments.rotating_platform.observe.run_noise import EXPONENTS, RunNoise
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun
from rigctl.experiments.rotating_platform.result.published import ACCEL_Y_M_S2, BIAS_M_S2, INTERCEPT_M_S2
from rigctl.experiments.rotating_platform.study_data import imagined_cells
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import SOFT, series_style
from rigctl.report.quantities import typically
from rigctl.workbench.placed import placed
from rigctl.workbench.study import Term

PATTERNS = ("a", "b", "c")
PERIODS_S = (60.0, 120.0, 300.0, 600.0, 1200.0)
TILT_M_S2 = 1e-3
PERIODS, WARMER_K, LATER_S, SHORT_S = 5, 1.0, 36000.0, 0.5
_PLACE = (
    f"at a tilt of {TILT_M_S2:g} m/s2, {WARMER_K:g} K warming over a run, {LATER_S:g} s after the recording began, "
    f"in the channel of sensor A"
)
# Seen only while the platform still moves: with a mask that is long enough it adds nothing.
_MASK_SHORT = ("off-centre",)


@dataclass(frozen=True)
class PlatformSignatureRow:
    """What the effect adds to one output of a pattern and period, or around the turns of pattern c of a minute."""

    output: str
    pattern: str
    period_s: float
    since_turn_s: float
    stop: int
    added_m_s2: float


def signature_plate(effect: Effect) -> Plate[PlatformSignatureRow]:
    """Make the figure of an effect of typical size; `DataError` for one that changes none of the observables."""
    rows: list[PlatformSignatureRow] = []
    for pattern in PATTERNS:
        for period_s in PERIODS_S:
            rows += _rows(effect, pattern, period_s)
    if not any(row.added_m_s2 for row in rows):
        raise DataError(f"'{effect.id}' changes no observable of a run: it is looked for in the samples")
    short = f", the mask {SHORT_S:g} s short" if effect.id in _MASK_SHORT else ""
    caption = (
        f"What {typically(effect)} adds, {_PLACE}{short}. (a) Mean acceleration and (b) bias by the joint fit over "
        "the modulation frequency; (c) what the fit leaves around a turn, pattern c of 60 s."
    )
    return Plate(f"signature_{effect.id}", caption, rows, draw_signature)


def _rows(effect: Effect, pattern: str, period_s: float) -> list[PlatformSignatureRow]:
    recorded = _recorded(pattern, period_s, SHORT_S if effect.id in _MASK_SHORT else 0.0)
    placed_effect = placed(effect, Term(effect.id), CHANNELS, ())
    model = PlatformModel(recorded, [placed_effect], [placed_effect.term])
    # In the baseline's order: tilt gain, accelerations along Z and Y, biases, their rates.
    base = [1.0, INTERCEPT_M_S2, ACCEL_Y_M_S2, BIAS_M_S2["z"], BIAS_M_S2["y"], 0.0, 0.0]
    added = model.added(np.array([*base, *(each.typical for each in placed_effect.parameters)]))
    (z,) = (each for each in recorded.channels if each.channel == "z")
    # Observables of a channel: four outputs with a value per group of periods each, then the bins around its turns.
    groups = z.reducer.groups.size
    rows = [
        PlatformSignatureRow(
            name, pattern, period_s, float("nan"), 0, float(added[i * groups : (i + 1) * groups].mean())
        )
        for name, i in (("accel mean", 0), ("bias mean", 2))
    ]
    if (pattern, period_s) == ("c", PERIODS_S[0]):
        for one_bin, value in zip(z.reducer.bins, added[4 * groups : z.value.size], strict=True):
            # A bin is drawn where it begins; the one that ends at the turn in its middle, left of zero.
            after = -0.5 * BEFORE_S if one_bin.number == BEFORE else AFTER_S[one_bin.number]
            rows.append(PlatformSignatureRow("around a turn", pattern, period_s, after, one_bin.sign, float(value)))
    return rows


def _recorded(pattern: str, period_s: float, mask_short_s: float) -> Recorded:
    cells = imagined_cells(named_pattern(pattern, period_s), PERIODS, c_z_m_s2=TILT_M_S2, mask_short_s=mask_short_s)
    share = cells.time_s / (cells.periods * cells.period_s)
    cells.state[:, 2] = 22.0 + WARMER_K * share
    run = PlatformRun("signature", {"start_s": LATER_S}, cells)
    # Noise enters no number here; it has to be something.
    silent = RunNoise(1e-12, np.zeros(EXPONENTS.size), 1.0)
    channels: list[ChannelRun] = [channel_run(run, Reducer(cells, name), silent) for name in CHANNELS]
    return Recorded(tuple(channels), 9.81)


def draw_signature(rows: Sequence[PlatformSignatureRow]) -> Figure:
    """Means over the modulation frequency, a line per pattern, and the profile around a turn."""
    figure = Figure(2.4)
    panels = figure.subplots(1, 3)
    for panel, letter, output in zip(panels, "abc", ("accel mean", "bias mean", "around a turn"), strict=True):
        here = [row for row in rows if row.output == output]
        if output == "around a turn":
            series = [(name, [row for row in here if row.stop == stop]) for name, stop in (("at 0", 1), ("at π", -1))]
            panel.set_xlabel("time since the turn / s")
            panel.set_ylabel("added to what the fit leaves / m/s²")
        else:
            series = [(f"pattern {each}", [row for row in here if row.pattern == each]) for each in PATTERNS]
            panel.set_xlabel("modulation frequency / mHz")
            panel.set_ylabel(f"added to the {output} / m/s²")
        for index, (label, points) in enumerate(series):
            look = series_style(index)
            panel.plot(
                [row.since_turn_s if output == "around a turn" else 1e3 / row.period_s for row in points],
                [row.added_m_s2 for row in points],
                color=look.color,
                marker=look.marker,
                linestyle=look.line,
                label=label,
            )
        panel.legend()
        panel.axhline(0.0, color=SOFT, linewidth=0.5, zorder=0)
        panel.letter = letter
    return figure
