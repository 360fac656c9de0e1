"""Whether the samples of a run can be what its row in runs.csv says."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.bundle.sample_file import SampleFile
from rigctl.campaign.layout import Layout
from rigctl.campaign.recording import ChannelInfo
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.units import possible_range, unit_of_column

JITTER = 0.05
"""A step of time may differ from the median step by this fraction: what rounding in a text file may do."""

DRIFT = 0.25
"""No sample is further than this fraction of a step from an evenly spaced time base."""

GAP = 1.5
"""A step of time longer than this many median steps is a gap."""

RATE_TOLERANCE = 0.01

STEP_MIN_S, STEP_MAX_S = 1e-9, 1e6
"""What a recorder of motion takes between two samples: a nanosecond to twelve days."""


@dataclass(frozen=True)
class Findings:
    """Why a run cannot be used, and what else is to be said about it."""

    invalid: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def check_samples(
    layout: Layout,
    conditions: Mapping[str, Any],
    file: SampleFile,
    channels: Mapping[str, ChannelInfo],
    constants: Mapping[str, float],
    *,
    declared_valid: bool,
) -> Findings:
    """What is wrong with the samples of a run.

    `DataError` for what cannot be a recording: columns missing, a time base that is none, a run shorter than
    its period, a column in another unit than its name says.
    A run its recorder had given up already may be short or empty.
    """
    _require_columns(file, layout.samples_of(conditions))
    t_s = file.columns["t_s"]
    step_s = _require_time(file, t_s)
    invalid: list[str] = []
    remarks: list[str] = []
    if short := _too_short(t_s, step_s, layout.period_of(conditions)):
        if declared_valid:
            raise file.place.error(f"{short}; record longer, remove the run, or set its valid to 0")
        remarks.append(short)
    masked = [
        *_time_base(t_s, step_s),
        # While the platform turns no sample counts, and what moves is said by 0 and 1, checked elsewhere.
        *_missing(file, [name for name in layout.samples_of(conditions) if name not in {"t_s", "moving"}]),
        *_saturated(file, channels, _moving(file)),
        *_impossible(file),
    ]
    # Analyses that mask samples themselves lose those samples only; for all others the run is unusable.
    (remarks if layout.handles_missing else invalid).extend(masked)
    invalid.extend(_wholly_missing(file, layout.samples_of(conditions)) if layout.handles_missing else ())
    remarks.extend(_rate(conditions, step_s))
    # Units are compared with amplitudes in the samples, which those of a run that was given up need not have.
    if declared_valid and not invalid:
        units = layout.units_of(conditions, file.columns, constants)
        if units.slip:
            raise file.place.error(units.slip, 1 if file.text is not None else None)
        remarks.extend(units.remarks)
        invalid.extend([units.contradiction] if units.contradiction else [])
    return Findings(tuple(invalid), tuple(remarks))


def check_own_clock(file: SampleFile, channel: str, info: ChannelInfo, period_s: float) -> Findings:
    """What is to be said of the samples of a channel on a clock of its own: they cost the channel, not the run.

    `DataError` for a time base that is none, and for times that are too short for the run's period.
    """
    t_s = file.columns["t_s"]
    step_s = _require_time(file, t_s)
    if short := _too_short(t_s, step_s, period_s):
        raise file.place.error(f"{short}; record longer, or remove the file")
    remarks = [
        *_time_base(t_s, step_s),
        *_missing(file, [channel]),
        *_saturated(file, {channel: info}, np.zeros_like(t_s)),
        *_impossible(file),
    ]
    return Findings(remarks=tuple(remarks))


def _require_columns(file: SampleFile, names: Sequence[str]) -> None:
    for name in names:
        if name in file.columns:
            continue
        line = 1 if file.text is not None else None
        # Only columns that no other requirement names: a rename must not open the next gap.
        near = difflib.get_close_matches(name, [c for c in file.columns if c not in names], n=1)
        mend = f"rename {near[0]}" if near else "add it"
        raise file.place.error(f"column {name} is missing; {mend} (there are {', '.join(file.columns)})", line)


def _require_time(file: SampleFile, t_s: FloatArray) -> float:
    """The median step [s], 0 for a single sample."""
    if not np.isfinite(t_s).all():
        at = int(np.argmin(np.isfinite(t_s)))
        raise file.error(f"t_s is {t_s[at]}; write the time of every sample", at)
    steps = np.diff(t_s)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0)) + 1
        raise file.error(
            f"time does not go on: t_s {t_s[at]:.9g} follows {t_s[at - 1]:.9g}; sort or repair the samples", at
        )
    step_s = float(np.median(steps)) if steps.size else 0.0
    if steps.size and not STEP_MIN_S <= step_s <= STEP_MAX_S:
        raise file.error(f"samples are {step_s:.4g} s apart, as no recorder takes them; write t_s in seconds", 0)
    return step_s


def _too_short(t_s: FloatArray, step_s: float, period_s: float) -> str | None:
    # n samples cover n steps: each stands for the step that follows it.
    duration_s = t_s[-1] - t_s[0] + step_s if t_s.size else 0.0
    # The margin is rounding of times written as decimal text.
    if t_s.size and duration_s >= period_s * (1 - 1e-6):
        return None
    if not t_s.size:
        return "no samples"
    return f"{duration_s:.6g} s is too short: one period takes {period_s:.6g} s"


def _time_base(t_s: FloatArray, step_s: float) -> list[str]:
    if t_s.size < 3:
        return []
    steps = np.diff(t_s)
    gaps = steps > GAP * step_s
    if gaps.any():
        # Rounded, since the clock jitters: a gap of 2.97 steps is two samples lost.
        lost = int(np.sum(np.rint(steps[gaps] / step_s) - 1))
        first = int(np.argmax(gaps))
        return [
            f"{int(gaps.sum())} gap{'s' if gaps.sum() > 1 else ''} in t_s, about {lost} samples, "
            f"first after {t_s[first]:.9g} s"
        ]
    # Against the whole time base as well as step by step: a slow drift has no single step that is wrong.
    even = np.linspace(t_s[0], t_s[-1], t_s.size)
    # The last sample has no step after it.
    uneven = np.append(np.abs(steps - step_s) > JITTER * step_s, False)
    uneven |= np.abs(t_s - even) > DRIFT * step_s
    if uneven.any():
        first = int(np.argmax(uneven))
        return [f"t_s is not equally spaced (median step {step_s:.9g} s), first at {t_s[first]:.9g} s"]
    return []


def _missing(file: SampleFile, names: Sequence[str]) -> list[str]:
    """Columns that miss the same samples, as telemetry that is lost does, are one finding."""
    alike: dict[bytes, list[str]] = {}
    for name in names:
        alike.setdefault(np.isfinite(file.columns[name]).tobytes(), []).append(name)
    return [
        remark
        for together in alike.values()
        for remark in _counted(file, ", ".join(together), ~np.isfinite(file.columns[together[0]]), "missing")
    ]


def _counted(file: SampleFile, name: str, bad: BoolArray, what: str) -> list[str]:
    """How many samples of a column, or of several alike, are `bad`, and where the first is; nothing where none is."""
    if not bad.any():
        return []
    return [f"{name}: {int(bad.sum())} of {bad.size} samples {what}, first in {file.where(int(np.argmax(bad)))}"]


def _wholly_missing(file: SampleFile, names: Sequence[str]) -> list[str]:
    return [f"{name}: no sample has a value" for name in names if not np.isfinite(file.columns[name]).any()]


def _moving(file: SampleFile) -> FloatArray:
    """1 where the platform turns; all 0 where nothing was said of it."""
    moving = file.columns.get("moving")
    if moving is None:
        return np.zeros_like(file.columns["t_s"])
    wrong = (moving != 0) & (moving != 1)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise file.error(f"moving is {moving[at]:g}; write 1 or 0", at)
    return moving


def _saturated(file: SampleFile, channels: Mapping[str, ChannelInfo], moving: FloatArray) -> list[str]:
    remarks: list[str] = []
    for name, channel in channels.items():
        if channel.full_scale is not None and name in file.columns:
            # While the platform turns gravity may saturate a sensor; those samples are not used.
            past = (np.abs(file.columns[name]) >= channel.full_scale) & (moving == 0)
            what = f"saturated (full scale {channel.full_scale:g} {channel.unit})"
            remarks += _counted(file, name, past, what)
    return remarks


def _impossible(file: SampleFile) -> list[str]:
    """Readings that their unit cannot have, such as a temperature below absolute zero."""
    remarks = []
    for name, values in file.columns.items():
        unit = unit_of_column(name)
        low, high = possible_range(unit)
        # NaN is neither below nor above: a missing value is not impossible.
        wrong = (values < low) | (values > high)
        if wrong.any():
            at = int(np.argmax(wrong))
            remarks.append(f"{name}: {values[at]:g} in {file.where(at)} can be no reading in {unit}")
    return remarks


def _rate(conditions: Mapping[str, Any], step_s: float) -> list[str]:
    """A sampling rate in runs.csv that the samples do not have."""
    of_samples = {
        "sample_rate_hz": 1 / step_s if step_s else math.nan,
        "sample_period_s": step_s if step_s else math.nan,
    }
    return [
        f"{name} is {conditions[name]:.6g}, the samples have {measured:.6g}"
        for name, measured in of_samples.items()
        if abs(conditions.get(name, math.nan) / measured - 1) > RATE_TOLERANCE
    ]
