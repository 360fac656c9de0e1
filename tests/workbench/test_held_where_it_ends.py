"""What others imitate is held, said to be, and asked anew where the fit ends: a scan may have begun elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Observations, Term
from rigctl.workbench.verdict.fit import fit
from rigctl.workbench.verdict.fitted_model import fit_with_given_noise

T_S = np.tile(np.linspace(0.0, 1.0, 48), 3)
FAR_S, PERIOD_S, COS, SIN = 9.0, 1.4, 30.0, 40.0


@dataclass
class Tide:
    """A line in time, and a wave of which the readings have less than a period; level and rate imitate a slow one."""

    observations: Observations
    terms: tuple[Term, ...] = (Term("tide", {"period": FAR_S}),)
    units: Sequence[str] = ("1", "1", "1", "1", "s")
    owners: Sequence[str] = ("", "", "tide", "tide", "tide")
    local: Sequence[bool] = (False,) * 5
    parameters: Sequence[Parameter] = (
        Parameter("level", 0.0),
        Parameter("rate", 0.0),
        Parameter("sin", 0.0),
        Parameter("cos", 0.0),
        Parameter("period", FAR_S, prior=Prior(FAR_S, 10.0 * FAR_S), lower=0.5, upper=20.0),
    )

    def predict(self, values: FloatArray) -> FloatArray:
        turn = 2.0 * np.pi * T_S / values[4]
        return np.asarray(values[0] + values[1] * T_S + values[2] * np.sin(turn) + values[3] * np.cos(turn))

    def jacobian(self, values: FloatArray) -> FloatArray:
        turn = 2.0 * np.pi * T_S / values[4]
        by_turn = values[2] * np.cos(turn) - values[3] * np.sin(turn)
        return np.stack([np.ones_like(T_S), T_S, np.sin(turn), np.cos(turn), -by_turn * turn / values[4]], axis=1)


def test_what_is_held_where_a_scan_began_is_asked_anew_where_the_fit_ends(made_up: Any) -> None:
    rng = np.random.default_rng(5)
    turn = 2.0 * np.pi * T_S / PERIOD_S
    value = 3.0 - 2.0 * T_S + SIN * np.sin(turn) + COS * np.cos(turn) + rng.normal(size=len(T_S))
    found = fit_with_given_noise(Tide(made_up.observations(value)), {})  # type: ignore[arg-type]
    assert not found.held
    sigma = np.sqrt(np.diag(found.result.covariance))
    pulls = (found.result.values - [3.0, -2.0, SIN, COS, PERIOD_S]) / sigma
    assert np.abs(pulls).max() < 4.0
    assert found.result.chi2_per_dof < 1.5


def test_a_rate_that_is_held_is_as_undetermined_in_the_result_as_among_the_parameters() -> None:
    """Of an exponential beside a line that bends a little, the amplitude imitates its rate."""
    t_s = np.linspace(0.0, 10.0, 40)
    y_v = 1.0 + 0.3 * t_s + 0.0005 * t_s**2 + 0.02 * np.random.default_rng(1).standard_normal(40)
    table = {"response": "y_v", "baseline": "b0 + b1 * t_s", "start": {}}
    record = RunRecord(READINGS, READINGS, "import", {})
    columns = {READINGS: {"y_v": y_v, "t_s": t_s}}
    study = TableStudy(Recording(Header("table", extra={"table": table}), (record,), columns, ImportReport(1)))
    found = fit(study, [Term("exponential[t_s]", {"rate": -0.14, "origin": 0.0})])
    rate = "exponential[t_s].rate"
    assert found.held == (rate,)
    assert found.result[rate] == {
        "value": found.parameters[rate].value,
        "sigma": pytest.approx(np.nan, nan_ok=True),
        "unit": "1/s",
    }
    assert np.isfinite(found.result["exponential[t_s]"]["sigma"])
