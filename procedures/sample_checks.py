"""Samples that cannot be true, told from noise and from everything a sensor may really see.

A column of a run is a smooth course (the drive's harmonics, a drift, whatever is slow) with noise on it. Each sample
of what the harmonics leave is compared with the cubic through its four neighbours. The scale is the median absolute
deviation of the run's own distances, and the limit is where Gaussian noise gets once in `1 / FALSE_ALARM` columns: an
alarm by chance is rarer than 1e-6 per run. Coloured noise, lines of any frequency, and slow transients are nearer to
their neighbours than white noise of their size, so that they raise no alarm. A wrong digit, a lost sign and, because
the sine breaks there, a sample too many or too few show as a distance far beyond the noise. Encoder and lasers must
besides be sines to their end, and move at the same time.

Undetectable: a sample that is wrong by less than some ten sigma of its column's noise (twenty-five for the first and
the last one) or 1e-4 of its sine; a sample too many or too few where the sine changes by less than that from one
sample to the next, as that of a sensor near its null does, or at its turning points; records of fewer than `SMALLEST`
samples. There drivers have to count samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from rigctl.errors import ImplausibleSample
from rigctl.interfaces import Channel, FloatArray

FALSE_ALARM = 1e-8
"""Probability that Gaussian noise raises an alarm in a column."""
HARMONICS = 5
SMALLEST = 24
PUREST = 1e-5
"""Part of a sine below which nothing is said: no drive, guide or converter is purer."""
DECIMALS = 10
"""More decimals than instruments have."""
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
ROUNDED = 1e-12
"""Of a column's largest value: what arithmetic leaves."""
MAD_TO_SIGMA = 1.4826
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
        said = f"{instrument}: {self.channel}, sample {self.sample}: {self.why}"
        return ImplausibleSample(said, channel=self.channel, sample=self.sample, instrument=instrument)


@dataclass(frozen=True)
class Course:
    """The sine of a column: amplitude, phase of a cosine at time 0 [rad], what its harmonics and a drift leave.

    `purest`: less than this no instrument tells; `resolution`: the last digit of the column.
    """

    amplitude: float
    phase_rad: float
    residual: FloatArray
    purest: float
    resolution: float


def course(times_s: FloatArray, values: FloatArray, frequency_hz: float) -> Course | None:
    """The course of a column, fitted without samples that stand out; None where too few have a value."""
    known = np.isfinite(values)
    period_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else math.inf
    orders = min(HARMONICS, int(0.45 / (frequency_hz * period_s)))
    if orders < 1 or known.sum() < max(SMALLEST, 3 * (2 * orders + 2)):
        return None
    basis = _basis(times_s, frequency_hz, orders)
    weights = known.astype(np.float64)
    there = np.where(known, values, 0.0)
    for _ in range(4):
        weighted = basis * weights[:, np.newaxis]
        coefficients = np.linalg.solve(weighted.T @ basis, weighted.T @ there)
        residual = values - basis @ coefficients
        distance = np.abs(residual)
        near = known & (distance <= 8.0 * MAD_TO_SIGMA * np.median(distance[known]))
        if (near == (weights > 0.0)).all() or near.sum() < 0.9 * known.sum():
            break
        weights = near.astype(np.float64)
    cosine, sine = (float(each) for each in coefficients[2:4])
    amplitude, largest = math.hypot(cosine, sine), float(np.abs(there).max())
    purest = max(PUREST * amplitude, ROUNDED * largest)
    return Course(amplitude, math.atan2(-sine, cosine), residual, purest, resolution_of(values, ROUNDED * largest))


def resolution_of(values: FloatArray, least: float) -> float:
    """The last decimal digit of a column, or the smallest difference of two values, `least` at least; 0 for none."""
    known = values[np.isfinite(values)]
    for decimals in range(DECIMALS):
        if (np.abs(known - np.round(known, decimals)) <= least).all():
            return 10.0**-decimals
    steps = np.diff(np.unique(known))
    steps = steps[steps > least]
    return float(steps.min()) if len(steps) else 0.0


