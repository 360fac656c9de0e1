"""Is the room quiet enough? The accelerometer's noise with the stages at rest, before a campaign starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.sensing_axis.bench import Bench
from rigctl.campaign.session.session import Session
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

NOISE_CHECK = "noise check"
"""The key of its densities."""


@dataclass(frozen=True)
class NoiseCheck:
    """One-sided amplitude densities at the drive's frequencies [m/s2/sqrt(Hz)] beside what is allowed."""

    frequencies_hz: tuple[float, ...]
    asd_m_s2_rthz: tuple[float, ...]
    limit_m_s2_rthz: float

    @property
    def worst_m_s2_rthz(self) -> float:
        """The largest of the densities."""
        return max(self.asd_m_s2_rthz)

    @property
    def quiet(self) -> bool:
        """True when all densities are within the limit."""
        return self.worst_m_s2_rthz <= self.limit_m_s2_rthz


def check_noise(
    session: Session,
    bench: Bench,
    gain_v_per_m_s2: float,
    frequencies_hz: Sequence[float],
    limit_m_s2_rthz: float,
    *,
    duration_s: float = 100.0,
    sample_rate_hz: float = 20.0,
) -> NoiseCheck:
    """Record at rest and compare; a loud room is the operator's decision, `ProcedureError` when declined."""

    def measure() -> list[float]:
        bench.rest()
        volts = _record(session, bench, duration_s, sample_rate_hz)
        return [amplitude_density(volts, sample_rate_hz, f) / gain_v_per_m_s2 for f in frequencies_hz]

    densities = session.once(NOISE_CHECK, measure, bench.apparatus(lasers=False))
    check = NoiseCheck(tuple(frequencies_hz), tuple(densities), limit_m_s2_rthz)
    if not check.quiet:
        finding = (
            f"noise check: {check.worst_m_s2_rthz:.2g} m/s2/rtHz at the drive's frequencies, allowed "
            f"{limit_m_s2_rthz:.2g}"
        )
        accepted = session.once("noise accepted", lambda: session.operator.accept(f"{finding}. Start anyway?"))
        if not accepted:
            raise ProcedureError(f"{finding}; wait for a quieter room or raise targets.noise_m_s2_rthz")
    return check


def amplitude_density(volts: FloatArray, sample_rate_hz: float, frequency_hz: float) -> float:
    """One-sided amplitude spectral density near a frequency: Welch's estimate over a third of an octave [V/rtHz]."""
    from scipy.signal import welch

    segment = min(len(volts), int(40.0 * sample_rate_hz))
    frequencies, psd = welch(volts, fs=sample_rate_hz, nperseg=segment, detrend="constant")
    near = np.abs(np.log2(np.maximum(frequencies, 1e-9) / frequency_hz)) <= 1.0 / 6.0
    return float(np.sqrt(np.mean(psd[near])))


def _record(session: Session, bench: Bench, duration_s: float, sample_rate_hz: float) -> FloatArray:
    samples = round(duration_s * sample_rate_hz)
    bench.readout.start(samples, 1.0 / sample_rate_hz)
    parts: list[FloatArray] = []
    while sum(map(len, parts)) < samples:
        left_s = (samples - sum(map(len, parts))) / sample_rate_hz
        session.wait_s(min(left_s, 5.0) + 1.0 / sample_rate_hz)
        parts.append(bench.readout.fetch()[:, 0])
    volts = np.concatenate(parts)
    if not np.isfinite(volts).all():
        raise ProcedureError("noise check: the accelerometer's output is overloaded; level the package")
    return volts
