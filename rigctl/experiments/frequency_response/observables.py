"""A run as one complex sensitivity: output over acceleration at the drive's frequency, with its noise.

Method 3 of ISO 16063-11 by least squares: cosine, sine, offset and drift, and the drive's harmonics beside them, are
fitted to every channel at the frequency that the encoder shows. Phases are referred to the displacement, time is
counted from its positive maximum. With displacement X and output V the acceleration is -w^2 X, and S = V / (-w^2 X).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigctl.analysis.clock_fit import ClockFit, fit_on_own_clock, sign_is_known
from rigctl.analysis.frequency import find_frequency
from rigctl.analysis.noise import NoisePool, Spectrum, spectrum
from rigctl.analysis.resolution import amplitude_floor
from rigctl.analysis.sine_fit import HarmonicBasis, HarmonicFit
from rigctl.campaign.recording import ChannelInfo, Header, RunSource, time_column
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.frequency_response.columns import ACCEL, STAGE, is_head

HARMONICS = 3
NOISE_DOF = 40.0
_FOLLOWS = 1.5
"""A head that shows the motion larger or smaller than the encoder by this factor does not look at the carriage."""

_AS_ASKED = 0.01
"""Relative: a drive that is farther from the frequency that was asked for is one at another frequency."""

_MM = 1e-3


@dataclass(frozen=True)
class Line:
    """One channel at the drive's frequency, SI: amplitude, spectrum of what the fit left, least variance of a part.

    `variance_factor` is the variance of a part in units of S / T. `clock` was fitted to a channel on its own clock.
    """

    value: complex
    noise: Spectrum
    variance_factor: float
    floor: float
    clock: ClockFit | None = None


@dataclass(frozen=True)
class FittedRun:
    """One run after its sine fits; sigmas need the noise of the other runs too."""

    run_id: str
    conditions: Mapping[str, Any]
    frequency_hz: float
    duration_s: float
    output_v: Line
    displacement_m: Mapping[str, Line]


@dataclass(frozen=True)
class HeadReading:
    """How much more a head reads than the mean of all heads, relative, with what its noise alone makes of it."""

    excess: float
    sigma: float


@dataclass(frozen=True)
class Sensitivity:
    """One run: S with the sigma of each of its parts [V s2/m], and what it was taken at.

    `displacement_u` is the displacement's part of sigma, relative to S. `acceleration_m_s2` is the amplitude;
    `own_clock` tells that the lasers' phase was taken from the encoder; `heads` are those that the displacement is
    the mean of.
    """

    run_id: str
    conditions: Mapping[str, Any]
    frequency_hz: float
    duration_s: float
    value: complex
    sigma: float
    dof: float
    acceleration_m_s2: float
    own_clock: bool
    displacement_u: float = 0.0
    heads: Mapping[str, HeadReading] = field(default_factory=dict)

    def sigma_at(self, magnitude: float) -> float:
        """Sigma if |S| were this: the output's noise stays as it is, the displacement's goes with |S|."""
        return math.sqrt(self.sigma**2 + self.displacement_u**2 * (magnitude**2 - abs(self.value) ** 2))

    @property
    def nominal_hz(self) -> float:
        """The frequency that was asked for; where the encoder shows another, that one."""
        asked_hz = self.number("frequency_hz")
        as_asked = abs(self.frequency_hz - asked_hz) < _AS_ASKED * asked_hz
        return asked_hz if as_asked else float(f"{self.frequency_hz:.4g}")

    @property
    def omega(self) -> float:
        """Angular frequency [rad/s]."""
        return 2.0 * math.pi * self.frequency_hz

    @property
    def direction(self) -> int:
        """Of the sensing axis: +1 along the stage's positive travel."""
        return int(self.conditions["direction"])

    @property
    def mounting(self) -> int:
        """Number of its mounting."""
        return int(self.conditions["mounting"])

    def number(self, name: str) -> float:
        """A condition; NaN where it is missing or no number."""
        given = self.conditions.get(name)
        return float(given) if isinstance(given, int | float) and not isinstance(given, bool) else math.nan


