"""Faults strike a twin of the shipped rig: the runs it ends with are those of a rig without faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from procedures.bench import SetPoint

FAULTS: dict[str, tuple[str, dict[str, Any]]] = {
    "the meter does not answer": ("accelerometer", {"silent": {"nth": [12]}}),
    "the stage falls silent while its capture is read": ("stage", {"silent": {"nth": [300]}}),
    "a laser controller does not answer": ("lasers_a", {"silent": {"nth": [15]}}),
}


def measured(twin: Any) -> dict[str, dict[str, np.ndarray[Any, Any]]]:
    """Two runs, by key."""
    twin.session.operator.remount("X", "pendulum", 1)
    twin.session.operator.level(0.0)
    for theta_deg, frequency_hz in ((0.1, 1.0), (0.2, 0.5)):
        point = SetPoint("X", "pendulum", 1, theta_deg, frequency_hz, 4.0, 10.0, 20.0)
        twin.bench.run(twin.session, f"run {theta_deg}", point, before=lambda: None)
    return {run.key: twin.store.samples(run.run_id) for run in twin.store.runs(valid_only=True)}


@pytest.fixture(scope="module")
def undisturbed() -> dict[str, Any]:
    return {}


@pytest.mark.parametrize(("instrument", "faults"), FAULTS.values(), ids=FAULTS)
def test_runs_after_a_fault_are_those_without_it(
    make_twin: Callable[..., Any], undisturbed: dict[str, Any], instrument: str, faults: dict[str, Any]
) -> None:
    if not undisturbed:
        undisturbed.update(measured(make_twin()))
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
