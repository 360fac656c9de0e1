"""The series whose amplitudes the estimates need, and how they come of a run's columns, in one pass or in chunks.

Powers of the measured accelerations count from their constant levels, which are known only at the end; the raw powers
are summed and turned into central ones afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.units import ABSOLUTE_ZERO_C
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session

MEASURED = ("m1_x", "m1_y", "m1_z", "m2_x", "m2_y", "m2_z")
GRADIENTS = ("t_xx", "t_xz", "t_yy", "t_zz", "t_xy", "t_yz")
ROTATION = ("dw_x", "dw_y", "dw_z")
ATTITUDE = ("att_z",)
NEEDED = (*MEASURED, *GRADIENTS, *ROTATION, *ATTITUDE)
"""Columns of a run that estimates use."""

SERIES = (
    *("m1", "m2", "m1^2", "m2^2", "m1 m2", "m1^3", "m2^3", "y", "y^2", "z", "z^2"),
    *GRADIENTS,
    *ROTATION,
    *ATTITUDE,
    *("own x", "own y", "own z"),
    *("moved", "moved g_xx", "moved g_xy", "moved g_xz", "moved g_yy", "moved g_zz"),
    *("force x", "force y", "force z"),
)
"""m1, m2: x accelerations; y, z: common ones; own: m_1 - m_2; moved: injected displacement, g = T - In. `force` is
what acts on mass 1 less what acts on mass 2: no channel tells it, effects do."""

INDEX = {name: place for place, name in enumerate(SERIES)}
_CHUNK = 1 << 15


def temperatures(columns: Mapping[str, FloatArray]) -> tuple[FloatArray, ...]:
    """Of both sensors [K], a single column `temperature_c` standing for both; empty where none is recorded."""
    common = [columns[name] - ABSOLUTE_ZERO_C for name in ("temperature_c",) if name in columns]
    sensors = [[columns[name]] if (name := f"temperature_{mass}_k") in columns else common for mass in (1, 2)]
    return tuple(each[0] for each in sensors) if all(sensors) else ()


@dataclass(frozen=True)
class Amplitudes:
    """A stretch's complex amplitudes c - i s, `table` of shape (lines, series), and what they count from: the mean of
    m_cx^2, and the level of m_dx, half the difference of the masses' levels along x."""

    table: ComplexArray
    mean_square: float
    apart: float

    def of(self, name: str) -> ComplexArray:
        """One series at all lines, shape (lines,)."""
        return np.asarray(self.table[:, INDEX[name]])


def raw_series(
    session: Session, t_s: FloatArray, columns: Mapping[str, FloatArray], out: FloatArray | None = None
) -> FloatArray:
    """`SERIES` of some samples, powers not yet central; shape (samples, series).

    `out` (series, samples, ..), zero when it is first given, is written into: memory that is used again needs not
    be fetched again.
    """
    m1, m2 = columns["m1_x"], columns["m2_x"]
    made = np.zeros((len(SERIES), *m1.shape)) if out is None else out
    row = dict(zip(SERIES, made, strict=True))
    row["m1"][:], row["m2"][:] = m1, m2
    for power, one, other in _POWERS:
        np.multiply(row[one], row[other], out=row[power])
    for axis in "yz":
        np.add(columns[f"m1_{axis}"], columns[f"m2_{axis}"], out=row[axis])
        row[axis] *= 0.5
        np.square(row[axis], out=row[f"{axis}^2"])
    for name in (*GRADIENTS, *ROTATION, *ATTITUDE):
        row[name][:] = columns[name]
    for axis in "xyz":
        np.subtract(columns[f"m1_{axis}"], columns[f"m2_{axis}"], out=row[f"own {axis}"])
    if session.moves_masses:
        row["moved"][:] = moved = session.injected(t_s)
        for name in ("xx", "yy", "zz"):
            np.multiply(moved, columns[f"t_{name}"], out=row[f"moved g_{name}"])
        for name, combine, turning in (("xy", np.add, "dw_z"), ("xz", np.subtract, "dw_y")):
            # (T - In): a displacement along Y or Z meets the satellite's angular acceleration too.
            combine(columns[f"t_{name}"], columns[turning], out=row[f"moved g_{name}"])
            row[f"moved g_{name}"] *= moved
    return made.T


_POWERS = (
    ("m1^2", "m1", "m1"),
    ("m2^2", "m2", "m2"),
    ("m1 m2", "m1", "m2"),
    ("m1^3", "m1^2", "m1"),
    ("m2^3", "m2^2", "m2"),
)