def fitted_run(
    run_id: str,
    conditions: Mapping[str, Any],
    samples: Mapping[str, FloatArray],
    channels: Mapping[str, ChannelInfo],
    tilts_rad: Mapping[str, float],
) -> FittedRun:
    """Sine fits of a run's channels; `DataError` when there is no laser, or a record cannot be fitted."""
    for name in ("t_s", STAGE, ACCEL):
        if name not in samples:
            raise DataError(f"column {name} is missing")
    t_s, stage_m = samples["t_s"], _MM * samples[STAGE]
    known = np.isfinite(t_s) & np.isfinite(stage_m)
    basis, stage = find_frequency(t_s[known], stage_m[known], float(conditions["frequency_hz"]), harmonics=HARMONICS)
    seen_v = samples[ACCEL][np.isfinite(samples[ACCEL])]
    if seen_v.size and np.ptp(seen_v) == 0.0:
        raise DataError(f"{ACCEL} is {seen_v[0]:g} V throughout; was the sensor connected? measure the run again")
    reference, late = complex(stage.amplitudes[0]), _Lateness(channels, basis.frequency_hz)
    output = _line(t_s, samples[ACCEL], basis.frequency_hz, reference, late.turn(ACCEL))
    heads = {}
    for name in filter(is_head, samples):
        reading_m = _MM * math.cos(tilts_rad.get(name, 0.0)) * samples[name]
        if (own_s := samples.get(time_column(name))) is None:
            heads[name] = _along(_line(t_s, reading_m, basis.frequency_hz, reference, late.turn(name)))
        else:
            info = channels.get(name)
            known_s = info.clock_u_s if info else None
            # Beyond a quarter of a period nothing is known of the phase: the size is all that is asked for.
            clock_u_s = known_s if sign_is_known(basis.frequency_hz, known_s) else None
            heads[name] = _along(_own_clock_line(own_s, reading_m, basis.frequency_hz, reference, clock_u_s))
    if not heads:
        raise DataError("no laser head was recorded; the displacement has no reference")
    for name, line in heads.items():
        _require_to_follow(name, abs(line.value), abs(reference), basis.frequency_hz)
    return FittedRun(run_id, dict(conditions), basis.frequency_hz, basis.duration_s, output, heads)


def _require_to_follow(name: str, head_m: float, stage_m: float, frequency_hz: float) -> None:
    """That a head looks at the carriage: with another the mean of all would be off by as much as this one is."""
    if not stage_m / _FOLLOWS < head_m < stage_m * _FOLLOWS:
        said = f"{name} shows {head_m / _MM:.3g} mm of motion at {frequency_hz:.4g} Hz"
        mend = "does the head see the carriage? leave its column out where it does not"
        raise DataError(f"{said}, the stage {stage_m / _MM:.3g} mm: {mend}")


@dataclass(frozen=True)
class _Lateness:
    """How much later than the encoder channels are, as far as it is said."""

    channels: Mapping[str, ChannelInfo]
    frequency_hz: float

    def _latency_s(self, name: str) -> float:
        channel = self.channels.get(name)
        return (channel.latency_s if channel else None) or 0.0

    def turn(self, name: str) -> complex:
        """The factor that makes an amplitude one taken with the encoder."""
        angle = 2.0 * math.pi * self.frequency_hz * (self._latency_s(name) - self._latency_s(STAGE))
        return complex(math.cos(angle), -math.sin(angle))


def _line(t_s: FloatArray, column: FloatArray, frequency_hz: float, reference: complex, turn: complex) -> Line:
    seen = np.isfinite(column) & np.isfinite(t_s)
    if not seen.mean() > 0.5:
        raise DataError("more than half of the samples of a channel are missing")
    basis = HarmonicBasis(t_s[seen], frequency_hz, HARMONICS)
    fit = basis.fit(column[seen])
    value = complex(fit.amplitudes_referred_to(reference)[0]) * turn
    return _made(basis, fit, column[seen], value)


def _along(line: Line) -> Line:
    """A head's amplitude along the encoder's positive travel, from whichever side it looks."""
    return line if line.value.real > 0.0 else replace(line, value=-line.value)


