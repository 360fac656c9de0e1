"""Sensitivity by frequency with its uncertainty budget, linearity over the amplitude, and the two directions."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.analysis.budget import Budget, Contribution, Measurement, budget
from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.experiments.frequency_response.model import Bench, Recorded
from rigctl.experiments.frequency_response.observables import Sensitivity
from rigctl.experiments.frequency_response.reference import Reference, reference_of

OUTPUTS = ("magnitude", "phase_deg")
UNITS = ("V s2/m", "deg")
SCATTER_P = 0.01
"""Runs of a frequency that scatter more than their noise at this level are weighed by their scatter."""

UNLIKE = 1.5
"""Outputs at one frequency that differ by this factor are not both of the sensor that is calibrated."""

SWEPT = 1.01
"""Amplitudes by this factor apart are two; a drive repeats one within that."""

OWN = ("noise of the magnitude", "noise of the phase")
"""Contributions of a frequency alone; all others are common to all frequencies."""


@dataclass(frozen=True)
class AtFrequency:
    """The sensitivity at one frequency: mean over its runs, with the budget of magnitude and phase."""

    frequency_hz: float
    runs: int
    value: complex
    budget: Budget
    scattered: bool

    def as_json(self) -> dict[str, Any]:
        """Value, standard and expanded uncertainty of magnitude and phase; each contribution's part."""
        found = self.budget
        rows = zip(OUTPUTS, UNITS, found.values, found.standard_uncertainty, found.coverage_factor, strict=True)
        shown = {
            name: {"value": float(value), "u": float(u), "k": float(k), "U": float(k * u), "unit": unit}
            for name, unit, value, u, k in rows
        }
        parts = {
            each.name: {name: float(abs(found.components[row, i])) for row, name in enumerate(OUTPUTS)}
            for i, each in enumerate(found.contributions)
        }
        told = {"runs": self.runs, "scatter_beyond_noise": self.scattered, "budget": parts}
        return {"frequency_hz": self.frequency_hz, **shown, **told}


@dataclass(frozen=True)
class Deviation:
    """One run: its magnitude over that of its frequency at small amplitude, less 1, and its sigma."""

    run_id: str
    frequency_hz: float
    direction: int
    acceleration_m_s2: float
    deviation: float
    sigma: float


@dataclass(frozen=True)
class Linearity:
    """|S| = |S0| (1 + kappa A^2), S0 free for every frequency; no kappa where no frequency has two amplitudes."""

    kappa_s4_m2: float | None
    sigma: float
    deviations: tuple[Deviation, ...]

    def as_json(self) -> dict[str, Any]:
        """The coefficient, and the largest deviation with that of its sigma."""
        if self.kappa_s4_m2 is None:
            return {"kappa": None}
        largest = max(self.deviations, key=lambda each: abs(each.deviation))
        reach = max(each.acceleration_m_s2 for each in self.deviations)
        return {
            "kappa": {"value": self.kappa_s4_m2, "sigma": self.sigma, "unit": "s4/m2"},
            "largest_deviation": {"value": largest.deviation, "sigma": largest.sigma, "run_id": largest.run_id},
            "acceleration_max_m_s2": reach,
        }


@dataclass(frozen=True)
class ResponseResult:
    """What the runs amount to; `covariance` by output over all frequencies, in order."""

    frequencies: tuple[AtFrequency, ...]
    covariance: Mapping[str, FloatArray]
    linearity: Linearity
    asymmetry: tuple[float, float] | None
    remarks: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        both = None if self.asymmetry is None else dict(zip(("value", "sigma"), self.asymmetry, strict=True))
        return {
            "sensitivity": [each.as_json() for each in self.frequencies],
            "covariance": {name: matrix.tolist() for name, matrix in self.covariance.items()},
            "linearity": self.linearity.as_json(),
            "direction_asymmetry": both,
            "remarks": list(self.remarks),
        }


def response_result(data: Recorded) -> ResponseResult:
    """Everything that follows from the runs alone, whatever the model."""
    groups = _by_frequency(data.runs)
    reference = reference_of(data.runs, data.bench.heads_u)
    rows = tuple(_at_frequency(frequency_hz, runs, data.bench, reference) for frequency_hz, runs in groups.items())
    covariance = {name: _covariance(rows, row) for row, name in enumerate(OUTPUTS)}
    remarks = (*reference.remarks, *_other_frequencies(data.runs), *_unlike_others(groups))
    return ResponseResult(rows, covariance, linearity(groups), asymmetry(groups), remarks)


