"""Faults strike a twin of the shipped rig: the runs it ends with are those of a rig without faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.keyence_lkg import Lkg3001
from procedures.sensing_axis.bench import SetPoint
from rigctl.core.errors import NotRecovered

DURING_S = 1048.0
"""Rig time in the middle of the first run."""

FAULTS: dict[str, tuple[str, dict[str, Any]]] = {
    "the meter does not answer": ("accelerometer", {"silent": {"nth": [12]}}),
    "the stage falls silent while its capture is read": ("stage", {"silent": {"nth": [300]}}),
    "a laser controller does not answer": ("lasers_a", {"silent": {"nth": [70]}}),
    "the stage loses its power while it oscillates": (
        "stage",
        {"power_cycle": {"at_s": DURING_S, "lasting_s": 30.0}},
    ),
    "the stage meets an obstacle": ("stage", {"following_error": {"at_s": DURING_S}}),
    "the meter's timer stands still for whole periods": (
        "accelerometer",
        {"clock_jump": {"at_s": DURING_S, "jump_s": 2.0}},
    ),
    "the rotation stage loses its power while nothing is asked of it": (
        "rotation",
        {"power_cycle": {"at_s": DURING_S, "lasting_s": 1.0}},
    ),
}


def measured(twin: Any) -> dict[str, dict[str, np.ndarray[Any, Any]]]:
    """Two runs, by key."""
    twin.session.operator.remount("X", "pendulum", 1)
    twin.session.operator.level(0.0)
    for theta_deg, frequency_hz in ((0.1, 1.0), (0.2, 0.5)):
        point = SetPoint("X", "pendulum", 1, theta_deg, frequency_hz, 4.0, 10.0, 20.0)
        twin.bench.run(twin.session, f"run {theta_deg}", point, before=lambda: None)
    return {run.key: twin.store.samples(run.run_id) for run in twin.store.runs(valid_only=True)}


@pytest.fixture
def undisturbed(make_twin: Callable[..., Any]) -> dict[str, Any]:
    return measured(make_twin())


@pytest.mark.parametrize(("instrument", "faults"), FAULTS.values(), ids=FAULTS)
def test_runs_after_a_fault_are_those_without_it(
    make_twin: Callable[..., Any], undisturbed: dict[str, Any], instrument: str, faults: dict[str, Any]
) -> None:
    twin = make_twin(faults={instrument: faults})
    runs = measured(twin)
    assert runs.keys() == undisturbed.keys()
    for key, samples in runs.items():
        for name, column in samples.items():
            np.testing.assert_array_equal(column, undisturbed[key][name], err_msg=f"{key} {name}")
    (attempt,) = twin.store.interrupted_runs()
    (fault,) = (event.data for event in twin.store.events("fault"))
    assert not attempt.valid
    assert attempt.reason == f"{fault['error']}: {fault['text']}"
    assert fault["instrument"] == instrument


def test_a_stage_set_to_inches_in_a_run_is_waited_for(
    make_twin: Callable[..., Any], undisturbed: dict[str, Any]
) -> None:
    twin = make_twin(faults={"stage": {"wrong_unit": {"at_s": DURING_S, "lasting_s": 100.0}}})
    runs = measured(twin)
    for key, samples in runs.items():
        np.testing.assert_array_equal(samples["stage_x_mm"], undisturbed[key]["stage_x_mm"])
    (attempt,) = twin.store.interrupted_runs()
    assert "stage: axis X counts in 'in'" in attempt.reason
    # Tried many times, told once.
    (lost,), (back,) = twin.store.events("instrument-lost"), twin.store.events("instruments-back")
    assert "counts in 'in'" in lost.data["text"]
    assert back.data["tries"] > 3


def test_strong_effects_and_noise_are_never_taken_for_faults(make_twin: Callable[..., Any]) -> None:
    effects = {
        "quadratic": {"K2": 0.1},
        "time-skew": {"tau": 0.02},
        "yaw": {"psi1": 1e-3},
        "laser-nonlinearity": {"q": 1.0},
        "laser-crosstalk": {"chi": 1e-2},
        "mains-pickup": {"amplitude": 5e-3, "frequency": 3.3},
        "cable-hysteresis": {"h": 1e-4},
    }
    ground = {"asd_m_s2_rthz": 1e-5, "bump_asd_m_s2_rthz": 1e-3}
    twin = make_twin(effects=effects, ground=ground)
    twin.session.operator.remount("X", "pendulum", 1)
    twin.session.operator.level(0.0)
    for theta_deg, frequency_hz in ((0.1, 0.1), (-0.5, 0.6), (3.0, 1.0), (4.0, 2.0)):
        point = SetPoint("X", "pendulum", 1, theta_deg, frequency_hz, 1.0, 20.0, 20.0)
        record = twin.bench.run(twin.session, f"run {theta_deg}", point, before=lambda: None)
        assert record.valid
    assert twin.store.interrupted_runs() == twin.store.events("fault") == []


def test_a_wrong_sample_of_an_instrument_is_named_and_its_run_repeated(
    make_twin: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, undisturbed: dict[str, Any]
) -> None:
    twin = make_twin()
    finish, spoilt = Lkg3001.finish, []

    def one_wrong_digit(meter: Lkg3001) -> Any:
        record = finish(meter)
        if meter.name == "lasers_a" and not spoilt:
            spoilt.append(record.values[77, 0])
            record.values[77, 0] += 80.0
        return record

    monkeypatch.setattr(Lkg3001, "finish", one_wrong_digit)
    runs = measured(twin)
    (attempt,) = twin.store.interrupted_runs()
    assert attempt.reason.startswith("ImplausibleSample: lasers_a: laser_1_mm, sample ")
    # Not by its number: it stores a little longer than the others record.
    assert "80 mm away from its neighbours" in attempt.reason
    for key, samples in runs.items():
        np.testing.assert_array_equal(samples["laser_1_mm"], undisturbed[key]["laser_1_mm"])


@pytest.mark.parametrize("fault", ["emergency_stop", "limit_hit"])
def test_nothing_moves_after_a_safety_stop_when_nobody_is_there(make_twin: Callable[..., Any], fault: str) -> None:
    twin = make_twin(faults={"stage": {fault: {"at_s": DURING_S}}})
    with pytest.raises(
        NotRecovered, match=r"stage: stopped by a safety device \((emergency stop|(positive|negative) hard limit)"
    ):
        measured(twin)
    assert not twin.bench.linear.is_homed()
    assert twin.store.runs() == []
