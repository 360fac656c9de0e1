"""The shipped examples: NIST's reference data sets, fitted to NIST's certified answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.experiments.table.model.model import fitted
from rigctl.experiments.table.model.start import solve
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.diagnose import diagnose

EXAMPLES = Path(__file__).parents[2] / "examples"
ROWS = {
    "chwirut": 54,
    "enso": 168,
    "gauss": 250,
    "hahn": 236,
    "kirby": 151,
    "lanczos": 24,
    "longley": 16,
    "misra": 14,
    "norris": 36,
    "pontius": 40,
    "thurber": 37,
    "wampler5": 21,
}
DIGITS = {"norris": 12.5, "pontius": 12.0, "longley": 10.0}
"""Of the certified values and their sigmas that a linear fit reaches; others: within a share of the sigma."""


def _study(name: str) -> TableStudy:
    return TableStudy(read_bundle(EXAMPLES / name))


@pytest.mark.parametrize("name", ROWS)
def test_certified_values_are_reproduced(name: str) -> None:
    recording = read_bundle(EXAMPLES / name)
    reference = recording.header.extra["reference"]
    study = TableStudy(recording)
    assert len(study.observations.value) == ROWS[name]
    found = fitted(study.model([Term(effect) for effect in reference["effects"]]))
    assert found is not None
    assert found.verdict == "converged"
    scale = np.sqrt(found.chi2_per_dof)
    assert scale * study.observations.sigma[0] == pytest.approx(reference["residual_sd"], rel=1e-9)
    assert list(found.names) == [each for each in found.names if each in reference["parameters"]]
    for parameter, certified in reference["parameters"].items():
        value, sigma = found.value(parameter), found.sigma(parameter) * scale
        assert value == pytest.approx(certified["value"], abs=2e-4 * certified["sigma"]), parameter
        assert sigma == pytest.approx(certified["sigma"], rel=1e-4), parameter
        if name in DIGITS:
            tolerance = 10.0 ** -DIGITS[name]
            assert value == pytest.approx(certified["value"], rel=tolerance, abs=0.0), parameter
            assert sigma == pytest.approx(certified["sigma"], rel=tolerance), parameter


def test_what_doubles_cannot_hold_is_no_result() -> None:
    assert fitted(_study("filip").model([])) is None


def test_filip_s_start_is_the_certified_polynomial_as_far_as_doubles_hold_it() -> None:
    recording = read_bundle(EXAMPLES / "filip")
    model = _study("filip").model([])
    certified = recording.header.extra["reference"]["parameters"]
    for each in model.parameters:
        assert each.start == pytest.approx(certified[each.name]["value"], rel=1e-6)


def test_a_design_far_from_orthogonal_is_solved() -> None:
    x = 1985.0 + np.arange(20.0)
    design = np.stack([np.ones(20), x, x**2], axis=1)
    assert solve(design, design @ np.array([5.0, -2.0, 0.25])) == pytest.approx([5.0, -2.0, 0.25], rel=1e-6)


def test_a_line_is_not_enough_for_the_load_cell_and_is_for_the_ozone_monitors() -> None:
    """Pontius and Norris: NIST certifies a quadratic for the one and a line for the other."""
    cell, monitors = diagnose(_study("pontius"), []), diagnose(_study("norris"), [])
    assert [term.effect for term in cell.suggested] == ["power2[load_lb]"]
    size = cell.ranking[0].parameters["power2[load_lb]"]
    assert abs(size.value - -0.316081871345029e-14) < 0.05 * size.sigma
    assert cell.unexplained is None
    assert monitors.verdict == "adequate"
    assert monitors.not_testable["drift"].startswith("the readings are in no order")
