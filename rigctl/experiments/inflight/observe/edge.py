"""What noise far above a run's lines does to its published amplitudes.

The chain as published drops 200 s, which leaves the weights of its lines an edge. Read-out noise grows as f^2, to a
thousand times the noise at the lines, and comes in there: 12 % more at 1 mHz than the density at the line says. How
much it is follows from the samples' own spectrum, of which a run's thinned columns know nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.analysis.periodograms import fast_length
from rigctl.core.arrays import FloatArray

FAST = ("m1", "m2", "y", "z")
"""The series that have noise above the lines; of what else is corrected with them it is a millionth."""

_LEAST_HZ, _ABOVE_LINES = 0.02, 3.0
_SEGMENT_S = 1024.0
_KAISER_BETA = 20.0
_FEWEST = 4


def fast_noise(rows: FloatArray, columns: Mapping[str, FloatArray], step_s: float, highest_hz: float) -> FloatArray:
    """Covariance of the amplitudes of `FAST` by noise well above the `highest_hz` of the lines, (rows, 4, 4).

    `rows` (2 lines, samples) are those of `weights.weights` of a run without gaps. Zero for runs that have no more
    than a few segments, or no samples fast enough to show it.
    """
    count = round(_SEGMENT_S / step_s)
    segments = rows.shape[1] // max(count, 1)
    f_hz = np.fft.rfftfreq(max(count, 1), step_s)
    used = f_hz > max(_LEAST_HZ, _ABOVE_LINES * highest_hz)
    if segments < _FEWEST or not used.any():
        return np.zeros((len(rows), len(FAST), len(FAST)))
    density = _density(columns, count, segments, step_s)
    # On both sides of each bin of the samples' spectrum lie many of the weights'.
    length = fast_length(2 * rows.shape[1])
    step_hz = 1.0 / (length * step_s)
    bins = np.minimum(np.rint(step_hz * np.arange(length // 2 + 1) / f_hz[1]).astype(np.intp), len(f_hz) - 1)
    power = np.array([np.bincount(bins, np.abs(np.fft.rfft(row, length)) ** 2, len(f_hz)) for row in rows]) * step_hz
    return np.asarray(np.einsum("rf,fij->rij", power[:, used], density[used]))


def _density(columns: Mapping[str, FloatArray], count: int, segments: int, step_s: float) -> FloatArray:
    """One-sided cross-spectra of `FAST`, real part, by segments; shape (count // 2 + 1, 4, 4)."""
    # Side lobes of 1e-15 in power: stimuli are 1e4 times the noise, and in one bin.
    window = np.kaiser(count, _KAISER_BETA)
    density = np.zeros((count // 2 + 1, len(FAST), len(FAST)))
    for start in range(0, segments * count, count):
        here = {name: column[start : start + count] for name, column in columns.items()}
        series = np.stack([here["m1_x"], here["m2_x"], *(0.5 * (here[f"m1_{a}"] + here[f"m2_{a}"]) for a in "yz")])
        bins = np.fft.rfft((series - series.mean(axis=1, keepdims=True)) * window, axis=1)
        density += (bins[:, None] * bins.conj()).real.transpose(2, 0, 1)
    return np.asarray(density * (2.0 * step_s / np.sum(window**2) / segments))
