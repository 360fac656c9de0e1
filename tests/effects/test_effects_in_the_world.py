"""Every effect against the simulated world, which shares no code with the model: its size and sign come back, and the
null with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import FitResult, least_squares
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.workbench.study import Term

NULL = "theta0[X,flag,1]"
WARMING = {"temperature": {"mean_c": 20.0, "daily_k": 0.0, "drift_k_per_day": 400.0}}


@dataclass(frozen=True)
class Case:
    """An effect as the world has it, and as the model should find it.

    `known` are parameters held at nature's values where the effect has the shape of one of them.
    """

    effect: str
    sizes: Mapping[str, float]
    names: Mapping[str, str] = field(default_factory=dict)
    choice: Mapping[str, Any] = field(default_factory=dict)
    wide: bool = False
    known: Sequence[str] = ()
    world: Mapping[str, Any] = field(default_factory=dict)


PER_AXIS, PER_CONFIGURATION = "[X]", "[X,flag]"
CASES = [
    Case("encoder-eccentricity", {"e1": 3e-5, "e2": -2e-5}, wide=True),
    Case("cable-hysteresis", {"h": 2e-5}),
    # The spot wanders over a face that yaws, by its lever: below a head's noise, and not in the model.
    Case("yaw", {"psi1": 2e-4}, world={"laser_noise_um": 0.05}),
    Case("null-drift", {"rate": 5e-9}, {"rate": f"rate{PER_AXIS}"}),
    Case("roll-gravity", {"rho1": 9.7e-5}),
    Case("pitch-gravity", {"pi1": 2e-4}),
    Case("bench-recoil", {"c": 1e-6}, known=[NULL]),
    Case("yaw-lever", {"lever_cos": 2e-5, "lever_sin": 3e-4}, known=[NULL, "gain[X,flag]"]),
    Case("quadratic", {"K2": 0.05}, {"K2": f"K2{PER_AXIS}"}, wide=True),
    Case("axis-tilt", {"eps_cos": 4e-5, "eps_sin": -6e-5}, wide=True),
    Case(
        "resonance",
        {"inv_w0_squared": 2.07e-3, "damping": 4.5e-3},
        {name: f"{name}{PER_CONFIGURATION}" for name in ("inv_w0_squared", "damping")},
    ),
    # A gain multiplies the bias too: with a volt of it no drift of the mean is left to be explained.
    Case("thermal-gain", {"kT": 2e-3}, {"kT": f"kT{PER_AXIS}"}, world={**WARMING, "bias_sigma_v": 1.0}),
    Case("gain-drift", {"rate": 5e-6}, {"rate": f"rate{PER_AXIS}"}, world={"bias_sigma_v": 1.0}),
    Case("thermal-bias", {"bT": 2e-3}, {"bT": f"bT{PER_AXIS}"}, world=WARMING),
    Case("bias-drift", {"rate": 1e-5}, {"rate": f"rate{PER_AXIS}"}),
    Case("time-skew", {"tau": 8e-4}),
    *(
        Case("laser-cosine", {f"dt[{head}]": 3e-3}, choice={"head": head})
        for head in ("laser_1_mm", "laser_2_mm", "laser_3_mm")
    ),
    *(
        Case("laser-nonlinearity", {f"q[{head}]": size}, choice={"head": head})
        for head, size in (("laser_1_mm", 0.05), ("laser_2_mm", 20.0))
    ),
    Case(
        "laser-crosstalk",
        {"chi": 2e-4},
        {"chi": "chi[laser_2_mm]"},
        choice={"head": "laser_2_mm"},
        known=["delta_z[X,flag,1]"],
    ),
]


def fitted(study: SensingAxisStudy, terms: Sequence[Term], known: Mapping[str, float]) -> FitResult:
    model = study.model(terms)
    given = model.observations
    parameters = [
        replace(each, start=known[each.name], fixed=True, prior=None) if each.name in known else each
        for each in model.parameters
    ]
    return least_squares(
        lambda values: (given.value - model.predict(values)) / given.sigma,
        parameters,
        jacobian=lambda values: model.jacobian(values) / given.sigma[:, None],
        max_iterations=100,
    )


@pytest.mark.parametrize("case", CASES, ids=[f"{c.effect} {'/'.join(c.choice.values())}".strip() for c in CASES])
def test_size_sign_and_null_come_back(measure: Callable[..., Any], case: Case) -> None:
    # The paper's roll is there always: products of effects must come out right too.
    effects = {"roll-gravity": {"rho1": 9.7e-5}, case.effect: dict(case.sizes)}
    made = measure(effects, wide=case.wide, **{"bias_sigma_v": 0.0, **case.world})
    nature, sizes = {**made.truth, "gain[X,flag]": 100.0}, dict(case.sizes)
    if case.effect == "null-drift":
        # The world counts from its beginning, the model from the recording's middle.
        middle_s = np.mean([_middle_s(made.recording, record) for record in made.recording.records])
        nature[NULL] += np.degrees(sizes["rate"] * middle_s)
    if case.effect == "thermal-gain":
        # The world's gain is that at 20 degC, the model's that at the recording's mean.
        warmer_k = np.mean([record.conditions["temperature_c"] for record in made.recording.records]) - 20.0
        sizes["kT"] /= 1.0 + sizes["kT"] * warmer_k
    terms = [Term("roll-gravity")]
    if case.effect != "roll-gravity":
        terms.append(Term(case.effect, case.choice))
    study = SensingAxisStudy(made.recording)
    result = fitted(study, terms, {name: nature[name] for name in case.known})
    assert result.verdict == "converged", result.reason
    for name, size in sizes.items():
        shown = case.names.get(name, name)
        sigma = result.sigma(shown)
        assert 0.0 < sigma < abs(size) / 20.0, f"{shown}: {sigma}"
        assert result.value(shown) == pytest.approx(size, abs=4.0 * sigma + 1e-4 * abs(size))
    if NULL not in case.known:
        assert result.value(NULL) == pytest.approx(nature[NULL], abs=4.0 * result.sigma(NULL))
    assert result.chi2_per_dof < 1.6


def _middle_s(recording: Any, record: Any) -> float:
    return float(record.conditions["start_s"] + 0.5 * recording.columns[record.run_id]["t_s"][-1])


def test_a_line_is_found_in_the_samples_with_its_size(measure: Callable[..., Any]) -> None:
    study = SensingAxisStudy(measure({"mains-pickup": {"amplitude": 2e-5, "frequency": 11.3}}).recording)
    found, *_ = study.lines(study.model([]))
    assert (found.term.effect, found.channel, found.unit) == ("mains-pickup", "accel_v", "V")
    assert found.term.choice == {"channel": "accel_v", "frequency_hz": found.frequency_hz}
    assert found.p_value < 1e-9
    assert found.held_out_error_ratio < 1.0
    frequency, amplitude = found.parameters["frequency"], found.parameters["amplitude"]
    assert frequency["value"] == pytest.approx(11.3, abs=4 * frequency["sigma"])
    assert 0.0 < frequency["sigma"] < 5e-3
    assert amplitude["value"] == pytest.approx(2e-5, abs=4 * amplitude["sigma"])
    left = study.lines(study.model([found.term]))
    assert all(abs(line.frequency_hz - 11.3) > 0.2 for line in left)


def test_a_line_is_fitted_in_the_samples_and_leaves_the_harmonics_alone(measure: Callable[..., Any]) -> None:
    made = measure({"mains-pickup": {"amplitude": 0.02, "frequency": 1.07}})
    study = SensingAxisStudy(made.recording)
    line = Term("mains-pickup", {"channel": "accel_v", "frequency_hz": 1.07})
    with_line, without = (fitted(study, terms, {}) for terms in ([line], []))
    assert with_line.names == without.names
    assert with_line.value(NULL) == pytest.approx(made.truth[NULL], abs=4.0 * with_line.sigma(NULL))
    assert with_line.sigma(NULL) < 0.2 * without.sigma(NULL)