def _own_clock_line(
    t_s: FloatArray, column: FloatArray, frequency_hz: float, reference: complex, clock_u_s: float | None
) -> Line:
    seen = np.isfinite(column) & np.isfinite(t_s)
    if not seen.any():
        raise DataError("a laser head saw no target")
    found = fit_on_own_clock(t_s[seen], column[seen], frequency_hz, reference, HARMONICS, clock_u_s)
    # What turns the fundamental has become the offset of the clock: only its size is left.
    value = complex(found.amplitudes[0].real, 0.0)
    return _made(found.basis, found.fit, column[seen], value, found.clock)


def _made(
    basis: HarmonicBasis, fit: HarmonicFit, column: FloatArray, value: complex, clock: ClockFit | None = None
) -> Line:
    floor = float(amplitude_floor(column, fit.residuals, basis)[1])
    noise = spectrum(fit.residuals, basis).compact(basis.duration_s)
    return Line(value, noise, float(basis.variance_factors[0]), floor, clock)


def sensitivities(runs: Sequence[FittedRun]) -> list[Sensitivity]:
    """Complex sensitivities of all runs, the noise of each channel pooled over them."""
    pools: dict[str, NoisePool] = {}
    for run in runs:
        for name, line in {ACCEL: run.output_v, **run.displacement_m}.items():
            pools.setdefault(name, NoisePool()).add(line.noise)
    return [_sensitivity(run, {name: pool.spectrum for name, pool in pools.items()}) for run in runs]


def _sensitivity(run: FittedRun, spectra: Mapping[str, Spectrum]) -> Sensitivity:
    def variance_of(name: str, line: Line) -> tuple[float, float]:
        level = spectra[name].level(run.frequency_hz, target_dof=NOISE_DOF)
        return max(level.psd / run.duration_s * line.variance_factor, line.floor), level.dof

    output_variance, dof = variance_of(ACCEL, run.output_v)
    heads = list(run.displacement_m.items())
    # Heads beside each other: their mean is free of the stage's turning.
    displacement = complex(np.mean([line.value for _, line in heads]))
    variances = {name: variance_of(name, line)[0] for name, line in heads}
    variance = sum(variances.values()) / len(heads) ** 2
    w = 2.0 * math.pi * run.frequency_hz
    acceleration = -(w**2) * displacement
    value = int(run.conditions["direction"]) * run.output_v.value / acceleration
    displacement_u = math.sqrt(variance) / abs(displacement)
    sigma = math.hypot(math.sqrt(output_variance) / abs(acceleration), abs(value) * displacement_u)
    return Sensitivity(
        run.run_id,
        run.conditions,
        run.frequency_hz,
        run.duration_s,
        value,
        sigma,
        dof,
        abs(acceleration),
        any(line.clock is not None for _, line in heads),
        displacement_u,
        {
            name: HeadReading(
                abs(line.value) / abs(displacement) - 1.0,
                # It is part of the mean itself.
                math.sqrt(max(variance + (1.0 - 2.0 / len(heads)) * variances[name], 0.0)) / abs(displacement),
            )
            for name, line in heads
        },
    )


def reduction(source: RunSource, tilts_rad: Mapping[str, float]) -> tuple[list[Sensitivity], dict[str, str]]:
    """The valid runs, reduced, in the order of time; by run_id why one is left out."""
    header: Header = source.header
    fitted: list[FittedRun] = []
    left_out: dict[str, str] = {}
    for record in source.runs(valid_only=True):
        samples = source.samples(record.run_id)
        try:
            fitted.append(fitted_run(record.run_id, record.conditions, samples, header.channels, tilts_rad))
        except DataError as error:
            left_out[record.run_id] = str(error)
    return sorted(sensitivities(fitted), key=_place), left_out


def _place(run: Sensitivity) -> tuple[float, ...]:
    """By time, and where that is not known by what was read: neither by the file's order nor by names."""
    start_s = run.number("start_s")
    known = start_s if math.isfinite(start_s) else math.inf
    return known, run.frequency_hz, run.acceleration_m_s2, run.value.real, run.value.imag
