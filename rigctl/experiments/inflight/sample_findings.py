"""What the samples show besides the lines, as findings of the workbench."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.residual_samples import STRETCH_S, THRESHOLD_SIGMA, RunScan, steadiness
from rigctl.experiments.inflight.observe.reduction import ReducedStretch
from rigctl.workbench.study import Line, Term

CHANNEL = "2 m_dx"
_KNOWN_BINS = 1e-4


def pulses_in(scans: Sequence[RunScan]) -> Line | None:
    """Pulses of all runs together; None without any. What masking them gains shows in the fit, not here."""
    count = sum(len(each.pulses.at_s) for each in scans)
    if not count:
        return None
    amplitude = np.concatenate([np.abs(each.pulses.amplitude) for each in scans])
    sigma = np.concatenate([each.pulses.sigma for each in scans])
    largest, power = int(np.argmax(amplitude)), np.mean(amplitude**2)
    return _line(
        Term("glitches", {"threshold_sigma": THRESHOLD_SIGMA}),
        _quantity(amplitude[largest], amplitude[largest] / sigma[largest], "m/s2"),
        _chance_of_pulses(scans, np.sort(sigma)[::-1]),
        amplitude=_quantity(np.sqrt(power), np.sqrt(power / (2.0 * count)), "m/s2"),
        number=_quantity(count, math.sqrt(count), "1"),
    )


def _chance_of_pulses(scans: Sequence[RunScan], sigmas: FloatArray) -> float:
    """How likely noise makes the k largest pulses as large as they are, for the k of which that is least likely."""
    expected = [sum(each.pulses.by_chance(sigma) for each in scans) for sigma in sigmas.tolist()]
    p_values = special.pdtrc(np.arange(len(sigmas)), expected)
    return float(min(1.0, len(sigmas) * np.min(p_values)))


def changing_level_in(scans: Sequence[RunScan]) -> Line | None:
    """How unsteady the noise is; None where too few stretches have enough samples."""
    found = steadiness([each.levels for each in scans])
    if found is None:
        return None
    change = _quantity(
        # Levels are variances: the noise itself changes by half their logarithm.
        0.5 * math.sqrt(2.0 * max(found.scatter - found.of_neighbours, 0.0)),
        0.5 * math.sqrt(2.0 * found.of_neighbours / found.count),
        "1",
    )
    return _line(Term("noise-level"), change, found.p_value, change=change)


def strongest_line_in(scans: Sequence[RunScan], known_hz: Sequence[float]) -> Line | None:
    """The strongest line of any run that is none of the known."""
    peaks = [each.peak for each in scans if each.peak is not None]
    fresh = [each for each in peaks if all(abs(each.near_hz / known - 1.0) > _KNOWN_BINS for known in known_hz)]
    if not fresh:
        return None
    peak = min(fresh, key=lambda each: (each.p_value, -each.amplitude / each.sigma))
    amplitude = _quantity(peak.amplitude, peak.sigma, "m/s2")
    return _line(
        Term("steady-line", {"run": peak.run_id, "frequency_hz": peak.near_hz}),
        amplitude,
        # The strongest of so many runs.
        float(-np.expm1(len(peaks) * np.log1p(-min(peak.p_value, 1.0 - 1e-16)))),
        amplitude=amplitude,
        frequency=_quantity(peak.frequency_hz, peak.sigma_hz, "Hz"),
    )


def _quantity(value: float, sigma: float, unit: str) -> dict[str, Any]:
    return {"value": float(value), "sigma": float(sigma), "unit": unit}


def _line(term: Term, size: Mapping[str, Any], p_value: float, **parameters: Mapping[str, Any]) -> Line:
    return Line(
        term=term,
        channel=CHANNEL,
        frequency_hz=term.choice.get("frequency_hz", math.nan),
        amplitude=size["value"],
        sigma=size["sigma"],
        unit=size["unit"],
        p_value=p_value,
        held_out_error_ratio=math.nan,
        parameters=parameters,
    )


def relative_noise(scan: RunScan, half: ReducedStretch) -> float:
    """Noise of a half over that of its run."""
    levels, at_s = scan.levels, scan.level_at_s
    inside = (levels > 0.0) & (at_s >= half.start_s) & (at_s + STRETCH_S <= half.stop_s)
    whole = levels > 0.0
    if not inside.any():
        return 1.0
    return math.sqrt(float(np.mean(levels[inside]) / np.mean(levels[whole])))
