"""Conditions that say the same are listed once, whichever experiment they are of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigctl.core.errors import DataError
from rigctl.report.figures.residuals import clearest_first
from rigctl.report.notebook import shown_comparison
from rigctl.workbench.verdict.compare import compare
from rigctl.workbench.verdict.covariates import distinct

RNG = np.random.default_rng(2)
ANGLE = RNG.uniform(-20.0, 20.0, 40)


@pytest.mark.parametrize(
    ("second", "told"),
    [
        (ANGLE + 0.01 * RNG.standard_normal(40), False),
        (np.radians(90.0 - ANGLE), False),
        (ANGLE + 1.0 * RNG.standard_normal(40), True),
        (RNG.standard_normal(40), True),
        (np.abs(ANGLE), True),
    ],
    ids=["asked for", "in another unit", "related", "its own", "a function"],
)
def test_a_copy_is_not_told_again(second: np.ndarray, told: bool) -> None:
    assert distinct({"angle_deg": ANGLE, "second": second}) == ["angle_deg", "second"][: 1 + told]


def test_what_does_not_vary_is_not_told() -> None:
    assert distinct({"room": np.full(40, 3.0), "unknown": np.full(40, np.nan), "angle_deg": ANGLE}) == ["angle_deg"]


def test_unknown_values_hide_a_copy_only_in_the_same_runs() -> None:
    gaps = np.where(np.arange(40) % 7, ANGLE, np.nan)
    assert distinct({"angle_deg": gaps, "copy": 2.0 * gaps + 1.0}) == ["angle_deg"]
    assert distinct({"angle_deg": ANGLE, "with_gaps": gaps}) == ["angle_deg", "with_gaps"]


def test_an_angle_asked_for_is_neither_a_trend_nor_a_figure_beside_the_one_reached(made_up: Any) -> None:
    reached = made_up.conditions()["theta_deg"]
    asked = reached + 1e-3 * RNG.standard_normal(len(reached))
    study = made_up.study(3, {"lag": 30.0}, further={"theta_asked_deg": asked})
    found = compare(study, ())
    assert "theta_asked_deg" in found.observations.covariates
    assert {trend.covariate for trend in found.trends} == {
        "theta_deg",
        "frequency_hz",
        "approach",
        "start_s",
        "temperature_c",
    }
    covariates = clearest_first(found)
    assert "theta_deg" in covariates
    assert "theta_asked_deg" not in covariates


def test_where_no_condition_varies_a_plot_says_so(made_up: Any) -> None:
    found = compare(made_up.study(3, {}), ())
    still = {name: np.full_like(values, 1.0) for name, values in found.observations.covariates.items()}
    alike = replace(found, observations=replace(found.observations, covariates=still), trends=())
    with pytest.raises(DataError, match="no condition varies from run to run; name one"):
        shown_comparison(alike).plot()
