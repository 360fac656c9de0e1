"""Noise that is told by the scatter is no smaller than what the resolution of the readings leaves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.readings import resolution
from rigctl.experiments.table.study import TableStudy
from rigctl.report.verdicts import noise_sentence
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit
from rigctl.workbench.verdict.lack_of_fit import lack_of_fit

ANSCOMBE_X = np.array([10.0, 8.0, 13.0, 9.0, 11.0, 14.0, 6.0, 4.0, 12.0, 7.0, 5.0])
ANSCOMBE_Y = np.array([9.14, 8.14, 8.74, 8.77, 9.26, 8.10, 6.13, 3.10, 9.13, 7.26, 4.74])
"""The second data set of Anscombe (American Statistician 27 (1973) 17): a parabola, written to two decimals."""


def study(x: FloatArray, y: FloatArray, baseline: str = "b0 + b1 * x", **spec: Any) -> TableStudy:
    table = {"response": "y", "baseline": baseline, "start": {}, **spec}
    run = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(
        Recording(Header("table", extra={"table": table}), (run,), {READINGS: {"x": x, "y": y}}, ImportReport(1))
    )


def test_the_resolution_is_the_largest_step_of_which_all_are_multiples() -> None:
    assert resolution(np.array([0.01, 2.01, -4.02])) == 0.01
    assert resolution(np.array([1.5, -2.25, 4.0])) == 0.25
    assert resolution(np.array([1200.0, 3000.0])) == 600.0
    assert resolution(np.array([10_000_000.000_003, 9_999_999.999_998])) == pytest.approx(1e-6)
    assert resolution(np.array([1.5e-12, 4.5e-12, -1e-12])) == pytest.approx(5e-13)
    assert resolution(np.random.default_rng(1).normal(size=9)) == 0.0
    assert resolution(np.zeros(3)) == 0.0


def test_readings_exactly_on_a_line_do_not_know_it_better_than_their_digits() -> None:
    x = np.arange(0.0, 21.0, 2.0)
    found = fit(study(x, np.round(x + 0.01, 2)), [])
    (noise,) = found.noise
    assert noise.sigma == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-5)
    assert noise.resolution == 0.01
    assert "0.00289 by the resolution of 0.01" in noise_sentence(found.as_json())
    design = np.stack([np.ones(11), x], axis=1)
    sigmas = noise.sigma * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    assert [each.sigma for each in found.parameters.values()] == pytest.approx(list(sigmas), rel=1e-5)
    assert found.parameters["b1"].value == pytest.approx(1.0, abs=1e-12)
    assert np.isfinite(found.minus_2_log_l)


def test_a_pattern_of_rounding_is_no_effect() -> None:
    found = diagnose(study(ANSCOMBE_X, ANSCOMBE_Y), [])
    assert (found.verdict, [term.effect for term in found.suggested]) == ("effect", ["power2[x]"])
    size = found.ranking[0].parameters["power2[x]"]
    assert size.value == pytest.approx(-0.1267, abs=1e-4)
    assert 5e-5 < size.sigma < 2e-4


def test_a_scatter_that_is_larger_is_taken_as_it_is() -> None:
    random = np.random.default_rng(3)
    x = np.arange(30.0)
    y = np.round(1.0 + 2.0 * x + random.normal(0.0, 0.05, 30), 2)
    rounded, finer = fit(study(x, y), []), fit(study(x, y + 1e-13 * random.random(30)), [])
    assert rounded.noise[0].resolution is None
    assert rounded.noise[0].sigma == finer.noise[0].sigma


def test_readings_of_full_precision_have_no_floor() -> None:
    x = np.linspace(0.0, 1.0, 40)
    y = 1.0 + x / 3.0 + 1e-12 * np.random.default_rng(4).normal(size=40)
    (noise,) = fit(study(x, y), []).noise
    assert (noise.resolution, noise.sigma) == (None, pytest.approx(1e-12, rel=0.5))


def test_repeats_that_differ_by_a_digit_know_their_noise_no_better() -> None:
    x = np.repeat(np.arange(8.0), 2)
    y = np.round(0.1 * x + 0.004 * (x % 3 - 1), 2)
    y[1] += 0.01
    made = study(x, y)
    account = account_of(made, [()])
    attempt = account.attempt(made, ())
    lack = lack_of_fit(attempt)
    assert lack is not None
    assert lack.pure_error >= 0.01 / np.sqrt(12.0) * (1.0 - 1e-9)
    assert compared(attempt, account, 1).p_value > 0.05