def _basis(times_s: FloatArray, frequency_hz: float, orders: int) -> FloatArray:
    """Offset, drift, and cosine and sine of each harmonic, shape (n, 2 + 2 orders)."""
    drift = (times_s - times_s.mean()) / np.ptp(times_s)
    phases = [2.0 * math.pi * order * frequency_hz * times_s for order in range(1, orders + 1)]
    waves = [wave(phase) for phase in phases for wave in (np.cos, np.sin)]
    return np.stack([np.ones_like(times_s), drift, *waves], axis=1)


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
    `resolution`: the last digit of the samples, whose rounding adds to any noise. What moves the samples nearby as
    well is a transient.
    """
    if len(values) < SMALLEST:
        return None
    for kernel, looked_at in ((NEIGHBOURS, slice(None)), (END, [0, -1])):
        distances = np.abs(np.convolve(values, kernel, mode="valid"))
        rounding = 0.5 * resolution * float(np.abs(kernel).sum())
        allowed = _allowed(distances, purest, false_alarm) + rounding
        seen = np.zeros_like(distances)
        seen[looked_at] = np.nan_to_num(distances[looked_at])
        place = int(np.argmax(seen))
        allowed = max(allowed, TRANSIENT * _nearby(distances, place))
        if seen[place] > allowed:
            near = values[place : place + 5]
            return place + int(np.nanargmax(np.abs(near - np.nanmedian(near)))), float(seen[place]), allowed
    return None


def _nearby(distances: FloatArray, place: int) -> float:
    """The largest distance beside those that one sample, or a break, makes."""
    aside = [*distances[max(place - 8, 0) : max(place - 2, 0)], *distances[place + 3 : place + 9]]
    return float(np.nanmax(np.nan_to_num(aside), initial=0.0))


def _allowed(distances: FloatArray, purest: float, false_alarm: float) -> float:
    """The largest distance that noise makes of these."""
    known = distances[np.isfinite(distances)]
    if len(known) < SMALLEST // 2:
        return math.inf
    sigma = max(MAD_TO_SIGMA * float(np.median(known)), purest)
    return sigma * sigmas_allowed(len(known), false_alarm)


def shifted_from(times_s: FloatArray, values: FloatArray, frequency_hz: float) -> int | None:
    """The sample from which on all come one too early or too late, where that explains what the sine leaves.

    A step of one sample in the sine's time, at each sample in turn, is regressed on the residual beside the sine.
    """
    known = np.isfinite(values)
    basis, values = _basis(times_s[known], frequency_hz, 1), values[known]
    normal = basis.T @ basis
    coefficients = np.linalg.solve(normal, basis.T @ values)
    residual = values - basis @ coefficients
    period_s = float(times_s[1] - times_s[0])
    _, _, cosine, sine = coefficients
    step = 2.0 * math.pi * frequency_hz * period_s * (sine * basis[:, 2] - cosine * basis[:, 3])
    along = _from_each_on(step[:, np.newaxis] * basis)
    projected = np.einsum("ij,ji->i", along, np.linalg.solve(normal, along.T))
    size = _from_each_on(step**2) - projected
    usable = size > 1e-9 * float(step @ step)
    if not usable.any():
        return None
    shift = np.divide(_from_each_on(step * residual), size, out=np.zeros_like(size), where=usable)
    explained = shift**2 * size
    place = int(np.argmax(explained))
    whole = abs(abs(float(shift[place])) - 1.0) < SHIFT_WITHIN
    return (
        int(np.flatnonzero(known)[place])
        if whole and explained[place] > SHIFT_EXPLAINS * residual @ residual
        else None
    )


def _from_each_on(values: FloatArray) -> FloatArray:
    """Sums from each row to the last."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def encoder_flaw(
    channel: str, times_s: FloatArray, position_mm: FloatArray, frequency_hz: float, acceleration_mm_s2: float
) -> Flaw | None:
    """Against the sine that was commanded, and the largest acceleration of the drive."""
    if len(times_s) > 2:
        bends = np.abs(np.diff(position_mm, 2)) / np.diff(times_s)[0] ** 2
        if bends.max() > 2.0 * acceleration_mm_s2:
            sample = int(np.argmax(bends)) + 1
            why = f"{position_mm[sample]:g} mm: no drive of {acceleration_mm_s2:g} mm/s2 gets there"
            return Flaw(channel, sample, why)
    seen = course(times_s, position_mm, frequency_hz)
    if seen is None:
        return None
    if flaw := _odd(channel, seen, "mm") or _shift(channel, times_s, position_mm, frequency_hz):
        return flaw
    rms_mm = float(np.sqrt(np.mean(seen.residual**2)))
    if rms_mm > SINE_WITHIN * seen.amplitude:
        sample = int(np.argmax(np.abs(seen.residual)))
        return Flaw(
            channel,
            sample,
            f"the encoder leaves the sine by {rms_mm:.3g} mm rms, {seen.residual[sample]:.3g} mm here",
        )
    return None


