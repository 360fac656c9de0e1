"""The second world of the sensing axis, and what the commands say of recordings made in it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.core.arrays import ComplexArray
from tests.foreign.isa_bundle import Noise, write
from tests.foreign.isa_score import SENSING_AXIS
from tests.foreign.isa_trial import Sight, drawn
from tests.foreign.isa_world import Bench, Design, readings
from tests.foreign.sessions import command, run
from tests.foreign.trials import summary, tried

QUIET = Noise(
    white_v=1e-7, flicker_v_rthz=1e-9, exponent=1.0, bump_v_rthz=0.0, drifting_v=1e-7, laser_m=1e-11, stage_m=1e-13
)
"""Some thousand times below a bench's noise."""
BASELINE_P = 1e-3


def test_both_worlds_have_the_same_conventions(tmp_path: Path) -> None:
    """Without effects and almost without noise the baseline describes this world: 0.001 deg of a beam is seen."""
    trial = drawn(1)
    write(trial.design, trial.bench.with_effects({}), QUIET, 1, tmp_path / "quiet")
    store = str(tmp_path / "quiet.rig.sqlite")
    run("import", str(tmp_path / "quiet"), "--store", store)
    compared = command("compare", store)
    assert compared["p_value"] > BASELINE_P, compared["channels"]


def amplitudes(design: Design, bench: Bench) -> ComplexArray:
    """The sensor's complex amplitude in every run, relative to the displacement's phase."""
    phase = 2.0 * np.pi * design.frequency_hz[:, None] * design.time_s + bench.phase_rad[:, None]
    found = []
    for own, samples in zip(phase, readings(design, bench).accel_v, strict=True):
        shapes = [np.ones_like(own), *(part(n * own) for n in (1, 2, 3) for part in (np.sin, np.cos))]
        fitted = np.linalg.lstsq(np.column_stack(shapes), samples, rcond=None)[0]
        found.append(complex(fitted[1], fitted[2]))
    return np.array(found)


def test_the_integrated_sensor_has_the_transfer_function_of_the_page() -> None:
    trial = drawn(2)
    design, bench = trial.design, trial.bench.with_effects({})
    inverse, damping = 1.0 / (2.0 * np.pi * 4.0) ** 2, 1.0 / (2.0 * np.pi * 4.0 * 8.0)
    effects = {f"inv_w0_squared[{where}]": inverse for where in ("flag", "pendulum")}
    effects |= {f"damping[{where}]": damping for where in ("flag", "pendulum")}
    number = int(np.argmax(~design.lasers))
    w = 2.0 * np.pi * design.frequency_hz[number]
    expected = amplitudes(design, bench)[number] / (1.0 - w**2 * inverse + 1j * w * damping)
    found = amplitudes(design, bench.with_effects(effects))[number]
    assert found == pytest.approx(expected, rel=2e-5)


def test_a_roll_has_the_shape_of_the_papers_equation_5() -> None:
    """k g rho1 A cos(theta - theta0), in phase and at every frequency."""
    trial = drawn(2)
    design, bench = trial.design, trial.bench.with_effects({})
    rho1 = 1e-4
    added = amplitudes(design, bench.with_effects({"rho1": rho1})) - amplitudes(design, bench)
    per_g_rho1 = np.where(design.flag, bench.gain[True], bench.gain[False]) * 9.803 * rho1
    expected = per_g_rho1 * design.amplitude_m * np.cos(design.theta_rad)
    assert np.all(np.abs(added - expected) < 0.02 * per_g_rho1 * 5e-3)


def test_sizes_are_in_sigma_and_linear() -> None:
    trial = drawn(4)
    bench = trial.bench.with_effects({})
    (name, size), *_ = trial.hidden.items()
    assert 8.0 <= size <= 20.0
    doubled = {parameter: 2.0 * value for parameter, value in trial.parameters.items()}
    assert Sight(trial.design, bench, trial.noise).size(doubled) == pytest.approx(2.0 * size, rel=0.01), name


@pytest.mark.parametrize(
    ("seed", "form"), [(436, "k * run.signal**3"), (509, 'k * (run.column("humidity_percent") -')]
)
def test_an_unknown_is_drafted_as_what_the_world_has(tmp_path: Path, seed: int, form: str) -> None:
    """Nothing is named beside it; the drafted effect is of its form, and brings the size."""
    trial = drawn(seed)
    write(trial.design, trial.bench, trial.noise, seed, tmp_path / "elsewhere")
    store, draft = str(tmp_path / "elsewhere.rig.sqlite"), tmp_path / "draft.py"
    run("import", str(tmp_path / "elsewhere"), "--store", store)
    found = command("diagnose", store, "--draft", str(draft))
    assert (found["verdict"], found["suggested"]) == ("unknown", [])
    assert form in draft.read_text()
    run("model", "add", store, "drafted", "--plugin", str(draft))
    fit = command("fit", store, "--plugin", str(draft))
    (true,) = trial.parameters.values()
    assert abs(fit["parameters"]["k"]["value"] - true) < 3.5 * fit["parameters"]["k"]["sigma"]


def test_a_trial_scores_what_was_said() -> None:
    """One known effect and one of no catalogue; the rest is `python -m tests.foreign.trials`."""
    known, unknown = tried(SENSING_AXIS, 3), tried(SENSING_AXIS, 11)
    assert known["all_named"]
    assert known["invented"] == []
    assert known["verdict"] == "effect"
    assert unknown["unknown_hidden"]
    assert unknown["unknown_said"]
    assert unknown["invented"] == []
    assert "one effect named      1 of 1" in summary([json.loads(json.dumps(trial)) for trial in (known, unknown)])
