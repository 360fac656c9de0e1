"""Samples that cannot be true, told from noise and from everything a sensor may really see.

A column of a run is a smooth course (the drive's harmonics, a drift, whatever is slow) with noise on it. Each sample
of what the harmonics leave is compared with the cubic through its four neighbours. The scale is the median absolute
deviation of the run's own distances, and the limit is where Gaussian noise gets once in `1 / FALSE_ALARM` columns: an
alarm by chance is rarer than 1e-6 per run. Coloured noise, lines of any frequency, and slow transients are nearer to
their neighbours than white noise of their size, so that they raise no alarm. A wrong digit, a lost sign and, because
the sine breaks there, a sample too many or too few show as a distance far beyond the noise. Encoder and lasers must
besides be sines to their end, and move at the same time.

Undetectable: a sample that is wrong by less than some ten sigma of its column's noise (twenty-five for the first and
the last one), by less than five to eight of its last digits (eight to thirteen) or 1e-4 of its sine; a sample too
many or too few where the sine changes by less than that from one sample to the next, as that of a sensor near its
null does, or at its turning points; records of fewer than `SMALLEST` samples. There drivers have to count samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from procedures.sine_fit import MAD_TO_SIGMA, ROUNDED, SMALLEST, Column, Course, median_of, resolution_of
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ImplausibleSample
from rigctl.core.interfaces import Channel

FALSE_ALARM = 1e-8
"""Probability that Gaussian noise raises an alarm in a column."""
SINE_WITHIN = 0.01
"""Part of its amplitude that the encoder's residual may have: drives follow to a thousandth."""
LATENCY_S = 5e-3
"""How well latencies of instruments are known."""
FARTHEST = 2.0
"""Times the stage's motion that a laser sees of it: more than any tilt of a head makes, less than another unit."""
OVER_RANGE = 1.25
"""Of its range is more than a voltmeter shows: beyond 1.2 it reports an overload."""

SHIFT_WITHIN, SHIFT_EXPLAINS = 0.25, 0.9
"""A shift is one sample but for so much, and explains so much of the variance of what the harmonics leave."""

TRANSIENT = 3.0
"""Times as far as the samples aside is one by itself."""
NEIGHBOURS = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""A sample less the cubic through its four neighbours."""
END = np.array([1.0, -2.0, 1.0])
"""A record's first or last sample less the line through the two next to it."""


@dataclass(frozen=True)
class Flaw:
    """What cannot be true, in which column, at which sample (from 0)."""

    channel: str
    sample: int
    why: str

    def of(self, instrument: str) -> ImplausibleSample:
        """As an error of the instrument whose column it is."""
        message = f"{instrument}: {self.channel}, sample {self.sample}: {self.why}"
        return ImplausibleSample(message, channel=self.channel, sample=self.sample, instrument=instrument)


def sigmas_allowed(samples: int, false_alarm: float = FALSE_ALARM) -> float:
    """How far noise gets once in `1 / false_alarm` columns of so many samples.

    The second factor is for the scale, which few samples tell only roughly.
    """
    return float(-ndtri(false_alarm / (2.0 * samples)) * (1.0 + 6.0 / math.sqrt(samples)))


def odd_sample(
    values: FloatArray, purest: float = 0.0, resolution: float = 0.0, false_alarm: float = FALSE_ALARM
) -> tuple[int, float, float] | None:
    """The sample that noise cannot have put where it is: its number, its distance and the largest one allowed.

    `values` are slow but for their noise, shape (n,); NaN are gaps. `purest`: a scale below which nothing is said.
    `resolution`: the last digit of the samples, whose rounding adds to any noise, and hides noise of less than half a
    digit from the median. What moves the samples nearby as well is a transient.
    """
    if len(values) < SMALLEST:
        return None
    for kernel, looked_at in ((NEIGHBOURS, slice(None)), (END, [0, -1])):
        distances = np.abs(np.convolve(values, kernel, mode="valid"))
        # Each of the samples that a kernel weighs may be off by half a digit.
        rounding = resolution * math.sqrt(float(kernel @ kernel) / 12.0)
        allowed = _allowed(distances, purest, rounding, false_alarm) + 0.5 * resolution * float(np.abs(kernel).sum())
        seen = np.zeros_like(distances)
        seen[looked_at] = distances[looked_at]
        seen[np.isnan(seen)] = 0.0
        place = int(np.argmax(seen))
        if seen[place] > allowed and seen[place] > (aside := TRANSIENT * _nearby(distances, place)):
            # The kernel tells that one of these is odd; the one farthest from their median is it.
            near = values[place : place + 5]
            sample = place + int(np.nanargmax(np.abs(near - np.nanmedian(near))))
            return sample, float(seen[place]), max(allowed, aside)
    return None


