"""From samples to observables: one sine fit per run, noise pooled over the runs of an axis in a configuration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigctl.analysis.clock_fit import ClockFit, fit_on_own_clock
from rigctl.analysis.frequency import find_frequency
from rigctl.analysis.noise import NoisePool, Spectrum, pooled_psd, spectrum
from rigctl.analysis.resolution import amplitude_floor
from rigctl.analysis.sine_fit import HarmonicBasis, HarmonicFit
from rigctl.campaign.recording import ChannelInfo, on_rig_time, time_column
from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, Amplitudes, RunObservables

STAGE, ACCEL = "stage_x_mm", "accel_v"
LASER_PREFIX = "laser_"
MM = 1e-3
NOISE_DOF = 40.0
"""Degrees of freedom sought for the noise at a line: known to 22 %, from a band of 0.1 Hz in a minute's record."""

_MIN_KEPT_SAMPLES = 0.5
_NO_NOISE = Spectrum(np.zeros(0), np.zeros(0), np.zeros(0))
_GIVEN = {
    *("axis", "configuration", "mounting", "theta_deg", "approach", "frequency_hz", "amplitude_mm"),
    *("temperature_c", "start_s", "valid", "reason"),
}


@dataclass(frozen=True)
class ReducedChannel:
    """Referred amplitudes of one channel (index 0 the mean) and the spectrum of what the sine fit left.

    `variance_factor` are their variances in units of S / T (of the mean: S / 2T), `floor` the variances that the
    channel's resolution leaves at least, both of shape (HARMONICS + 1,); `lines` the amplitudes of fitted lines.
    `clock` was fitted to a channel on a clock of its own.
    """

    value: ComplexArray
    noise: Spectrum
    variance_factor: FloatArray
    floor: FloatArray
    lines: ComplexArray
    clock: ClockFit | None = None


@dataclass(frozen=True)
class Residuals:
    """What the fit left of one channel's samples, at the times of its basis."""

    basis: HarmonicBasis
    values: FloatArray


@dataclass(frozen=True)
class ReducedRun:
    """One run after its sine fit; sigmas need the other runs too."""

    run_id: str
    conditions: Mapping[str, Any]
    frequency_hz: float
    duration_s: float
    motion_m: ComplexArray
    channels: Mapping[str, ReducedChannel]

    def without_spectra(self) -> ReducedRun:
        """The same, small: enough to be observed once its spectra are in the pool."""
        small = {name: replace(channel, noise=_NO_NOISE) for name, channel in self.channels.items()}
        return replace(self, channels=small)


def reduce_run(
    run_id: str,
    conditions: Mapping[str, Any],
    samples: Mapping[str, FloatArray],
    lines_hz: Sequence[float] = (),
    channels: Mapping[str, ChannelInfo] | None = None,
) -> ReducedRun:
    """Fit the drive's harmonics, and lines of known frequency, to every channel of one run.

    Samples without a value are left out. `channels` says how late each channel is, which is taken out of its phases,
    and how well the times are known of those that have a clock of their own. Raises `DataError`, naming the run, when
    the record cannot be fitted.
    """
    return reduce_with_residuals(run_id, conditions, samples, lines_hz, channels)[0]


def reduce_with_residuals(
    run_id: str,
    conditions: Mapping[str, Any],
    samples: Mapping[str, FloatArray],
    lines_hz: Sequence[float],
    channels: Mapping[str, ChannelInfo] | None = None,
) -> tuple[ReducedRun, Residuals]:
    """As `reduce_run`, and what the fit left of the accelerometer's samples."""
    try:
        seen = _seen(samples)
        # From the stage, which stands out of its noise farthest; the other channels are fitted at its frequency.
        basis, stage = find_frequency(
            samples["t_s"][seen],
            MM * samples[STAGE][seen],
            float(conditions["frequency_hz"]),
            harmonics=HARMONICS,
            lines_hz=tuple(lines_hz),
        )
        reference = complex(stage.amplitudes[0])
        accel = _channel(basis, samples[ACCEL][seen], reference, len(lines_hz))
        if accel is None:
            raise DataError(f"{ACCEL}: more than half of the samples are missing")  # noqa: TRY301
    except (DataError, KeyError, ValueError) as error:
        cause = f"column {error} is missing" if isinstance(error, KeyError) else error
        raise DataError(f"run {run_id}: {cause}") from error
    reduced, residuals = {ACCEL: accel[0]}, accel[1]
    for name, column in on_rig_time(samples).items():
        if name.startswith(LASER_PREFIX):
            laser = _channel(basis, MM * column[seen], reference, len(lines_hz))
            if laser is not None:
                reduced[name] = laser[0]
    reduced = {name: _in_time(each, basis.frequency_hz, _late_s(name, channels)) for name, each in reduced.items()}
    for name in samples:
        if name.startswith(LASER_PREFIX) and (own_s := samples.get(time_column(name))) is not None:
            clock_u_s = channels[name].clock_u_s if channels and name in channels else None
            free = _free_channel(own_s, MM * samples[name], basis.frequency_hz, reference, clock_u_s, len(lines_hz))
            if free is not None:
                reduced[name] = free
    order = np.arange(1, HARMONICS + 1)
    # Back from "in phase with x" to x = A sin(w t): X_1 = -iA.
    motion_m = stage.amplitudes_referred_to(reference) * (-1j) ** order
    return ReducedRun(run_id, dict(conditions), basis.frequency_hz, basis.duration_s, motion_m, reduced), residuals


