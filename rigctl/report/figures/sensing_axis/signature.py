"""The signature of an effect: what it adds to a bench's observables over the stage's angle, at three frequencies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.campaign.recording import Header
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Origins
from rigctl.experiments.sensing_axis.model.components import observed, series_of
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, Amplitudes, RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_package
from rigctl.files.package import HeadSettings
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import SOFT, series_style
from rigctl.report.quantities import typically

FREQUENCIES_HZ = (0.3, 0.5, 0.6)
AMPLITUDE_M = 5e-3
SIDEWAYS_DEG, SPOT_DEG = 90.0, 2.0
"""Angles an accelerometer can be turned to, and those at which a head still sees its face."""

LATER_S, WARMER_K = 3600.0, 1.0
_PLACE = f"{AMPLITUDE_M * 1e3:g} mm of motion, {LATER_S:g} s after the recording's middle and {WARMER_K:g} K warmer"
MAX_PANELS = 4
_POINTS = 61
_HEADS = {
    "laser_1_mm": HeadSettings(position="+x", tilt_deg=5.0),
    "laser_2_mm": HeadSettings(position="+y", tilt_deg=5.0),
    "laser_3_mm": HeadSettings(position="+z", tilt_deg=5.0),
}


@dataclass(frozen=True)
class SignatureRow:
    """What the effect adds to one component at one angle and frequency."""

    channel: str
    component: str
    unit: str
    frequency_hz: float
    theta_deg: float
    added: float


def signature_plate(effect: Effect) -> Plate[SignatureRow]:
    """Make the figure of a sensing-axis effect of typical size.

    `DataError` for one that is a line in the samples, or that does not act in these runs: it changes none of the
    observables.
    """
    heads = _HEADS if effect.on == "laser_m" else {}
    widest = SPOT_DEG if heads else SIDEWAYS_DEG
    angles = np.linspace(-widest, widest, _POINTS)
    runs = [_run(f, float(angle), heads) for f in FREQUENCIES_HZ for angle in angles]
    # Of an empty recording: the nominal package.
    package = recorded_package(Header("sensing-axis"))
    # The origins are those that WARMER_K and LATER_S count from.
    base = RecordingModel(runs, package, heads, 9.80665, origins=Origins(20.0, 0.0))
    model = base.with_effects((effect,))
    # The bench's own parameters stay at their start in both: the difference is the effect's alone.
    nothing = np.array(
        [p.start if not owner else 0.0 for p, owner in zip(model.parameters, model.owners, strict=True)]
    )
    typical = np.array(
        [
            # An effect's parameters are named `effect.parameter[place]`.
            effect.typical[p.name.partition("[")[0].rpartition(".")[2]] if owner else p.start
            for p, owner in zip(model.parameters, model.owners, strict=True)
        ]
    )
    added = observed(model.predict(typical)) - observed(model.predict(nothing))
    rows = _rows(added, runs, base.heads)
    if not rows:
        where = "it is looked for in the samples" if effect.scanned else f"at {_PLACE}"
        raise DataError(f"'{effect.id}' changes no observable of a run: {where}")
    caption = f"What {typically(effect)} adds to the observables of a nominal bench, mounting and sensor, {_PLACE}."
    return Plate(f"signature_{effect.id}", caption, rows, draw_signature)


def _rows(added: FloatArray, runs: Sequence[RunObservables], heads: Sequence[str]) -> list[SignatureRow]:
    """The components it changes most, each kind of channel by itself, none that is a millionth of the largest."""
    series = series_of(heads)
    size = np.max(np.abs(added), axis=0)
    kinds = np.array([each.unit for each in series])
    # An effect may change nothing of a kind of channel.
    relative = np.array([s / max(size[kinds == unit].max(), 1e-15) for s, unit in zip(size, kinds, strict=True)])
    shown = [i for i in np.argsort(-relative, kind="stable") if relative[i] > 1e-6][:MAX_PANELS]
    return [
        SignatureRow(
            series[i].channel,
            series[i].component,
            series[i].unit,
            run.frequency_hz,
            math.degrees(run.theta_rad),
            float(added[j, i]),
        )
        for i in sorted(shown)
        for j, run in enumerate(runs)
    ]


def _run(frequency_hz: float, theta_deg: float, heads: Iterable[str]) -> RunObservables:
    motion = np.zeros(HARMONICS, np.complex128)
    # x(t) = A sin wt, in the convention of a cosine's complex amplitude.
    motion[0] = -1j * AMPLITUDE_M
    # Only predictions are asked for: what was measured enters none, but has to be there.
    silent = Amplitudes(
        np.zeros(HARMONICS + 1, np.complex128), np.ones(HARMONICS + 1), np.ones(HARMONICS + 1), np.zeros(0, complex)
    )
    return RunObservables(
        run_id="",
        axis="X",
        configuration="pendulum",
        mounting=1,
        theta_rad=math.radians(theta_deg),
        approach=1.0,
        frequency_hz=frequency_hz,
        temperature_c=20.0 + WARMER_K,
        start_s=LATER_S,
        duration_s=0.0,
        motion_m=motion,
        accel_v=silent,
        lasers_m=dict.fromkeys(heads, silent),
        faces={},
    )


def draw_signature(rows: Sequence[SignatureRow]) -> Figure:
    """A panel per component, a line per frequency."""
    shown = list(dict.fromkeys((row.channel, row.component, row.unit) for row in rows))
    columns = min(len(shown), 2)
    lines = math.ceil(len(shown) / 2)
    figure = Figure(2.0 * lines)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for panel, (channel, component, unit) in zip(panels, shown, strict=False):
        for index, frequency in enumerate(FREQUENCIES_HZ):
            points = [r for r in rows if (r.channel, r.component, r.frequency_hz) == (channel, component, frequency)]
            look = series_style(index)
            panel.plot(
                [r.theta_deg for r in points],
                [r.added for r in points],
                color=look.color,
                linestyle=look.line,
                label=f"{frequency:g} Hz",
            )
        panel.axhline(0.0, color=SOFT, linewidth=0.5, zorder=0)
        panel.set_title(f"{channel}, {component}")
        panel.set_ylabel(f"added / {unit}")
        panel.set_xlabel("stage angle θ / deg")
    for panel in panels[len(shown) :]:
        panel.set_axis_off()
    panels[0].legend()
    return figure
