"""What each source does to a fit, taken together, is the fit's own covariance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.composition import opened_workbench
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench import fit_measurement
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.noise import Correlation, Noise

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"
NILE = Path(__file__).parents[1] / "foreign" / "data" / "nile-ordered"


@pytest.mark.parametrize(("recording", "effects"), [(PONTIUS, ["power2[load_lb]"]), (NILE, [])])
def test_sources_add_up_to_the_covariance_of_the_fit(desk: Any, recording: Path, effects: list[str]) -> None:
    """Of the Nile by year too, whose noise may be correlated."""
    assert desk.rigctl("import", recording, "--store", desk.store).status == 0
    for effect in effects:
        assert desk.rigctl("model", "add", desk.store, effect).status == 0
    with opened_workbench(desk.store, ()) as workbench:
        attempt = workbench.attempt(workbench.current)
        total = sum(each.covariance for each in fit_measurement.parameter_sources(attempt))
        u = np.sqrt(np.diag(attempt.uncertainty.covariance))
    np.testing.assert_allclose(total / np.outer(u, u), attempt.uncertainty.covariance / np.outer(u, u), atol=1e-6)


def test_another_calibration_has_noise_of_its_own_also_where_it_is_stated(
    desk: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    rows = fit_measurement._rows

    def stated(attempt: Any) -> Any:
        return ((name, "B", some, np.inf, "stated uncertainties") for name, _, some, _, _ in rows(attempt))

    monkeypatch.setattr(fit_measurement, "_rows", stated)
    with opened_workbench(desk.store, ()) as workbench:
        sources = fit_measurement.fit_measurement(workbench).sources
    assert [each.type for each in sources] == ["B"]
    assert not sources[0].in_common


def test_a_parameter_at_its_limit_makes_no_other_uncertain_in_correlated_noise() -> None:
    """A period of a straight line, of a table whose noise is told otherwise beside the fit."""
    x = np.arange(200.0)
    y = 0.1 * x + 0.1 * np.random.default_rng(1).normal(size=200)
    table = {"response": "y", "baseline": "b0", "start": {}, "order": "x"}
    record = RunRecord(READINGS, READINGS, "import", {})
    study = TableStudy(
        Recording(Header("table", extra={"table": table}), (record,), {READINGS: {"y": y, "x": x}}, ImportReport(1))
    )
    correlated = np.linalg.cholesky(np.exp(-np.abs(np.subtract.outer(x, x)) / 5.0) + np.eye(200))
    noise, beside_fit = (
        Noise(
            np.full(200, sigma), np.full(200, np.inf), ((np.arange(200), correlated),), (Correlation("exp 5", 1.0),)
        )
        for sigma in (0.1, 0.2)
    )
    known = KnownNoise(noise, Attempt(study, ()).estimator, study.observations, lambda: beside_fit)
    attempt = Attempt(study, [Term("periodic[x]", {"period": 380.0, "origin": 0.0})], known=known)
    sigmas = {name: each.sigma for name, each in attempt.estimates().items()}
    assert [name for name, sigma in sigmas.items() if not np.isfinite(sigma)] == ["periodic[x].period"]
    u = np.sqrt(np.diag(sum(each.covariance for each in fit_measurement.parameter_sources(attempt))))
    np.testing.assert_allclose(u, list(sigmas.values()), rtol=1e-6)
