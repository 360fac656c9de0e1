"""The model's equations against Fourier coefficients and against the world's own physics."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from tumble_test.model import Bench, TumbleModel, recorded
from tumble_test.observables import Reduced
from tumble_test.positions import OUTS, case_axes
from tumble_test.world import HeadSettings, SensorSettings, TumbleBench, TumbleSettings

from simulators.clock import VirtualClock
from simulators.wiring import TriggerLine

G = 9.81
QUIET = SensorSettings(scale_v_per_g=2.0, white_ug_rthz=0.0, slow_ug=0.0)


def at(out: str, clocking_deg: float, angles_deg: list[float], sensors: str = "xyz") -> list[Reduced]:
    """Runs with 1 V per m/s2 along each input axis, so that a fit has a gain to begin with."""
    found = []
    for angle_deg in angles_deg:
        theta = np.deg2rad(angle_deg)
        along = case_axes(out, np.deg2rad(clocking_deg)) @ np.array([0.0, np.sin(theta), np.cos(theta)])
        mean_v = {name: G * float(along["xyz".index(name)]) for name in sensors}
        given = {"out": out, "clocking_deg": clocking_deg, "mounting": 1, "angle_deg": angle_deg, "approach": 1}
        found.append(Reduced(f"{out} {angle_deg:g}", given, mean_v, dict.fromkeys(sensors, 1e-6), 10.0))
    return found


def test_harmonics_of_the_angle_are_those_of_the_readme() -> None:
    """Equation 5."""
    angles = [15.0 * place for place in range(24)]
    model = TumbleModel(recorded(at("+z", 0.0, angles, "x"), Bench(G, 1e-4, 0.0)))
    K1, K0, delta_o, K2, K3, K_ip = 0.5, 0.01, 2e-4, 3e-5, -4e-6, 5e-5
    sizes = {"K1[x]": K1, "K0[x]": K0, "delta_o[x]": delta_o, "K2[x]": K2, "K3[x]": K3, "K_ip[x]": K_ip}
    output = model.predict(np.array([sizes.get(each.name, 0.0) for each in model.parameters]))
    waves = np.fft.rfft(output) / len(angles)
    cos, sin = 2.0 * waves.real, -2.0 * waves.imag
    assert waves[0].real == pytest.approx(K1 * (K0 + K2 * G**2 / 2), rel=1e-12)
    assert (sin[1], cos[1]) == pytest.approx((K1 * G * (1 + 0.75 * K3 * G**2), K1 * G * delta_o), rel=1e-12)
    assert (sin[2], cos[2]) == pytest.approx((K1 * K_ip * G**2 / 2, -K1 * K2 * G**2 / 2), rel=1e-12)
    assert sin[3] == pytest.approx(-K1 * K3 * G**3 / 4, rel=1e-12)


def test_what_positions_cannot_tell_is_held() -> None:
    held = TumbleModel(recorded(at("+z", 0.0, [0.0, 90.0, 180.0, 270.0], "x"), Bench(G, 1e-4, 0.0)))
    free = [each.name for each in held.parameters if not each.fixed]
    assert free == ["K1[x]", "K0[x]", "delta_o[x]", "K2[x]", "seat_1[1]"]


@pytest.mark.parametrize(("out", "clocking_deg"), list(product(OUTS, (0.0, 90.0, 200.0))))
def test_model_and_world_agree_in_every_mounting(out: str, clocking_deg: float) -> None:
    """To second order in the angles, of which the model has the first."""
    bends = {"k2": 300.0, "k3": -200.0, "k_ip": 400.0, "k_io": -500.0}
    sensor = QUIET.model_copy(update={"bias_mg": 1.0, "bends_ug": bends, "turned_urad": (50.0, -30.0, 20.0)})
    nature = TumbleSettings(kind="tumble-test", seed=1, g_m_s2=G, seat_urad=0.0, sensors=dict.fromkeys("xyz", sensor))
    bench = TumbleBench(nature, VirtualClock(), TriggerLine())
    bench.operate({"remount": {"axis": out, "configuration": f"{clocking_deg:g} deg", "mounting": 1}})
    angles = [0.0, 40.0, 130.0, 250.0, 310.0]
    model = TumbleModel(recorded(at(out, clocking_deg, angles), Bench(G, 1e-4, 0.0)))
    standard_g, turned = 9.80665, {"x": 50e-6, "y": -30e-6, "z": 20e-6}
    sizes = {"K1": 2.0 / standard_g, "K0": 1e-3 * standard_g, "K2": 3e-4 / standard_g, "K3": -2e-4 / standard_g**2}
    sizes |= {"K_ip": 4e-4 / standard_g, "K_io": -5e-4 / standard_g}
    values = []
    for each in model.parameters:
        name, _, label = each.name.partition("[")
        axis = "xyz".find(label[0])
        of = {"delta_p": turned["xyz"[(axis + 1) % 3]], "delta_o": turned["xyz"[(axis + 2) % 3]]}
        values.append({**sizes, **of}.get(name, 0.0))
    seen = []
    for place, angle_deg in enumerate(angles):
        bench.axes["rotation"].place(100.0 * place, angle_deg)
        seen += [bench.volts(f"{name}_v")(np.array([100.0 * place + 50.0]))[0] for name in "xyz"]
    assert model.predict(np.array(values)) == pytest.approx(np.array(seen), abs=1e-7)


def test_the_servo_loop_rings_after_a_turn_and_settles() -> None:
    nature = TumbleSettings(kind="tumble-test", seed=1, sensors={"x": QUIET}, head=HeadSettings(), seat_urad=0.0)
    bench = TumbleBench(nature, VirtualClock(), TriggerLine())
    bench.operate({"remount": {"axis": "+z", "configuration": "0 deg", "mounting": 1}})
    arrived_s = bench.axes["rotation"].move_to(10.0, 90.0, 30.0, 1000.0)
    soon, late = (bench.volts("x_v")(np.array([arrived_s + after_s]))[0] for after_s in (0.002, 5.0))
    assert 1e-7 < abs(soon - late) < 1e-2
    assert late == pytest.approx(2.0 * nature.g_m_s2 / 9.80665, rel=1e-12)


def test_effects_act_as_the_world_has_them() -> None:
    """Eccentricity, backlash and tilt: each alone in the world, and in the model with the same size and sign."""
    from tumble_test import effects

    for settings, effect, sizes in (
        ({"first_urad": (30.0, -20.0)}, effects.head_eccentricity, {"c1": 3e-5, "s1": -2e-5}),
        ({"second_urad": (30.0, -20.0)}, effects.head_ellipticity, {"c2": 3e-5, "s2": -2e-5}),
        ({"tilt_urad": 300.0}, effects.axis_tilt, {"beta": 3e-4}),
        ({"wobble_urad": (30.0, -20.0)}, effects.axis_wobble, {"wc": 3e-5, "ws": -2e-5}),
    ):
        nature = TumbleSettings(
            kind="tumble-test", seed=1, g_m_s2=G, seat_urad=0.0, sensors=dict.fromkeys("xyz", QUIET),
            head=HeadSettings(**settings),
        )  # fmt: skip
        bench = TumbleBench(nature, VirtualClock(), TriggerLine())
        bench.operate({"remount": {"axis": "-y", "configuration": "30 deg", "mounting": 1}})
        data = recorded(at("-y", 30.0, [20.0, 110.0]), Bench(G, 1e-4, 0.0)).run
        errs = effect(replace(data, signal=np.zeros(6)), **{name: np.full(6, size) for name, size in sizes.items()})
        nothing = np.zeros(6)
        angle = (errs, nothing) if effect.on == "tumble_angle_rad" else (nothing, errs)
        seen = []
        for place, angle_deg in enumerate((20.0, 110.0)):
            bench.axes["rotation"].place(100.0 * place, angle_deg)
            seen += [bench.volts(f"{name}_v")(np.array([100.0 * place + 50.0]))[0] for name in "xyz"]
        felt = data.standing(*angle, np.zeros((6, 3))).a_i
        assert 2.0 / 9.80665 * felt == pytest.approx(np.array(seen), abs=1e-12), effect.id
