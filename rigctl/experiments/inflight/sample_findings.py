"""What a look through the samples amounts to, in the workbench's words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from rigctl.experiments.inflight.model.residual_samples import STRETCH_S, THRESHOLD_SIGMA, RunScan, unsteadiness
from rigctl.experiments.inflight.observe.reduction import ReducedStretch
from rigctl.workbench.study import Line, Term

CHANNEL = "2 m_dx"
_KNOWN_BINS = 1e-4


def pulses_found(scans: Sequence[RunScan]) -> Line | None:
    """Pulses of all runs together; None without any. What masking them gains shows in the fit, not here."""
    count = sum(len(each.pulses.at_s) for each in scans)
    if not count:
        return None
    expected = sum(each.pulses.trials for each in scans) * 2.0 * float(stats.norm.sf(THRESHOLD_SIGMA))
    amplitude = np.concatenate([np.abs(each.pulses.amplitude) for each in scans])
    sigma = np.concatenate([each.pulses.sigma for each in scans])
    largest = int(np.argmax(amplitude))
    return Line(
        term=Term("glitches", {"threshold_sigma": THRESHOLD_SIGMA}),
        channel=CHANNEL,
        frequency_hz=float("nan"),
        amplitude=float(amplitude[largest]),
        sigma=float(amplitude[largest] / sigma[largest]),
        unit="m/s2",
        p_value=float(stats.poisson.sf(count - 1, expected)),
        held_out_error_ratio=float("nan"),
        parameters={
            "amplitude": {
                "value": float(np.sqrt(np.mean(amplitude**2))),
                "sigma": float(np.sqrt(np.mean(amplitude**2) / (2.0 * count))),
                "unit": "m/s2",
            },
            "number": {"value": float(count), "sigma": math.sqrt(count), "unit": "1"},
        },
    )


def level_found(scans: Sequence[RunScan]) -> Line | None:
    """How unsteady the noise is; None where no stretch has enough samples."""
    levels = [each.levels[each.levels > 0.0] for each in scans]
    if sum(len(each) for each in levels) < 20:
        return None
    logs = np.log(np.concatenate(levels))
    own = 0.5 * float(np.mean(np.diff(logs) ** 2))
    change = 0.5 * math.sqrt(2.0 * max(float(np.var(logs)) - own, 0.0))
    sigma = 0.5 * math.sqrt(2.0 * own / len(logs))
    return Line(
        term=Term("noise-level"),
        channel=CHANNEL,
        frequency_hz=float("nan"),
        amplitude=change,
        sigma=sigma,
        unit="1",
        p_value=unsteadiness(levels),
        held_out_error_ratio=float("nan"),
        parameters={"change": {"value": change, "sigma": sigma, "unit": "1"}},
    )


def line_found(scans: Sequence[RunScan], known_hz: Sequence[float]) -> Line | None:
    """The strongest line of any run that is none of the known."""
    peaks = [each.peak for each in scans if each.peak is not None]
    fresh = [each for each in peaks if all(abs(each.frequency_hz / known - 1.0) > _KNOWN_BINS for known in known_hz)]
    if not fresh:
        return None
    peak = min(fresh, key=lambda each: (each.p_value, -each.amplitude / each.sigma))
    return Line(
        term=Term("steady-line", {"run": peak.run_id, "frequency_hz": peak.frequency_hz}),
        channel=CHANNEL,
        frequency_hz=peak.frequency_hz,
        amplitude=peak.amplitude,
        sigma=peak.sigma,
        unit="m/s2",
        p_value=float(-np.expm1(len(peaks) * np.log1p(-min(peak.p_value, 1.0 - 1e-16)))),
        held_out_error_ratio=float("nan"),
        parameters={
            "amplitude": {"value": peak.amplitude, "sigma": peak.sigma, "unit": "m/s2"},
            "frequency": {"value": peak.frequency_hz, "sigma": 0.0, "unit": "Hz"},
        },
    )


def loudness(found: RunScan, half: ReducedStretch) -> float:
    """Noise of a half over that of its run."""
    levels, at_s = found.levels, found.level_at_s
    inside = (levels > 0.0) & (at_s >= half.start_s) & (at_s + STRETCH_S <= half.stop_s)
    whole = levels > 0.0
    if not inside.any():
        return 1.0
    return math.sqrt(float(np.mean(levels[inside]) / np.mean(levels[whole])))