def observables(runs: Sequence[ReducedRun], *, harmonics: int = HARMONICS) -> list[RunObservables]:
    """Observables of all runs, in their order, with the noise of each axis and configuration pooled:
    beside a bump of the ground's noise the runs driven at other frequencies tell it best.

    Sigmas are worked out up to `harmonics` and NaN beyond: a null search needs the first only. Raises `DataError`,
    naming the run, where there is nothing to take the noise from.
    """
    noise = PooledNoise()
    for run in runs:
        noise.add(run)
    return [noise.observed(run, harmonics) for run in runs]


def noise_density(runs: Iterable[ReducedRun], frequency_hz: float) -> float:
    """One-sided density of the accelerometer's output noise at a frequency, pooled over runs [V^2/Hz]."""
    return pooled_psd(run.channels[ACCEL].noise for run in runs).level(frequency_hz, target_dof=NOISE_DOF).psd


class PooledNoise:
    """The noise of each channel of each axis in a configuration; runs are added first, then observed."""

    def __init__(self) -> None:
        self._pools: dict[tuple[Any, ...], NoisePool] = {}
        self._spectra: dict[tuple[Any, ...], Spectrum] = {}
        self._levels: dict[tuple[Any, ...], tuple[float, float]] = {}
        self._mean_variances: dict[tuple[Any, ...], float] = {}

    def add(self, run: ReducedRun) -> None:
        """Take in what a run says of the noise."""
        for name, channel in run.channels.items():
            self._pools.setdefault((*pool_of(run), name), NoisePool()).add(channel.noise)

    def observed(self, run: ReducedRun, harmonics: int = HARMONICS) -> RunObservables:
        """A run's observables; its channels' spectra are not looked at, they are in the pool."""
        try:
            channels = {name: self._amplitudes(run, name, harmonics) for name in run.channels}
        except DataError as error:
            raise DataError(f"run {run.run_id}: {error}") from error
        given = run.conditions
        return RunObservables(
            run_id=run.run_id,
            axis=str(given["axis"]),
            configuration=str(given["configuration"]),
            mounting=int(given["mounting"]),
            theta_rad=math.radians(float(given["theta_deg"])),
            approach=_number(given.get("approach"), missing=0.0),
            frequency_hz=run.frequency_hz,
            temperature_c=_number(given.get("temperature_c")),
            start_s=_number(given.get("start_s")),
            duration_s=run.duration_s,
            motion_m=run.motion_m,
            accel_v=channels[ACCEL],
            lasers_m={name: each for name, each in channels.items() if name != ACCEL},
            faces={head: str(given[key]) for head in run.channels if given.get(key := face_column(head))},
            extra={name: float(value) for name, value in given.items() if _is_extra(name, value)},
        )

    def _amplitudes(self, run: ReducedRun, name: str, harmonics: int) -> Amplitudes:
        channel = run.channels[name]
        variance, dof = np.full(HARMONICS + 1, np.nan), np.zeros(HARMONICS + 1)
        variance[0] = self._mean(run, name)
        for h in range(1, harmonics + 1):
            psd, dof[h] = self._level(run, name, h * run.frequency_hz)
            # Of the one-sided density S: S / T in phase and S / T in quadrature.
            variance[h] = psd / run.duration_s
        # A record without whole periods knows an amplitude a little less well than S / T.
        variance *= channel.variance_factor
        # Noise below a step of the converter may leave no trace in the residuals, but not in the amplitudes.
        sigma = np.sqrt(np.maximum(variance, channel.floor))
        if channel.clock is None:
            return Amplitudes(channel.value, sigma, dof, channel.lines)
        return Amplitudes(
            channel.value, _with_clock(sigma, channel, run.frequency_hz), dof, channel.lines, channel.clock
        )

    def _level(self, run: ReducedRun, name: str, frequency_hz: float) -> tuple[float, float]:
        # Fitted frequencies differ in their last digits, the noise beside them does not.
        key = (*pool_of(run), name, round(frequency_hz, 4))
        if key not in self._levels:
            level = self._spectrum(run, name).level(frequency_hz, target_dof=NOISE_DOF)
            self._levels[key] = level.psd, level.dof
        return self._levels[key]

    def _mean(self, run: ReducedRun, name: str) -> float:
        key = (*pool_of(run), name, round(run.duration_s, 3))
        if key not in self._mean_variances:
            self._mean_variances[key] = self._spectrum(run, name).mean_variance(run.duration_s)
        return self._mean_variances[key]

    def _spectrum(self, run: ReducedRun, name: str) -> Spectrum:
        key = (*pool_of(run), name)
        if key not in self._spectra:
            self._spectra[key] = self._pools[key].spectrum
        return self._spectra[key]


