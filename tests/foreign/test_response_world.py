"""The second world of the shaken accelerometer, and what the commands say of recordings made in it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.foreign.response_score import RESPONSE
from tests.foreign.response_trial import KNOWN, UNKNOWN, Noise, drawn, size_of, write
from tests.foreign.response_world import G_M_S2, accel_v
from tests.foreign.sessions import command, run
from tests.foreign.trials import summary, tried

QUIET = Noise(accel_v=1e-7, laser_m=1e-11, stage_m=1e-13)
"""Some thousand times below a bench's noise."""
BASELINE_P = 1e-3


def test_both_worlds_have_the_same_conventions(tmp_path: Path) -> None:
    """Without effects and almost without noise the response is flat: parts in 1e8 are seen."""
    trial = drawn(1)
    write(replace(trial, sensor=trial.sensor.with_effects({}), noise=QUIET), 1, tmp_path / "quiet")
    store = str(tmp_path / "quiet.rig.sqlite")
    run("import", str(tmp_path / "quiet"), "--store", store)
    compared = command("compare", store)
    assert compared["p_value"] > BASELINE_P, compared["channels"]


def test_the_sensor_has_the_response_of_the_page() -> None:
    """S = V / (-w^2 X): gravity by pitch -g pi1 / w^2, a delay, a pole and a resonance behind it."""
    trial = drawn(1)
    effects = {"pi1": 1e-3, "skew_s": 1e-3, "lag_s": 2e-3, "inv_w0_squared": 2e-5, "damping": 4e-3}
    design = replace(trial.design, direction=np.ones_like(trial.design.direction))
    samples = accel_v(design, trial.sensor.with_effects(effects))
    for number, frequency_hz in enumerate(design.frequency_hz):
        w = 2.0 * np.pi * frequency_hz
        phase = w * design.time_s + design.phase_rad[number]
        basis = np.column_stack([np.ones_like(phase), np.sin(phase), np.cos(phase)])
        _, in_phase, quadrature = np.linalg.lstsq(basis, samples[number], rcond=None)[0]
        found = -(in_phase + 1j * quadrature) / (w**2 * design.amplitude_m[number])
        pitched = 1.0 - G_M_S2 * 1e-3 / w**2
        behind = np.exp(-1e-3j * w) / (1.0 + 2e-3j * w) / (1.0 - w**2 * 2e-5 + 4e-3j * w)
        assert found == pytest.approx(trial.sensor.gain * pitched * behind, rel=1e-9)


def test_sizes_are_as_they_were_drawn() -> None:
    """8 to 20 sigma each, to a per cent for effects that are not quite linear."""
    for trial in map(drawn, range(8)):
        flat = trial.sensor.with_effects({})
        for effect in trial.hidden:
            others = {name for other in trial.hidden if other != effect for name in (KNOWN | UNKNOWN)[other]}
            own = {name: value for name, value in trial.parameters.items() if name not in others}
            assert 7.9 <= size_of(trial.design, flat, trial.noise, own) <= 20.2


def test_a_trial_scores_what_was_said() -> None:
    """One known effect and one of no catalogue; the rest is `python -m tests.foreign.trials`."""
    known, unknown = tried(RESPONSE, 6), tried(RESPONSE, 4)
    assert known["all_named"]
    assert known["invented"] == []
    assert known["verdict"] == "effect"
    # Within its uncertainty, once in 4e5 by chance.
    assert all(abs(pull) < 5.0 for pull in known["pulls"].values())
    assert len(known["pulls"]) == 1
    assert unknown["unknown_hidden"]
    assert unknown["unknown_said"]
    assert unknown["invented"] == []
    assert "one effect named      1 of 1" in summary([json.loads(json.dumps(trial)) for trial in (known, unknown)])
