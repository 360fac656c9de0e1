"""Effects of the tumble test, in SI, in the order in which they act; numbers of equations are those of README.md.

`run` has one value per datum: theta (the head's angle), a_i, a_p, a_o (along input, pendulous and output axis),
temperature, t, approach, g, and the means of temperature and time over the recording as temperature_0 and t_0.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects import effect
from tumble_test.positions import TumbleRun

of_head = partial(effect, on="tumble_angle_rad")
of_axis = partial(effect, on="tumble_elevation_rad")
of_sensor = partial(effect, on="tumble_indicated_m_s2", scope="channel")
of_output = partial(effect, on="tumble_output_v", scope="channel")
STANDARD = "model equation of IEEE Std 1293; plausible 1 to 100 ug per g2 or g4"


def alike(unit: str, size: float, *names: str) -> dict[str, Any]:
    """Parameters of the same unit and typical size."""
    return {"parameters": dict.fromkeys(names, unit), "typical": dict.fromkeys(names, size)}


@of_head("head-eccentricity", **alike("rad", 1e-5, "c1", "s1"), source="equation 6; plausible 1e-6 to 1e-4 rad")
def head_eccentricity(run: TumbleRun, c1: FloatArray, s1: FloatArray) -> FloatArray:
    """The head's graduation is off its axis: its angle errs by c1 cos(theta) + s1 sin(theta)."""
    return c1 * np.cos(run.theta) + s1 * np.sin(run.theta)


@of_head("head-ellipticity", **alike("rad", 5e-6, "c2", "s2"), source="equation 6; plausible 1e-6 to 3e-5 rad")
def head_ellipticity(run: TumbleRun, c2: FloatArray, s2: FloatArray) -> FloatArray:
    """The head's graduation is oval: its angle errs by c2 cos(2 theta) + s2 sin(2 theta)."""
    return c2 * np.cos(2.0 * run.theta) + s2 * np.sin(2.0 * run.theta)


@of_head("head-backlash", parameters={"b": "rad"}, typical={"b": 1e-5}, needs=("approach",))
def head_backlash(run: TumbleRun, b: FloatArray) -> FloatArray:
    """The plate stays behind its encoder: the angle is less by b when it was reached forwards, more backwards."""
    return -b * run.approach


@of_axis("axis-tilt", parameters={"beta": "rad"}, typical={"beta": 1e-4}, source="equation 1; 1e-6 to 1e-3 rad")
def axis_tilt(run: TumbleRun, beta: FloatArray) -> FloatArray:
    """The turning axis rises by beta: a sensor along it feels g sin(beta) at every angle."""
    return beta + 0.0 * run.theta


@of_axis("axis-wobble", **alike("rad", 1e-5, "wc", "ws"), source="equation 1")
def axis_wobble(run: TumbleRun, wc: FloatArray, ws: FloatArray) -> FloatArray:
    """The bearing's error motion lifts the turning axis by wc cos(theta) + ws sin(theta)."""
    return wc * np.cos(run.theta) + ws * np.sin(run.theta)


@of_sensor("cross-quadratic", **alike("s2/m", 1e-6, "K_pp", "K_oo", "K_po"), source=STANDARD)
def cross_quadratic(run: TumbleRun, K_pp: FloatArray, K_oo: FloatArray, K_po: FloatArray) -> FloatArray:
    """What acts across the input axis is rectified: K_pp a_p^2 + K_oo a_o^2 + K_po a_p a_o."""
    return K_pp * run.a_p**2 + K_oo * run.a_o**2 + K_po * run.a_p * run.a_o


@of_sensor("odd-quadratic", parameters={"K_oq": "s2/m"}, typical={"K_oq": 1e-6}, source=STANDARD)
def odd_quadratic(run: TumbleRun, K_oq: FloatArray) -> FloatArray:
    """The output bends in opposite senses for both signs: K_oq a_i |a_i|."""
    return K_oq * run.a_i * np.abs(run.a_i)


@of_sensor("scale-asymmetry", parameters={"k_a": "1"}, typical={"k_a": 1e-5}, source="1e-6 to 1e-4, as K1' there")
def scale_asymmetry(run: TumbleRun, k_a: FloatArray) -> FloatArray:
    """The scale factor differs between the signs of the input: k_a |a_i|."""
    return k_a * np.abs(run.a_i)


@of_sensor("fourth-order", parameters={"K4": "s6/m3"}, typical={"K4": 1e-8}, source=STANDARD)
def fourth_order(run: TumbleRun, K4: FloatArray) -> FloatArray:
    """The fourth power of the input enters: K4 a_i^4."""
    return K4 * run.a_i**4


@of_sensor("hysteresis", parameters={"h": "m/s2"}, typical={"h": 1e-4}, needs=("approach",))
def hysteresis(run: TumbleRun, h: FloatArray) -> FloatArray:
    """The hinge creeps: the bias is h more after a rising input, h less after a falling one."""
    return h * run.approach * np.sign(np.round(run.slope_i / run.g, 3))


@of_sensor("bias-temperature", parameters={"kT0": "m/s2/K"}, typical={"kT0": 1e-4}, needs=("temperature",))
def bias_temperature(run: TumbleRun, kT0: FloatArray) -> FloatArray:
    """The bias follows the temperature: kT0 (T - mean T)."""
    return kT0 * (run.temperature - run.temperature_0)


@of_sensor("bias-drift", parameters={"rate0": "m/s3"}, typical={"rate0": 1e-9}, needs=("time",))
def bias_drift(run: TumbleRun, rate0: FloatArray) -> FloatArray:
    """The bias drifts with time: rate0 (t - mean t)."""
    return rate0 * (run.t - run.t_0)


@of_output("scale-temperature", parameters={"kT1": "1/K"}, typical={"kT1": 1e-5}, needs=("temperature",))
def scale_temperature(run: TumbleRun, kT1: FloatArray) -> FloatArray:
    """The scale factor follows the temperature: the output is multiplied by 1 + kT1 (T - mean T)."""
    return kT1 * (run.temperature - run.temperature_0) * run.signal


@of_output("scale-drift", parameters={"rate1": "1/s"}, typical={"rate1": 1e-9}, needs=("time",))
def scale_drift(run: TumbleRun, rate1: FloatArray) -> FloatArray:
    """The scale factor drifts with time: the output is multiplied by 1 + rate1 (t - mean t)."""
    return rate1 * (run.t - run.t_0) * run.signal
