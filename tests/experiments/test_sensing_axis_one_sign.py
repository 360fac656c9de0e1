"""A gain that falls with the square of the frequency is no resonance, whose 1/w0^2 is positive."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from rigctl.campaign.recording import Recording
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.verdict.diagnose import diagnose
from tests.experiments.test_sensing_axis_study import recording

LEVEL_V = 0.2
INV_W0_SQUARED_S2 = 1e-4


def with_gain_by_frequency(inv_w0_squared: float) -> Recording:
    given = recording(angles=(-1.0, -0.4, 0.2, 1.1), frequencies=(0.3, 0.45, 0.6), rho1=0.0)
    changed = {}
    for run in given.records:
        columns = given.samples(run.run_id)
        gain = 1.0 + inv_w0_squared * (2.0 * math.pi * float(run.conditions["frequency_hz"])) ** 2
        changed[run.run_id] = {**columns, "accel_v": LEVEL_V + gain * (columns["accel_v"] - LEVEL_V)}
    return replace(given, columns=changed)


def diagnosed(inv_w0_squared: float) -> Diagnosis:
    return diagnose(SensingAxisStudy(with_gain_by_frequency(inv_w0_squared)), [])


def test_a_gain_that_grows_is_the_resonance() -> None:
    found = diagnosed(INV_W0_SQUARED_S2)
    assert [term.effect for term in found.suggested] == ["resonance"]
    assert found.impossible == {}
    fitted = found.joint_fit.parameters["inv_w0_squared[X,pendulum]"]
    assert fitted.value == pytest.approx(INV_W0_SQUARED_S2, abs=4.0 * fitted.sigma)


def test_a_gain_that_falls_is_not_and_the_reason_is_told() -> None:
    found = diagnosed(-INV_W0_SQUARED_S2)
    assert found.verdict == "unknown"
    assert "resonance" not in {term.effect for term in found.suggested}
    assert "inv_w0_squared[X,pendulum] = -" in found.impossible["resonance"]
    assert "never negative" in found.impossible["resonance"]
