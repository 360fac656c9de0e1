"""Is the room quiet enough? The accelerometer's noise with the stages at rest, before a campaign starts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from procedures.sensing_axis.bench import Bench
from rigctl.analysis.periodograms import periodograms
from rigctl.campaign.session.session import Session
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import ConfigError, ProcedureError

NOISE_CHECK = "noise check"
"""The key of its densities."""

SAMPLE_RATE_HZ = 20.0
SEGMENT_S = 40.0
"""Length of the stretches whose spectra are averaged; longer for slow drives."""

_SIDE = 2.0 ** (1.0 / 6.0)
"""A third of an octave in all, half of it to either side."""


def check_noise(
    session: Session,
    bench: Bench,
    gain_v_per_m_s2: float,
    frequencies_hz: Sequence[float],
    limit_m_s2_rthz: float,
    duration_s: float,
) -> float:
    """Record at rest; returns the largest one-sided amplitude density at the drive's frequencies [m/s2/sqrt(Hz)].

    A room louder than the limit is the operator's decision; `ProcedureError` when declined.
    """

    def measure() -> list[float]:
        bench.rest()
        volts = _record(session, bench, duration_s)
        return [_density_v_rthz(volts, f) / gain_v_per_m_s2 for f in frequencies_hz]

    worst_m_s2_rthz = max(session.once(NOISE_CHECK, measure, bench.apparatus(lasers=False)))
    if worst_m_s2_rthz > limit_m_s2_rthz:
        finding = (
            f"noise check: {worst_m_s2_rthz:.2g} m/s2/rtHz at the drive's frequencies, allowed {limit_m_s2_rthz:.2g}"
        )
        # Kept, so that nobody is asked again after a restart.
        accepted = session.once("noise accepted", lambda: session.operator.accept(f"{finding}. Start anyway?"))
        if not accepted:
            raise ProcedureError(f"{finding}; wait for a quieter room or raise targets.noise_m_s2_rthz")
    return float(worst_m_s2_rthz)


def require_seen(frequencies_hz: Sequence[float], duration_s: float) -> None:
    """`ConfigError` when a check of this length has nothing to say of the noise at one of the drive's frequencies."""
    for frequency_hz in frequencies_hz:
        stretch = _stretch(frequency_hz, max(round(duration_s * SAMPLE_RATE_HZ), 1))
        if _near(np.asarray(np.fft.rfftfreq(stretch, 1.0 / SAMPLE_RATE_HZ)), frequency_hz).any():
            continue
        longer = f"take {math.ceil(_least_s(frequency_hz))} s or longer, or "
        raise ConfigError(
            f"procedure.noise_check_s: {duration_s:g} s at {SAMPLE_RATE_HZ:g} samples/s do not show the noise at "
            f"{frequency_hz:g} Hz; {longer if frequency_hz * _SIDE < 0.5 * SAMPLE_RATE_HZ else ''}0 for no check"
        )


def _density_v_rthz(volts: FloatArray, frequency_hz: float) -> float:
    """One-sided amplitude spectral density near a frequency: Welch's estimate over a third of an octave [V/rtHz]."""
    seen_hz, psd = periodograms(volts, 1.0 / SAMPLE_RATE_HZ, _stretch(frequency_hz, len(volts)))
    return float(np.sqrt(np.mean(psd[:, _near(seen_hz, frequency_hz)])))


def _stretch(frequency_hz: float, samples: int) -> int:
    """How many samples have their spectrum taken at once."""
    return min(samples, math.ceil(max(SEGMENT_S, _least_s(frequency_hz)) * SAMPLE_RATE_HZ))


def _least_s(frequency_hz: float) -> float:
    """Of a stretch that has a frequency of its spectrum within a third of an octave of this one."""
    return 1.0 / (frequency_hz * (_SIDE - 1.0 / _SIDE))


def _near(seen_hz: FloatArray, frequency_hz: float) -> BoolArray:
    return np.asarray((seen_hz >= frequency_hz / _SIDE) & (seen_hz <= frequency_hz * _SIDE))


def _record(session: Session, bench: Bench, duration_s: float) -> FloatArray:
    samples = round(duration_s * SAMPLE_RATE_HZ)
    bench.readout.start(samples, 1.0 / SAMPLE_RATE_HZ)
    parts: list[FloatArray] = []
    while sum(map(len, parts)) < samples:
        left_s = (samples - sum(map(len, parts))) / SAMPLE_RATE_HZ
        # One sample more, so that the last fetch finds the last reading.
        session.wait_s(min(left_s, 5.0) + 1.0 / SAMPLE_RATE_HZ)
        parts.append(bench.readout.fetch()[:, 0])
    volts = np.concatenate(parts)
    if not np.isfinite(volts).all():
        raise ProcedureError("noise check: the accelerometer's output is overloaded; level the package")
    return volts
