"""Is the room quiet enough? The accelerometer's noise with the stages at rest, before a campaign starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.sensing_axis.bench import Bench
from rigctl.campaign.session.session import Session
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

NOISE_CHECK = "noise check"
"""The key of its densities."""

SAMPLE_RATE_HZ = 20.0
SEGMENT_S = 40.0
"""Length of the stretches whose spectra are averaged."""


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


def _density_v_rthz(volts: FloatArray, frequency_hz: float) -> float:
    """One-sided amplitude spectral density near a frequency: Welch's estimate over a third of an octave [V/rtHz]."""
    from scipy.signal import welch

    segment = min(len(volts), int(SEGMENT_S * SAMPLE_RATE_HZ))
    frequencies, psd = welch(volts, fs=SAMPLE_RATE_HZ, nperseg=segment, detrend="constant")
    # A third of an octave in all, half of it to either side.
    near = np.abs(np.log2(np.maximum(frequencies, 1e-9) / frequency_hz)) <= 1.0 / 6.0
    return float(np.sqrt(np.mean(psd[near])))


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