def with_true_attitude(session: Session, lines: Sequence[Line], amplitudes: Amplitudes) -> Amplitudes:
    """With t_xy as the true attitude makes it at the stimulus of a turning session; other sessions as they are.

    The injected angle is taken from the tracker, and the hybrid estimate has only what its low-pass lets through: at
    the stimulus it is off by a hundredth. The measured angular acceleration, over -w^2, is not.
    """
    if session.name != "dy" or STIMULUS not in lines:
        return amplitudes
    place = lines.index(STIMULUS)
    w = 2.0 * np.pi * session.frequency_hz
    error = -amplitudes.of("dw_z")[place] / w**2 - amplitudes.of("att_z")[place]
    table = amplitudes.table.copy()
    # T_xy = alpha_z (T_yy - T_xx), and T_yy - T_xx = -1.5 n^2 (1 + cos 2 n t) but for the eccentricity.
    steady = -1.5 * (2.0 * np.pi * session.orbital_hz) ** 2
    for line, share in ((STIMULUS, 1.0), (Line(1, -2), 0.5), (Line(1, 2), 0.5)):
        if line in lines:
            table[lines.index(line), INDEX["t_xy"]] += share * steady * error
    return replace(amplitudes, table=table)


def stretch_amplitudes(
    session: Session, t_s: FloatArray, columns: Mapping[str, FloatArray], rows: FloatArray, level: FloatArray
) -> Amplitudes:
    """Amplitudes of one stretch, summed chunk by chunk: all its series at once are hundreds of megabytes.

    `rows` (2 lines, samples) are those of `weights.weights`, `level` (samples,) those of `weights.level_weights`.
    Missing samples may be any finite number.
    """
    parts, means = np.zeros((len(rows), len(SERIES))), np.zeros(len(SERIES))
    for start in range(0, len(t_s), _CHUNK):
        here = slice(start, start + _CHUNK)
        series = raw_series(session, t_s[here], {name: column[here] for name, column in columns.items()})
        parts += rows[:, here] @ series
        means += level[here] @ series
    return central(np.asarray(parts[0::2] - 1j * parts[1::2]), means)


def central(table: ComplexArray, means: FloatArray) -> Amplitudes:
    """Amplitudes of powers about the levels, from those of raw powers; `means` (series,) are levels of these."""
    # Binomials. Constants of the expansion drop out: weights of lines are orthogonal to a constant.
    made = table.copy()
    at = INDEX
    mean = {name: float(means[at[name]]) for name in ("m1", "m2", "y", "z")}
    for name in ("m1", "m2"):
        one, two, three = (table[:, at[f"{name}{power}"]] for power in ("", "^2", "^3"))
        made[:, at[f"{name}^2"]] = two - 2.0 * mean[name] * one
        made[:, at[f"{name}^3"]] = three - 3.0 * mean[name] * two + 3.0 * mean[name] ** 2 * one
    made[:, at["m1 m2"]] = table[:, at["m1 m2"]] - mean["m1"] * table[:, at["m2"]] - mean["m2"] * table[:, at["m1"]]
    for name in ("y", "z"):
        made[:, at[f"{name}^2"]] = table[:, at[f"{name}^2"]] - 2.0 * mean[name] * table[:, at[name]]
    square = sum(float(means[at[name]]) for name in ("m1^2", "m2^2")) + 2.0 * float(means[at["m1 m2"]])
    centre = 0.5 * (mean["m1"] + mean["m2"])
    return Amplitudes(made, 0.25 * square - centre**2, 0.5 * (mean["m1"] - mean["m2"]))


BEFORE_S, AFTER_S = 3.0, 30.0
"""So long before and after its beginning a pulse covers samples."""


def covered(t_s: FloatArray, pulses_s: Sequence[float] | FloatArray, reach_s: float = 0.0) -> BoolArray:
    """Which samples, in order of time, pulses beginning at `pulses_s` cover; `reach_s` more where those are averages
    over so much on either side."""
    hidden = np.zeros(len(t_s), dtype=bool)
    for begin_s in pulses_s:
        first, last = np.searchsorted(t_s, [begin_s - BEFORE_S - reach_s, begin_s + AFTER_S + reach_s])
        hidden[first:last] = True
    return hidden


def without_pulses(samples: Mapping[str, FloatArray], pulses_s: FloatArray | None) -> Mapping[str, FloatArray]:
    """The samples without those that pulses beginning at `pulses_s` cover; None for a run without pulses."""
    if pulses_s is None:
        return samples
    hidden = covered(samples["t_s"], pulses_s)
    return {name: column if name == "t_s" else np.where(hidden, np.nan, column) for name, column in samples.items()}