def _nearby(distances: FloatArray, place: int) -> float:
    """The largest distance beside those that one sample, or a break, makes."""
    # Without two to either side, which share the odd sample through the kernel.
    aside = [*distances[max(place - 8, 0) : max(place - 2, 0)], *distances[place + 3 : place + 9]]
    return float(np.nanmax(np.nan_to_num(aside), initial=0.0))


def _allowed(distances: FloatArray, purest: float, rounding: float, false_alarm: float) -> float:
    """The largest distance that noise makes of these, `rounding` being the standard deviation of their rounding."""
    known = distances[np.isfinite(distances)]
    if len(known) < SMALLEST // 2:
        return math.inf
    # A column without noise has no scale of its own; where most samples are alike, so has one of little noise.
    sigma = math.hypot(max(MAD_TO_SIGMA * median_of(known), purest), rounding)
    return sigma * sigmas_allowed(len(known), false_alarm)


def shifted_from(column: Column) -> int | None:
    """The sample from which on all come one too early or too late, where that explains what the sine leaves.

    A step of one sample in the sine's time, at each sample in turn, is regressed on the residual beside the sine.
    """
    sine, known = column.sine, column.known
    coefficients = sine.fit(column.values, known, 4)
    # Offset, drift and the fundamental: what a shift in time changes.
    basis, values = sine.waves[:4], column.values
    if not known.all():
        basis, values = basis[:, known], values[known]
    residual = values - coefficients @ basis
    # The derivative of the sine times one sample period: what a shift by one sample adds.
    step = (
        2.0 * math.pi * sine.frequency_hz * sine.period_s * (coefficients[3] * basis[2] - coefficients[2] * basis[3])
    )
    along = _from_each_on(step * basis)
    # What the fit of the sine takes off of such a step.
    projected = (along * np.linalg.solve(basis @ basis.T, along)).sum(axis=0)
    size = _from_each_on(step**2) - projected
    # Near the end a step is as good as part of the sine: nothing can be said.
    usable = size > 1e-9 * float(step @ step)
    if not usable.any():
        return None
    shift = np.divide(_from_each_on(step * residual), size, out=np.zeros_like(size), where=usable)
    explained = shift**2 * size
    place = int(np.argmax(explained))
    # Samples are lost or doubled as a whole; another size is another cause.
    is_whole = abs(abs(float(shift[place])) - 1.0) < SHIFT_WITHIN
    return (
        int(np.flatnonzero(known)[place])
        if is_whole and explained[place] > SHIFT_EXPLAINS * residual @ residual
        else None
    )


def _from_each_on(values: FloatArray) -> FloatArray:
    """Sums from each sample to the last."""
    return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]


def encoder_flaw(column: Column, acceleration_mm_s2: float) -> Flaw | None:
    """Against the sine that was commanded, and the largest acceleration of the drive."""
    position_mm = column.values
    if len(position_mm) > 2:
        # Second differences over the square of the period are accelerations.
        bends = np.abs(np.diff(position_mm, 2)) / column.sine.period_s**2
        if bends.max() > 2.0 * acceleration_mm_s2:
            sample = int(np.argmax(bends)) + 1
            why = f"{position_mm[sample]:g} mm: no drive of {acceleration_mm_s2:g} mm/s2 gets there"
            return Flaw(column.channel, sample, why)
    course = column.course
    if course is None:
        return None
    if flaw := _odd(column, course, "mm") or _shift(column):
        return flaw
    rms_mm = float(np.sqrt(np.mean(course.residual**2)))
    if rms_mm > SINE_WITHIN * course.amplitude:
        sample = int(np.argmax(np.abs(course.residual)))
        return Flaw(
            column.channel,
            sample,
            f"the encoder leaves the sine by {rms_mm:.3g} mm rms, {course.residual[sample]:.3g} mm here",
        )
    return None


