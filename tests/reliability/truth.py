"""Holds a store to what the simulated instruments really measured: a stored sample is that number, or it is wrong.

NaN in its place is no wrong number: the sample is missing, which an event has to tell.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.campaign.recording import time_column
from rigctl.campaign.store.entries import RUN_ENDED
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from simulators.measured import from_file

AROUND_S = 120.0
"""A set-point of a run is read so long before it at most, and after it where no event says when the run was over."""

ROUNDED = 1e-9
"""Relative: what became of a number on its way through text, and of a mean of equal ones."""

TELL_OF_MISSING = ("record-lost", "gap")
"""Events that say that samples of a run are missing."""

READ_ONCE = ("theta_deg", "temperature_c")
DERIVED = {"t_s", "moving", "theta_deg", "temperature_c", "dm1_y_v", "dm1_z_v"}
"""Columns that are worked out from readings and set-points, not recorded."""


@dataclass(frozen=True)
class Period:
    """A time of the rig, its ends included."""

    from_s: float
    until_s: float


@dataclass(frozen=True)
class Truth:
    """One channel's measurements in the order of time."""

    at_s: FloatArray
    values: FloatArray

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The measurement next to each time, and how far from it it was made [s]."""
        after = np.clip(np.searchsorted(self.at_s, times_s), 1, len(self.at_s) - 1)
        before = after - 1
        nearest = np.where(times_s - self.at_s[before] <= self.at_s[after] - times_s, before, after)
        return self.values[nearest], np.abs(self.at_s[nearest] - times_s)

    def during(self, period: Period) -> FloatArray:
        """What was measured then."""
        return self.values[(self.at_s >= period.from_s) & (self.at_s <= period.until_s)]


def wrong_number(store_path: Path, measured_path: Path, *, own_clock: bool = False) -> str:
    """The first number in a valid run that no instrument measured; "" when there is none.

    With `own_clock` the rig's clock is another than that of the program, as over wires: each run is laid where its
    first column is found in what was measured, and all its columns have to be there.

    Of telemetry, whose times begin anew with each session, a store has one session.
    """
    if not store_path.exists():
        return ""
    truths = _truths(measured_path)
    with Store.open(store_path, readonly=True) as store:
        missed = any(event.kind == "temperature-missed" for event in store.events())
        told_s = [event.rig_time_s or 0.0 for event in store.events() if event.kind in TELL_OF_MISSING]
        over_s = {event.data["key"]: event.rig_time_s or 0.0 for event in store.events() if event.kind == RUN_ENDED}
        for run in store.runs(valid_only=True):
            samples = store.samples(run.run_id)
            start_s = 0.0 if "t_s" in truths else float(run.conditions["start_s"])
            told = _told_during(samples, start_s, truths, told_s)
            shift_s = _shift_s(samples, start_s, truths) if own_clock else 0.0
            end_s = start_s + float(samples["t_s"][-1]) + AROUND_S
            read = Period(start_s - AROUND_S + shift_s, max(end_s, over_s.get(run.key, 0.0)) + shift_s)
            wrong = _wrong_sample(samples, start_s + shift_s, truths, told) or _wrong_reading(
                run.conditions, read, truths, missed
            )
            if wrong:
                return f"run {run.run_id} is valid and {wrong}"
    return ""


def _shift_s(samples: dict[str, FloatArray], start_s: float, truths: dict[str, Truth]) -> float:
    """How much later than the store's the rig's clock was, by where most samples of the first column agree; or 0."""
    name = next((name for name in samples if name in truths and name not in DERIVED), None)
    if name is None:
        return 0.0
    values, truth = samples[name], truths[name]
    at_s = start_s + samples["t_s"]
    places = [place for place in range(0, len(values), max(len(values) // 5, 1)) if not np.isnan(values[place])]
    candidates = [
        float(found_s - at_s[place])
        for place in places
        for found_s in truth.at_s[np.isclose(truth.values, values[place], rtol=ROUNDED, atol=0.0)]
    ]

    def agreeing(shift_s: float) -> int:
        measured, apart_s = truth.at(at_s + shift_s)
        near = apart_s <= 0.6 * float(np.median(np.diff(at_s)))
        return int((near & np.isclose(measured, values, rtol=ROUNDED, atol=0.0)).sum())

    return max(candidates, key=agreeing, default=0.0)


def _told_during(
    samples: dict[str, FloatArray], start_s: float, truths: dict[str, Truth], told_s: list[float]
) -> bool:
    """Whether an event tells of missing samples while the run was measured; telemetry has a time of its own."""
    until_s = start_s + float(samples["t_s"][-1]) + AROUND_S
    return any("t_s" in truths or start_s - AROUND_S <= at_s <= until_s for at_s in told_s)


def _wrong_sample(samples: dict[str, FloatArray], start_s: float, truths: dict[str, Truth], told: bool) -> str:
    times = {time_column(name) for name in samples}
    for name, values in samples.items():
        if name in DERIVED or name in times:
            continue
        if name not in truths:
            return f"{name} was measured by no instrument"
        own_s = samples.get(time_column(name))
        t_s = samples["t_s"] if own_s is None else _nearest_rows(own_s, values, start_s, truths[name])
        period_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        measured, apart_s = truths[name].at(start_s + t_s)
        bad = ~np.isclose(values, measured, rtol=ROUNDED, atol=0.0, equal_nan=True) | (apart_s > 0.6 * period_s)
        if told:
            bad &= ~np.isnan(values)
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            return (
                f"{int(bad.sum())} of {len(values)} samples of {name} are wrong: sample {first} is {values[first]}, "
                f"measured was {measured[first]} {apart_s[first]:.4f} s from there"
            )
    return ""


def _nearest_rows(own_s: FloatArray, values: FloatArray, start_s: float, truth: Truth) -> FloatArray:
    """The times of a clock of its own, moved to where most values were measured.

    When it began is known to a row or two only: that is what an offset is fitted for. By half rows: one that is off
    by half a row has no whole shift that a drifting clock agrees with all the time.
    """
    step_s = float(np.median(np.diff(own_s))) if len(own_s) > 1 else 1.0
    halves = sorted(range(-6, 7), key=abs)
    moved = [own_s + 0.5 * half * step_s for half in halves]

    def agreeing(times_s: FloatArray) -> int:
        measured, _ = truth.at(start_s + times_s)
        return int(np.isclose(values, measured, rtol=ROUNDED, atol=0.0, equal_nan=True).sum())

    return max(moved, key=agreeing)


def _wrong_reading(conditions: dict[str, object], read: Period, truths: dict[str, Truth], missed: bool) -> str:
    for name in READ_ONCE:
        if name not in conditions or name not in truths:
            continue
        told = float(str(conditions[name]))
        if name == "temperature_c" and math.isnan(told) and missed:
            continue
        measured = truths[name].during(read)
        if not len(measured) or not np.nanmin(measured) - 1e-6 <= told <= np.nanmax(measured) + 1e-6:
            return f"its {name} is {told!r}, which was not measured"
    return ""


def _truths(path: Path) -> dict[str, Truth]:
    pieces: dict[str, list[tuple[FloatArray, FloatArray]]] = defaultdict(list)
    for measurement in from_file(path):
        if measurement.channel == "t_s" and measurement.record > 1 and measurement.at_s[0] == 0.0:
            pieces.clear()  # telemetry carries times since perigee: of sessions flown again the last one is kept
        pieces[measurement.channel].append((measurement.at_s, measurement.values))
    truths = {}
    for channel, those in pieces.items():
        at_s, values = (np.concatenate(parts) for parts in zip(*those, strict=True))
        order = np.argsort(at_s, kind="stable")
        truths[channel] = Truth(np.append(at_s[order], np.inf), np.append(values[order], np.nan))
    return truths
