"""The `[world]` table: defaults of the twin, and refusals that say what is known."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import pytest
from pydantic import ValidationError

from simulators.worlds.bench_settings import BenchSettings, isa_twin
from simulators.worlds.effect_sizes import EFFECTS


def with_effects(effects: dict[str, dict[str, float]]) -> BenchSettings:
    return BenchSettings.model_validate(isa_twin().model_dump() | {"effects": effects})


def test_the_twin_has_the_published_axes_as_unit_vectors() -> None:
    axis = isa_twin().sensors["X"].true_axis
    assert math.hypot(*axis) == pytest.approx(1.0, abs=1e-15)
    assert axis[2] / axis[0] == pytest.approx(1.2822e-2 / 0.99992)


def test_the_twin_has_the_stage_roll() -> None:
    assert isa_twin().size("roll-gravity", "rho1") == 9.7e-5


def test_the_twin_resonates_as_the_configuration_says() -> None:
    w0 = 2.0 * math.pi * 4.53
    assert isa_twin().resonance("X", "pendulum") == pytest.approx((w0**-2, 1.0 / (10.0 * w0)))


def test_every_effect_can_be_given_in_every_form_it_has() -> None:
    member = {"[AXIS]": "[X]", "[AXIS,CONFIGURATION]": "[X,flag]", "[HEAD]": "[laser_2_mm]", "": ""}
    for effect, form in EFFECTS.items():
        if effect == "resonance":
            continue
        settings = with_effects({effect: {f"{p}{member[form.scope.value]}": 0.5 for p in form.parameters}})
        name = member[form.scope.value].strip("[]")
        assert all(settings.size(effect, parameter, name) == 0.5 for parameter in form.parameters)


def test_its_own_size_comes_before_the_one_for_all() -> None:
    settings = with_effects({"thermal-gain": {"kT": 1e-4, "kT[Y]": 2e-4}})
    assert settings.size("thermal-gain", "kT", "X") == 1e-4
    assert settings.size("thermal-gain", "kT", "Y") == 2e-4


def test_an_absent_effect_has_size_zero() -> None:
    assert with_effects({"thermal-gain": {"kT[Y]": 2e-4}}).size("thermal-gain", "kT", "X") == 0.0
    assert with_effects({}).size("yaw", "psi1") == 0.0


def test_a_resonance_given_as_an_effect_replaces_the_sensors_own() -> None:
    settings = with_effects({"resonance": {"inv_w0_squared[X,flag]": 1e-3, "damping[X,flag]": 1e-3}})
    assert settings.resonance("X", "flag") == (1e-3, 1e-3)
    assert settings.resonance("X", "pendulum") == (0.0, 0.0)


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"wobble": {"a": 1.0}}, ["unknown effect 'wobble'", "roll-gravity"]),
        ({"yaw": {"psi": 1.0}}, ["'yaw' has no parameter 'psi'", "psi1"]),
        ({"thermal-gain": {"kT[W]": 1.0}}, ["'kT[W]'", "kT[X] or kT[Y] or kT[Z]"]),
        ({"roll-gravity": {"rho1[X]": 1.0}}, ["'rho1[X]'", "write rho1"]),
        ({"laser-cosine": {"dt[X]": 1.0}}, ["'dt[X]'", "dt[laser_1_mm]"]),
        ({"resonance": {"inv_w0_squared": 1e-3}}, ["'resonance' of X", "damping"]),
    ],
)
def test_what_nature_does_not_know_is_refused(effects: dict[str, dict[str, float]], words: list[str]) -> None:
    with pytest.raises(ValidationError) as refusal:
        with_effects(effects)
    assert all(word in str(refusal.value) for word in words)


@pytest.mark.parametrize(
    "change",
    [
        {"colour": 1},
        {"scatter_arcsec": -1.0},
        {"sensors": {"X": {"cube_axis": "W", "true_axis": [1, 0, 0]}}},
        {"sensors": {"X": {"cube_axis": "X", "true_axis": [0, 0, 0]}}},
    ],
)
def test_bad_settings_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        BenchSettings.model_validate(isa_twin().model_dump() | change)


def test_a_rig_file_can_say_it_all() -> None:
    table = tomllib.loads(
        """
        seed = 7
        [sensors.X]
        cube_axis = "X"
        true_axis = [1.0, 0.0, 0.0]
        flag = { frequency_hz = 3.0, gain_v_per_m_s2 = 50.0 }
        [lasers.laser_1_mm]
        position = "+x"
        [effects.thermal-gain]
        "kT[X]" = 1e-3
        """
    )
    settings = BenchSettings.model_validate(table)
    assert settings.sensors["X"].flag.gain_v_per_m_s2 == 50.0
    assert settings.size("thermal-gain", "kT", "X") == 1e-3