def laser_flaw(
    channel: str,
    times_s: FloatArray,
    laser_mm: FloatArray,
    position_mm: FloatArray,
    frequency_hz: float,
    latency_s: float,
) -> Flaw | None:
    """Against its neighbours, and against the encoder: it shows the stage's motion, `latency_s` later at most.

    Targets lost (NaN) are no flaw.
    """
    seen, stage = course(times_s, laser_mm, frequency_hz), course(times_s, position_mm, frequency_hz)
    if seen is None or stage is None:
        return None
    if flaw := _odd(channel, seen, "mm") or _shift(channel, times_s, laser_mm, frequency_hz):
        return flaw
    if seen.amplitude > FARTHEST * stage.amplitude + seen.purest + seen.resolution:
        said = f"moves {seen.amplitude:.3g} mm, the encoder {stage.amplitude:.3g} mm; is it set to micrometres?"
        return Flaw(channel, 0, said)
    period_s = float(np.diff(times_s)[0])
    w = 2.0 * math.pi * frequency_hz
    late_rad = math.remainder(seen.phase_rad - stage.phase_rad - w * latency_s, math.pi)
    known = seen.residual[np.isfinite(seen.residual)]
    noise_mm = 10.0 * math.sqrt(2.0 / len(known)) * float(np.std(known)) + seen.resolution + seen.purest
    noise_rad = noise_mm / max(seen.amplitude, noise_mm, np.finfo(float).tiny)
    if abs(late_rad) > w * (0.5 * period_s + LATENCY_S) + 2.0 * noise_rad:
        return Flaw(
            channel, 0, f"moves {1e3 * late_rad / w:+.3g} ms away from the encoder; samples are {period_s:g} s apart"
        )
    return None


def voltage_flaw(channel: Channel, times_s: FloatArray, volts: FloatArray, frequency_hz: float) -> Flaw | None:
    """Against its range, and against its neighbours where it is not saturated."""
    range_v = channel.full_scale
    if flaw := _beyond(channel, volts):
        return flaw
    if not np.isfinite(volts).all() or (range_v is not None and np.abs(volts).max() >= range_v):
        return None
    seen = course(times_s, volts, frequency_hz)
    return None if seen is None else _odd(channel.name, seen, "V")


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
    beyond = np.abs(np.nan_to_num(volts)) > OVER_RANGE * range_v
    if not beyond.any():
        return None
    sample = int(np.argmax(beyond))
    return Flaw(channel.name, sample, f"{volts[sample]:g} V is beyond what a range of {range_v:g} V can show")


def _odd(channel: str, seen: Course, unit: str) -> Flaw | None:
    odd = odd_sample(seen.residual, seen.purest, seen.resolution)
    return None if odd is None else Flaw(channel, odd[0], _away(odd, unit))


def _away(odd: tuple[int, float, float], unit: str) -> str:
    return f"{odd[1]:.3g} {unit} away from its neighbours, {odd[2]:.2g} {unit} would be noise"


def _shift(channel: str, times_s: FloatArray, values: FloatArray, frequency_hz: float) -> Flaw | None:
    sample = shifted_from(times_s, values, frequency_hz)
    return None if sample is None else Flaw(channel, sample, "from here on samples come one too early or too late")
