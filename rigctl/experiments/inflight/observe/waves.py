"""Cosines and sines of lines at evenly spaced times, and whether such samples can tell them apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

_SINGULAR = 1e-6


def templates(t_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    """Cosine and sine of each line at evenly spaced times, rows cos 1, sin 1, cos 2, ...; shape (2 lines, samples).

    A place's phase is its block's and that within the block: one product is less than a cosine and a sine.
    """
    made = np.empty((2 * len(lines_hz), len(t_s)))
    within = math.isqrt(len(t_s)) + 1
    for number, f_hz in enumerate(lines_hz):
        rate = 2j * np.pi * f_hz
        blocks, waves = np.exp(rate * t_s[::within]), np.exp(rate * (t_s[:within] - t_s[0]))
        wave = np.multiply.outer(blocks, waves).ravel()[: len(t_s)]
        made[2 * number], made[2 * number + 1] = wave.real, wave.imag
    return made


def sum_of_lines(parts: FloatArray, t_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    """`parts` (2 lines,), cosine and sine of each line, summed at evenly spaced times; the shape of `t_s`.

    As `templates`: a product of matrices, and hardly a cosine.
    """
    size = np.array(parts[0::2] - 1j * parts[1::2])
    rate = 2j * np.pi * np.array(lines_hz)
    count = len(t_s)
    step_s, within = float(t_s[-1] - t_s[0]) / (count - 1), math.isqrt(count) + 1
    blocks = size * np.exp(rate * t_s[::within, None])
    waves = np.exp(rate[:, None] * step_s * np.arange(within))
    return np.asarray((blocks.real @ waves.real - blocks.imag @ waves.imag).ravel()[:count])


def inverse_of(normal: FloatArray) -> FloatArray:
    """Of the products of lines; `DataError` where these cannot be told apart."""
    size = np.sqrt(np.diag(normal))
    values = np.linalg.eigvalsh(normal / np.outer(size, size))
    if not values[0] > _SINGULAR * values[-1]:
        raise DataError("the samples cannot tell the lines apart: record longer, or choose another frequency")
    return np.asarray(np.linalg.inv(normal))