def _other_frequencies(runs: Sequence[Sensitivity]) -> list[str]:
    return [
        f"run {run.run_id} was driven at {run.nominal_hz:g} Hz and counts there; its frequency_hz says "
        f"{run.number('frequency_hz'):g}: correct it"
        for run in runs
        if run.nominal_hz != run.number("frequency_hz")
    ]


def _unlike_others(groups: Mapping[float, Sequence[Sensitivity]]) -> list[str]:
    """Runs whose output has another size or sign than that of most others of their frequency."""
    found = []
    for frequency_hz, runs in groups.items():
        value = _values(runs)
        magnitude = np.abs(value)
        otherwise = np.abs(np.log(magnitude[:, None] / magnitude)) > math.log(UNLIKE)
        against = (value[:, None] * value.conj()).real < 0.0
        for run, of_others, other_size, other_sign in zip(
            runs, magnitude / np.median(magnitude), _by_most(otherwise), _by_most(against), strict=True
        ):
            if other_size:
                found.append(
                    f"the output of run {run.run_id} is {of_others:.2g} times that of most others at "
                    f"{frequency_hz:g} Hz: was the sensor connected, and the range as stated? "
                    "if not, mark the run invalid"
                )
            elif other_sign:
                found.append(
                    f"the output of run {run.run_id} goes against that of most others at {frequency_hz:g} Hz: its "
                    f"direction says {run.direction:+d}; correct it, or mark the run invalid"
                )
    return found


def _by_most(differs: BoolArray) -> list[bool]:
    """By runs: whether most of them differ from this one."""
    return [bool(each) for each in 2 * differs.sum(axis=1) > len(differs)]


def _by_frequency(runs: Sequence[Sensitivity]) -> dict[float, list[Sensitivity]]:
    groups: dict[float, list[Sensitivity]] = {}
    for run in sorted(runs, key=lambda each: each.nominal_hz):
        groups.setdefault(run.nominal_hz, []).append(run)
    return groups


def weighted_mean(runs: Sequence[Sensitivity]) -> tuple[complex, float, float]:
    """The mean by the runs' noise, the standard uncertainty of each of its parts, and chi-squared about it."""
    return _mean_by(_values(runs), _variances(runs))


def _mean_by(value: ComplexArray, variance: FloatArray) -> tuple[complex, float, float]:
    weight = 1.0 / variance
    mean = complex(weight @ value / weight.sum())
    return mean, float(weight.sum() ** -0.5), float(weight @ np.abs(value - mean) ** 2)


def _values(runs: Sequence[Sensitivity]) -> ComplexArray:
    return np.array([run.value for run in runs])


def _variances(runs: Sequence[Sensitivity]) -> FloatArray:
    """Of each part, at the one sensitivity they all measure: by its own a small value would count for more."""
    magnitude = float(np.median(np.abs(_values(runs))))
    return np.array([run.sigma_at(magnitude) ** 2 for run in runs])


def _mean_by_scatter(runs: Sequence[Sensitivity]) -> tuple[complex, float]:
    """The mean and the standard uncertainty of each of its parts, where runs scatter by more than their noise.

    All have the same variance beside that of their noise, such that chi-squared is its degrees of freedom (Mandel and
    Paule 1982): a run of large amplitude does not count for all others when it is the one that is off.
    """
    from scipy.optimize import brentq

    value, variance, dof = _values(runs), _variances(runs), 2 * (len(runs) - 1)
    largest = float(np.sum(np.abs(value - value.mean()) ** 2))
    between = brentq(lambda added: _mean_by(value, variance + added)[2] - dof, 0.0, largest)
    mean, sigma, _ = _mean_by(value, variance + between)
    return mean, sigma


def _at_frequency(
    frequency_hz: float, runs: Sequence[Sensitivity], bench: Bench, reference: Reference
) -> AtFrequency:
    from scipy.special import chdtrc  # 0.1 s, which a printed status does not need

    mean, sigma, chi2 = weighted_mean(runs)
    # Two parts each, less those of the mean.
    dof = 2 * (len(runs) - 1)
    scattered = bool(dof and chdtrc(dof, chi2) < SCATTER_P)
    behind = float(dof) if scattered else sum(run.dof for run in runs)
    if scattered:
        mean, sigma = _mean_by_scatter(runs)
    measured, contributions = measurement(frequency_hz, mean, sigma, behind, bench, reference)
    return AtFrequency(frequency_hz, len(runs), mean, budget(measured, contributions, OUTPUTS), scattered)


