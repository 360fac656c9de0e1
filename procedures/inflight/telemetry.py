"""Rows of telemetry as samples of a session: placed by their time stamps, possible, and within range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ImplausibleSample
from rigctl.core.interfaces import Channel

STAMP_WITHIN = 1e-2
"""Of a sample period: how exactly a time stamp says which sample it is."""
POSSIBLE = {
    "rad": (-7.0, 7.0),
    "1/s2": (-1e-3, 1e-3),
    "rad/s2": (-1.0, 1.0),
    "K": (0.0, 1000.0),
    "m/s2": (-100.0, 100.0),
}
"""What telemetry can say, by unit: a turn; gradients and accelerations that no orbit and no thruster comes near."""


@dataclass(frozen=True)
class OnGrid:
    """Rows of telemetry that had not come before, and the same with rows for what was lost between them."""

    came: FloatArray
    all: FloatArray


def on_grid(satellite: str, rows: FloatArray, got: int, samples: int, period_s: float) -> OnGrid:
    """Rows by their time stamps, after the first `got` of a session: a packet that comes twice counts once.

    `ImplausibleSample` for stamps that are no sample times, or do not rise.
    """
    # A stamp may be NaN; it is no sample time and is refused below.
    with np.errstate(invalid="ignore"):
        places = rows[:, 0] / period_s
        # Written so that NaN is off.
        is_off = ~((np.abs(places - np.rint(places)) < STAMP_WITHIN) & (places > -0.5) & (places < samples + 1.0))
    if is_off.any():
        raise _stamp(satellite, rows, int(np.argmax(is_off)), "is no sample time of the session", got)
    numbers = np.rint(places).astype(np.int64)
    # A packet that was sent again lies before what has come already.
    is_new = numbers >= got
    came, numbers = rows[is_new], numbers[is_new]
    if len(numbers) and (np.diff(numbers) <= 0).any():
        # The same packet twice within one fetch is as good as once.
        numbers, first = np.unique(numbers, return_index=True)
        twice = came[first[np.searchsorted(numbers, np.rint(came[:, 0] / period_s).astype(np.int64))]]
        if not np.array_equal(twice, came, equal_nan=True):
            raise _stamp(satellite, came, 0, "comes twice, with other values", got)
        came = came[first]
    filled = gap(got, int(numbers[-1]) + 1 if len(numbers) else got, period_s, rows.shape[1])
    filled[numbers - got] = came
    return OnGrid(came, filled)


def require_possible(satellite: str, rows: FloatArray, channels: tuple[Channel, ...], got: int) -> None:
    """`ImplausibleSample` for what nothing in orbit is; NaN is lost."""
    for place, channel in enumerate(channels[1:], 1):
        low, high = POSSIBLE.get(channel.unit, (-np.inf, np.inf))
        # NaN is neither: it was lost on the way.
        beyond = (rows[:, place] < low) | (rows[:, place] > high)
        if beyond.any():
            sample = int(np.argmax(beyond))
            text = f"{rows[sample, place]:g} {channel.unit} is not possible"
            raise ImplausibleSample(
                f"{satellite}: {channel.name}, sample {got + sample}: {text}",
                channel=channel.name,
                sample=got + sample,
                instrument=satellite,
            )


def gap(first: int, end: int, period_s: float, columns: int) -> FloatArray:
    """Rows of which nothing but the time is known."""
    rows = np.full((end - first, columns), np.nan)
    rows[:, 0] = period_s * np.arange(first, end)
    return rows


def _stamp(satellite: str, rows: FloatArray, place: int, why: str, got: int) -> ImplausibleSample:
    text = f"{satellite}: t_s, sample {got + place}: a time stamp of {rows[place, 0]:g} s {why}"
    return ImplausibleSample(text, channel="t_s", sample=got + place, instrument=satellite)


def flaw_of(rows: FloatArray, channels: tuple[Channel, ...]) -> str | None:
    """What says that the loop does not hold; samples that were lost are no flaw."""
    if len(rows) and not np.isfinite(rows[:, 1:]).any():
        return f"nothing comes down from t_s {rows[0, 0]:g} on: telemetry is lost, or the satellite tumbles"
    for place, channel in enumerate(channels):
        column = rows[:, place]
        if channel.full_scale is None:
            continue
        beyond = np.abs(column) >= channel.full_scale
        if beyond.any():
            at_s = rows[int(np.argmax(beyond)), 0]
            return (
                f"{channel.name} leaves its range of {channel.full_scale:g} {channel.unit} at t_s {at_s:g}: "
                "drag-free control does not hold it; correct its gains, or inject less"
            )
    return None