def laser_flaw(column: Column, position: Column, latency_s: float) -> Flaw | None:
    """Against its neighbours, and against the encoder: it shows the stage's motion, `latency_s` later at most.

    Targets lost (NaN) are no flaw.
    """
    seen, stage = column.course, position.course
    if seen is None or stage is None:
        return None
    if flaw := _odd(column, seen, "mm") or _shift(column) or _moves_too_far(column, seen, stage):
        return flaw
    period_s = column.sine.period_s
    w = 2.0 * math.pi * column.sine.frequency_hz
    # Modulo half a turn: a head on the other side sees the motion with the other sign.
    late_rad = math.remainder(seen.phase_rad - stage.phase_rad - w * latency_s, math.pi)
    # Edges may be taken a whole sample early or late, which is caught from half a period on.
    beyond_rad = abs(late_rad) - w * (0.5 * period_s + LATENCY_S)
    if beyond_rad > 0.0 and beyond_rad > 2.0 * _phase_noise_rad(column, seen):
        why = f"moves {1e3 * late_rad / w:+.3g} ms away from the encoder; samples are {period_s:g} s apart"
        return Flaw(column.channel, 0, why)
    return None


def free_laser_flaw(column: Column, position: Column) -> Flaw | None:
    """As `laser_flaw`, of a head on a clock of its own: how late it is says nothing, nor how that changes."""
    seen, stage = column.course, position.course
    if seen is None or stage is None:
        return None
    return _odd(column, seen, "mm") or _moves_too_far(column, seen, stage)


def _moves_too_far(column: Column, seen: Course, stage: Course) -> Flaw | None:
    largest_mm = FARTHEST * stage.amplitude + seen.purest
    if seen.amplitude <= largest_mm or seen.amplitude <= largest_mm + column.resolution:
        return None
    why = f"moves {seen.amplitude:.3g} mm, the encoder {stage.amplitude:.3g} mm; is it set to micrometres?"
    return Flaw(column.channel, 0, why)


def _phase_noise_rad(column: Column, seen: Course) -> float:
    """Ten sigma of the phase of the sine."""
    known = seen.residual[column.known]
    noise_mm = 10.0 * math.sqrt(2.0 / len(known)) * float(np.std(known)) + column.resolution + seen.purest
    return noise_mm / max(seen.amplitude, noise_mm, np.finfo(float).tiny)


def voltage_flaw(channel: Channel, column: Column) -> Flaw | None:
    """Against its range, and against its neighbours where it is not saturated."""
    volts, range_v = column.values, channel.full_scale
    if flaw := _beyond(channel, volts):
        return flaw
    # A clipped sine is no sine, and its corners are no wrong samples.
    if not column.known.all() or (range_v is not None and np.abs(volts).max() >= range_v):
        return None
    seen = column.course
    return None if seen is None else _odd(column, seen, "V")


def voltages_flaw(channel: Channel, volts: FloatArray) -> Flaw | None:
    """As `voltage_flaw`, of a stretch without a sine; NaN are gaps."""
    known = volts[np.isfinite(volts)]
    if flaw := _beyond(channel, volts):
        return flaw
    if not len(known) or (channel.full_scale is not None and np.abs(known).max() >= channel.full_scale):
        return None
    rounded = ROUNDED * float(np.abs(known).max())
    odd = odd_sample(volts - known.mean(), rounded, resolution_of(volts, rounded))
    return None if odd is None else Flaw(channel.name, odd[0], _away(odd, "V"))


def _beyond(channel: Channel, volts: FloatArray) -> Flaw | None:
    range_v = math.inf if channel.full_scale is None else channel.full_scale
    beyond = np.abs(volts) > OVER_RANGE * range_v  # NaN is not
    if not beyond.any():
        return None
    sample = int(np.argmax(beyond))
    return Flaw(channel.name, sample, f"{volts[sample]:g} V is beyond what a range of {range_v:g} V can show")


def _odd(column: Column, seen: Course, unit: str) -> Flaw | None:
    """The last digit only widens what is allowed: it is looked for when something stands out without it."""
    odd = odd_sample(seen.residual, seen.purest) and odd_sample(seen.residual, seen.purest, column.resolution)
    return None if odd is None else Flaw(column.channel, odd[0], _away(odd, unit))


def _away(odd: tuple[int, float, float], unit: str) -> str:
    return f"{odd[1]:.3g} {unit} away from its neighbours, {odd[2]:.2g} {unit} would be noise"


def _shift(column: Column) -> Flaw | None:
    sample = shifted_from(column)
    why = "from here on samples come one too early or too late"
    return None if sample is None else Flaw(column.channel, sample, why)