def measurement(
    frequency_hz: float, mean: complex, sigma: float, dof: float, bench: Bench, reference: Reference
) -> tuple[Measurement, list[Contribution]]:
    """Magnitude and phase as a function of all that is uncertain in them."""
    size, phase_deg = abs(mean), math.degrees(cmath.phase(mean))
    contributions = [
        Contribution(OWN[0], size, sigma, "V s2/m", "A", dof=dof, source="samples"),
        Contribution(OWN[1], phase_deg, math.degrees(sigma / size), "deg", "A", dof=dof, source="samples"),
        Contribution("reference", 0.0, reference.u, "1", source=reference.source),
        Contribution("voltmeter", 0.0, bench.gain_u, "1", source="certificate of the readout: scale"),
        Contribution("clock", 0.0, bench.frequency_u, "1", source="certificate of the readout: clock"),
        Contribution("guide", 0.0, bench.pitch_u_rad_m, "rad/m", source="certificate of the stage: pitch_rad_per_m"),
        Contribution("delay", 0.0, bench.delay_u_s, "s", source="certificates: latency_s"),
    ]
    per_pitch = bench.g_m_s2 / (2.0 * math.pi * frequency_hz) ** 2

    def measured(given: Mapping[str, float]) -> FloatArray:
        # S = V / (w^2 X): what is off in the clock counts twice; gravity enters where the guide pitches.
        scale = (1.0 + given["voltmeter"] + per_pitch * given["guide"]) / (
            (1.0 + given["reference"]) * (1.0 + given["clock"]) ** 2
        )
        return np.array([given[OWN[0]] * scale, given[OWN[1]] + 360.0 * frequency_hz * given["delay"]])

    return measured, contributions


def _covariance(rows: Sequence[AtFrequency], output: int) -> FloatArray:
    """Of one output between frequencies: what is common to all is fully correlated."""
    names = [each.name for each in rows[0].budget.contributions]
    components = np.array([row.budget.components[output] for row in rows])
    own = np.isin(names, OWN)
    common = components[:, ~own]
    return np.asarray(common @ common.T + np.diag((components[:, own] ** 2).sum(axis=1)))


def linearity(groups: Mapping[float, Sequence[Sensitivity]]) -> Linearity:
    """The coefficient of A^2 common to all frequencies, by weighted least squares."""
    columns, sizes, sigmas, runs = [], [], [], []
    swept = {f: each for f, each in groups.items() if _several_amplitudes(each)}
    for place, each in enumerate(swept.values()):
        mean = weighted_mean(each)[0]
        for run in each:
            columns.append([*(float(place == other) for other in range(len(swept))), run.acceleration_m_s2**2])
            # Along the mean: a phase that scatters does not lengthen it.
            sizes.append((run.value * mean.conjugate()).real / abs(mean) ** 2)
            sigmas.append(run.sigma_at(abs(mean)) / abs(mean))
            runs.append(run)
    if not runs:
        return Linearity(None, math.nan, ())
    weight = 1.0 / np.array(sigmas)
    design, value = np.array(columns) * weight[:, None], np.array(sizes) * weight
    inverse = np.linalg.inv(design.T @ design)
    found = inverse @ (design.T @ value)
    at_rest = np.array(columns)[:, :-1] @ found[:-1]
    deviations = tuple(
        Deviation(
            run.run_id,
            run.nominal_hz,
            run.direction,
            run.acceleration_m_s2,
            size / rest - 1.0,
            sigma / rest,
        )
        for run, size, rest, sigma in zip(runs, sizes, at_rest.tolist(), sigmas, strict=True)
    )
    return Linearity(float(found[-1]), float(math.sqrt(inverse[-1, -1])), deviations)


def _several_amplitudes(runs: Sequence[Sensitivity]) -> bool:
    """As the heads measured them: a recording need not say what was asked for."""
    measured = [run.acceleration_m_s2 for run in runs]
    return max(measured) > SWEPT * min(measured)


def asymmetry(groups: Mapping[float, Sequence[Sensitivity]]) -> tuple[float, float] | None:
    """Half the relative difference of |S| forward and reversed over all frequencies; None where one is missing."""
    values, variances = [], []
    for runs in groups.values():
        by_direction = [[run for run in runs if run.direction == sign] for sign in (1, -1)]
        if not all(by_direction):
            continue
        (forward, forward_u, _), (back, back_u, _) = (weighted_mean(each) for each in by_direction)
        total = abs(forward + back)
        values.append((abs(forward) - abs(back)) / total)
        variances.append((forward_u**2 + back_u**2) / total**2)
    if not values:
        return None
    weight = 1.0 / np.array(variances)
    return float(weight @ np.array(values) / weight.sum()), float(weight.sum() ** -0.5)
