"""The place of a step has an uncertainty: it holds for places drawn at random, by any weights of the readings."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term

ROWS, DRAWS = 60, 200
NAME = "step[x_mm].at"


def _study(x: FloatArray, y: FloatArray, sigma: FloatArray | None = None) -> TableStudy:
    columns = {"y_v": y, "x_mm": x} | ({} if sigma is None else {"u_v": sigma})
    spec: dict[str, object] = {
        "response": "y_v",
        "baseline": "b0 + b1 * x_mm",
        "start": {},
        "sigma": None if sigma is None else "u_v",
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
