"""Effects that the data determine only beside others, or only where the rest of the model fits.

A version that the data do not determine, and the next one, which they do: the ladder has a rung less, no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import Parameter
from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError, ProcedureError
from rigctl.experiments.table.study import TableStudy
from rigctl.report.document import write_report
from rigctl.workbench.model import versions
from rigctl.workbench.study import Observations, Term
from rigctl.workbench.verdict.fitted_model import fit_with_given_noise

ALONE = "linear[b]"
HEADER = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}}})


def recording(columns: dict[str, FloatArray]) -> Recording:
    run = RunRecord(READINGS, READINGS, "import", {})
    return Recording(HEADER, (run,), {READINGS: columns}, ImportReport(1))


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Readings that follow two columns; `ALONE` is determined beside the other one only."""
    model = TableStudy.model

    def determined(study: TableStudy, terms: Sequence[Term]) -> Any:
        if [term.effect for term in terms] == [ALONE]:
            raise ProcedureError("the fit is singular: these readings cannot tell linear[b]")
        return model(study, terms)

    monkeypatch.setattr(TableStudy, "model", determined)
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 60))
    with Store.create(tmp_path / "x.rig.sqlite", HEADER) as opened:
        with opened.begin_run(READINGS, "import", {}, READINGS) as writer:
            writer.append({"y": 1.0 + 2.0 * a + 3.0 * b + rng.normal(size=60), "a": a, "b": b})
            writer.finish()
        yield opened


def test_a_version_that_is_not_determined_has_a_note_and_the_next_one_its_fit(store: Store) -> None:
    for effect in (ALONE, "linear[a]"):
        versions.extend(store, Term(effect))
    bench = workbench_of(store)
    fitted = bench.fit()
    assert fitted.chi2_per_dof == pytest.approx(1.0, abs=0.7)
    assert {name: fitted.parameters[name].value for name in ("linear[a]", ALONE)} == pytest.approx(
        {"linear[a]": 2.0, ALONE: 3.0}, abs=1.0
    )
    first, alone, both = bench.history()
    assert alone["error_fit"] is None
    assert "cannot tell linear[b]" in alone["note"]
    assert alone.keys() - {"note"} == first.keys()
    assert {key for key, value in alone.items() if value is None} >= {"rms", "minus_2_log_l", "noise", "result"}
    assert both["error_fit"] < 0.5 * first["error_fit"]


def test_it_is_added_beside_what_tells_it_and_not_alone(store: Store) -> None:
    bench = workbench_of(store)
    with pytest.raises(
        DataError, match=r"'linear\[b\]' cannot be added to a model of these data: the fit is singular"
    ):
        bench.add([ALONE])
    assert [each.effects for each in versions.versions(store)] == [()]
    assert [each.effects for each in bench.add(["linear[a]", ALONE])] == [("linear[a]",), ("linear[a]", ALONE)]


def test_a_report_leaves_it_out(store: Store, tmp_path: Path) -> None:
    for effect in (ALONE, "linear[a]"):
        versions.extend(store, Term(effect))
    page = tmp_path / "x.html"
    write_report(workbench_of(store), page, None, lambda _: None)
    assert "version 2: not fitted: the fit is singular" in page.read_text()


@dataclass(frozen=True)
class Decay:
    """y = exp(-b x) with an effect c x; at b = 0 the two change y alike."""

    observations: Observations
    x: FloatArray
    terms: tuple[Term, ...] = (Term("trend"),)
    parameters: Sequence[Parameter] = (Parameter("b", 0.0), Parameter("c", 0.0))
    units: Sequence[str] = ("1", "1")
    owners: Sequence[str] = ("", "trend")
    local: Sequence[bool] = (False, False)

    def predict(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-values[0] * self.x) + values[1] * self.x)

    def jacobian(self, values: FloatArray) -> FloatArray:
        return np.stack([-self.x * np.exp(-values[0] * self.x), self.x], axis=1)


def test_an_effect_that_the_start_of_the_model_imitates_is_fitted_where_the_model_fits() -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 4.0, 80)
    y = np.exp(-1.5 * x) + 0.3 * x + 0.01 * rng.normal(size=80)
    given = TableStudy(recording({"y": y, "x": x})).model(()).observations
    found = fit_with_given_noise(Decay(replace(given, sigma=np.full(80, 0.01)), x), {})
    sigma = np.sqrt(np.diag(found.result.covariance))
    assert np.abs((found.result.values - [1.5, 0.3]) / sigma).max() < 4.0
