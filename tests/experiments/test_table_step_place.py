"""The place of a step has an uncertainty: it holds for places drawn at random, by any weights of the readings."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.noise import Correlation, Noise

ROWS, DRAWS = 60, 200
NAME = "step[x_mm].at"


def _study(x: FloatArray, y: FloatArray, sigma: FloatArray | None = None, **more: object) -> TableStudy:
    columns = {"y_v": y, "x_mm": x} | ({} if sigma is None else {"u_v": sigma})
    spec: dict[str, object] = {
        "response": "y_v",
        "baseline": "b0 + b1 * x_mm",
        "start": {},
        "sigma": None if sigma is None else "u_v",
        **more,
    }
    record = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(
        Recording(Header("table", extra={"table": spec}), (record,), {READINGS: columns}, ImportReport(1))
    )


def _place(study: TableStudy) -> tuple[float, float]:
    model = study.model([Term("step[x_mm]")])
    values = np.array([each.start for each in model.parameters])
    entry = study.result(model, values, np.zeros((len(values), len(values))))[NAME]
    assert entry["unit"] == "mm"
    return entry["value"], entry["sigma"]


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("size_sigmas", [1.5, 3.0])
def test_the_place_is_as_far_off_as_its_uncertainty_says(size_sigmas: float, stated: bool) -> None:
    rng = np.random.default_rng(4)
    square, variance = np.zeros(DRAWS), np.zeros(DRAWS)
    for draw in range(DRAWS):
        x = np.sort(rng.uniform(0.0, 10.0, ROWS))
        sigma = rng.uniform(0.05, 0.2, ROWS) if stated else np.full(ROWS, 0.1)
        true = rng.uniform(2.0, 8.0)
        y = 1.0 + 0.3 * x + size_sigmas * 0.1 * (x > true) + sigma * rng.normal(size=ROWS)
        at, spread = _place(_study(x, y, sigma if stated else None))
        square[draw], variance[draw] = (at - true) ** 2, spread**2
    # Of the squares' mean, as they scatter: a weak step has long tails.
    assert np.mean(square) == pytest.approx(np.mean(variance), abs=4.0 * np.std(square - variance) / np.sqrt(DRAWS))


def test_a_clear_step_lies_anywhere_between_its_two_neighbours() -> None:
    x = np.arange(20.0)
    y = np.where(x > 9.0, 1.0, 0.0) + 1e-6 * np.random.default_rng(5).normal(size=20)
    at, spread = _place(_study(x, y))
    assert at == 9.5
    assert spread == pytest.approx(1.0 / np.sqrt(12.0), rel=1e-6)


@pytest.mark.parametrize("effect", ["step[x_mm]", "periodic[x_mm]", "exponential[x_mm]"])
def test_a_place_is_where_readings_that_weigh_by_their_uncertainties_fit_best(effect: str) -> None:
    """The first readings are a hundred times as coarse as the last."""
    rng = np.random.default_rng(1)
    x = np.sort(rng.uniform(0.0, 10.0, ROWS))
    sigma = 0.02 * np.exp(5.0 - x / 2.0)
    shapes = {"step[x_mm]": x > 6.0, "periodic[x_mm]": np.sin(2.1 * x), "exponential[x_mm]": np.exp(0.7 * x - 5.0)}
    model = _study(x, 0.2 * shapes[effect] + sigma * rng.normal(size=ROWS), sigma).model([Term(effect)])
    (choice,) = (term.choice for term in model.terms)
    known = {"at": 6.0, "period": 2.0 * np.pi / 2.1, "rate": 0.7}
    (name,) = known.keys() & choice.keys()
    assert choice[name] == pytest.approx(known[name], rel=0.1)


def test_a_step_stays_in_correlated_noise_where_it_fits_best() -> None:
    """A curve that the model lacks is slow noise to it; in white noise the step would go where the curve bends."""
    x, rng = np.arange(120.0), np.random.default_rng(2)
    study = _study(x, 3.0 * np.cos(x / 19.0) + 1.0 * (x > 80.0) + 0.05 * rng.normal(size=120), order="x_mm")
    slow = 4.0 * np.exp(-np.abs(np.subtract.outer(x, x)) / 60.0) + 0.0025 * np.eye(120)
    factor, term = np.linalg.cholesky(slow), Term("step[x_mm]", {"at": 80.5})
    white = study.model([term])
    assert [each.choice for each in white.terms] != [{"at": 80.5}]
    model = study.placed(white, [term], lambda columns: np.linalg.solve(factor, columns))
    assert [each.choice for each in model.terms] == [{"at": 80.5}]
    noise = Noise(np.ones(120), np.full(120, np.inf), ((np.arange(120), factor),), (Correlation("exp 60", 1600.0),))
    known = KnownNoise(noise, Attempt(study, ()).estimator, study.observations, lambda: noise)
    attempt = Attempt(study, (term,), known=known)
    assert attempt.estimates()[NAME].value == 80.5
    # One reading's noise is a twentieth of the step.
    entry = study.result(attempt.model, attempt.result.values, attempt.result.covariance)[NAME]
    assert entry["sigma"] == pytest.approx(1.0 / np.sqrt(12.0), abs=0.1)