def pool_of(run: ReducedRun) -> tuple[str, str]:
    """Which runs share their noise: those of an axis in a configuration."""
    return str(run.conditions["axis"]), str(run.conditions["configuration"])


def face_column(head: str) -> str:
    """The column of runs.csv that says which face a head looks at: laser_1_mm -> laser_1_face."""
    return f"{head.removesuffix('_mm')}_face"


def _seen(samples: Mapping[str, FloatArray]) -> slice | BoolArray:
    """The samples that have a time and a place."""
    whole = np.isfinite(samples[STAGE]) & np.isfinite(samples["t_s"])
    if whole.all():
        return slice(None)
    if whole.mean() < _MIN_KEPT_SAMPLES:
        raise DataError(f"{STAGE}: more than half of the samples are missing")
    return np.asarray(whole)


def _channel(
    basis: HarmonicBasis, column: FloatArray, reference: complex, lines: int
) -> tuple[ReducedChannel, Residuals] | None:
    """A channel, without the samples that have no value; None when too few are left."""
    seen = np.isfinite(column)
    # A channel with gaps of its own has a basis of its own: what is orthogonal on all samples is not on these.
    if not seen.all():
        if seen.mean() < _MIN_KEPT_SAMPLES:
            return None
        try:
            basis = HarmonicBasis(basis.t_s[seen], basis.frequency_hz, basis.harmonics, lines_hz=basis.lines_hz)
        except DataError:
            return None
        column = column[seen]
    fit = basis.fit(column)
    line_amplitudes = fit.line_amplitudes if len(basis.lines_hz) == lines else np.full(lines, np.nan + 0j)
    reduced = _reduced(basis, fit, column, fit.amplitudes_referred_to(reference), line_amplitudes)
    return reduced, Residuals(basis, fit.residuals)


def _late_s(name: str, channels: Mapping[str, ChannelInfo] | None) -> float:
    """How much later than the encoder's samples those of a channel were taken, as far as it is said."""

    def latency_s(of: str) -> float:
        channel = channels.get(of) if channels else None
        return (channel.latency_s if channel else None) or 0.0

    return latency_s(name) - latency_s(STAGE)


def _in_time(channel: ReducedChannel, frequency_hz: float, late_s: float) -> ReducedChannel:
    """A channel as if its samples had been taken `late_s` earlier."""
    turns = np.exp(-2j * math.pi * frequency_hz * late_s * np.arange(len(channel.value)))
    return channel if late_s == 0.0 else replace(channel, value=channel.value * turns)


def _reduced(
    basis: HarmonicBasis, fit: HarmonicFit, column: FloatArray, amplitudes: ComplexArray, lines: ComplexArray
) -> ReducedChannel:
    value = np.concatenate([[complex(fit.dc)], amplitudes])
    factor = np.concatenate([[1.0], basis.variance_factors])
    noise = spectrum(fit.residuals, basis).compact(basis.duration_s)
    return ReducedChannel(value, noise, factor, amplitude_floor(column, fit.residuals, basis), lines)


def _free_channel(
    t_s: FloatArray, column: FloatArray, frequency_hz: float, reference: complex, clock_u_s: float | None, lines: int
) -> ReducedChannel | None:
    """A channel on its own clock, without the samples that have no value; None when too few are left.

    Lines are not fitted in it.
    """
    seen = np.isfinite(column) & np.isfinite(t_s)
    if seen.sum() <= _MIN_KEPT_SAMPLES * seen.size:
        return None
    try:
        found = fit_on_own_clock(t_s[seen], column[seen], frequency_hz, reference, HARMONICS, clock_u_s)
    except DataError:
        return None
    none = np.full(lines, np.nan + 0j)
    return replace(_reduced(found.basis, found.fit, column[seen], found.amplitudes, none), clock=found.clock)


def _with_clock(sigma: FloatArray, channel: ReducedChannel, frequency_hz: float) -> FloatArray:
    """Standard uncertainties of amplitudes that were turned by an offset which is itself uncertain."""
    assert channel.clock is not None
    turned_u_rad = 2.0 * math.pi * frequency_hz * channel.clock.offset_u_s * np.arange(len(sigma))
    moved = np.abs(channel.value) * turned_u_rad
    # Turning moves the fundamental's quadrature, which is used up; its in-phase part only where they are not parted.
    moved[1] = abs(channel.value[1].imag) * turned_u_rad[1]
    return np.asarray(np.hypot(sigma, moved))


def _is_extra(name: str, value: Any) -> bool:
    return name not in _GIVEN and isinstance(value, int | float) and not isinstance(value, bool)


def _number(value: Any, missing: float = math.nan) -> float:
    number = math.nan if value in (None, "") else float(value)
    return missing if math.isnan(number) else number
