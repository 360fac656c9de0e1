"""Every effect against the formula of its signature: channel, harmonic and phase, power of w, sign."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.effects.catalogue import catalogue, chosen
from rigctl.experiments.sensing_axis.model.components import observed, series_of
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, Amplitudes, RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_package
from rigctl.files.package import HeadSettings, Package

G, GAIN, DC, THETA0, A, TILT = 9.8, 80.0, 0.7, 0.004, 5e-3, 5.0
HEADS = {
    f"laser_{i}_mm": HeadSettings(position=position, tilt_deg=TILT)  # type: ignore[arg-type]
    for i, position in ((1, "+x"), (2, "+y"), (3, "+z"))
}
# An amplitude is a sum of 32 products with weights that add up to 2 at most, rounded to half an epsilon at each: the
# bound on its error, in units of the largest reading.
ROUNDING = 32.0 * np.finfo(np.float64).eps
SERIES = {(each.channel, each.component): i for i, each in enumerate(series_of(tuple(HEADS)))}
Expected = Mapping[tuple[str, str], Any]


@dataclass(frozen=True)
class Conditions:
    """What the formulas are made of, one value per run."""

    theta: np.ndarray
    w: np.ndarray
    approach: np.ndarray
    temperature: np.ndarray
    start: np.ndarray

    @property
    def d(self) -> np.ndarray:
        return self.theta - THETA0

    @property
    def warmer(self) -> np.ndarray:
        return np.asarray(self.temperature - self.temperature.mean())

    @property
    def later(self) -> np.ndarray:
        return np.asarray(self.start - self.start.mean())

    @property
    def s(self) -> np.ndarray:
        """The baseline's in-phase amplitude [V]."""
        return np.asarray(GAIN * A * self.w**2 * np.sin(self.d))

    def tilted(self, shift: np.ndarray) -> np.ndarray:
        """What a change of theta - theta0 adds to it."""
        return np.asarray(GAIN * A * self.w**2 * (np.sin(self.d + shift) - np.sin(self.d)))


THETA = np.array([-0.02, -0.005, 0.004, 0.012, 0.02, 0.6])
RUNS = Conditions(
    THETA,
    2 * np.pi * np.array([0.3, 0.6, 0.5, 0.3, 0.6, 0.5]),
    np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0]),
    np.array([20.0, 20.4, 19.5, 21.0, 20.1, 19.9]),
    np.array([0.0, 100.0, 250.0, 300.0, 450.0, 500.0]),
)


@pytest.fixture(scope="module")
def package() -> Package:
    return recorded_package(Header("sensing-axis"))


def model_of(package: Package, effect: str) -> RecordingModel:
    nothing = Amplitudes(np.zeros(HARMONICS + 1, np.complex128), np.ones(HARMONICS + 1))
    runs = [
        RunObservables(
            run_id=str(i),
            axis="X",
            configuration="pendulum",
            mounting=1,
            theta_rad=RUNS.theta[i],
            approach=RUNS.approach[i],
            frequency_hz=RUNS.w[i] / (2 * np.pi),
            temperature_c=RUNS.temperature[i],
            start_s=RUNS.start[i],
            duration_s=40.0,
            motion_m=np.array([-1j * A, 0.0, 0.0]),
            accel_v=nothing,
            lasers_m=dict.fromkeys(HEADS, nothing),
            faces={},
        )
        for i in range(len(THETA))
    ]
    return RecordingModel(runs, package, HEADS, G, chosen("sensing-axis", [effect]))


def in_phase(values: Any) -> Expected:
    return {("accel_v", "nu in-phase"): values}


def both(values: np.ndarray) -> Expected:
    return {("accel_v", "nu in-phase"): values.real, ("accel_v", "nu quadrature"): values.imag}


def dc_and_twice(values: Any) -> Expected:
    return {("accel_v", "DC"): values, ("accel_v", "2 nu in-phase"): values}


def seen(shift: Any, r: Conditions) -> Expected:
    """What the heads at +x, +y and +z read more of the motion when the cube turns by `shift`; the beams lean in z."""
    t = np.radians(TILT)
    side = -(np.tan(r.theta + shift) - np.tan(r.theta)) * A / np.cos(t)
    return {("laser_2_mm", "nu in-phase"): side}


def resonant(r: Conditions, p: Mapping[str, float]) -> np.ndarray:
    return np.asarray(r.s / (1 - r.w**2 * p["inv_w0_squared"] + 1j * r.w * p["damping"]) - r.s)


SIGNATURES: dict[str, tuple[dict[str, float], Callable[[Conditions, Any], Expected]]] = {
    "encoder-eccentricity": (
        {"e1": 2e-5, "e2": -3e-5},
        lambda r, p: {
            **in_phase(r.tilted(shift := p["e1"] * np.cos(r.theta) + p["e2"] * np.sin(r.theta))),
            **seen(shift, r),
        },
    ),
    "cable-hysteresis": (
        {"h": 3e-5},
        lambda r, p: {**in_phase(r.tilted(p["h"] * r.approach)), **seen(p["h"] * r.approach, r)},
    ),
    "null-drift": ({"rate": 1e-7}, lambda r, p: in_phase(r.tilted(-p["rate"] * r.later))),
    "yaw": ({"psi1": 1e-5}, lambda r, p: dc_and_twice(0.5 * GAIN * p["psi1"] * A**2 * r.w**2 * np.cos(r.d))),
    "roll-gravity": ({"rho1": 1e-4}, lambda r, p: in_phase(GAIN * G * p["rho1"] * A * np.cos(r.d))),
    "pitch-gravity": ({"pi1": 1e-4}, lambda r, p: in_phase(GAIN * G * p["pi1"] * A * np.sin(r.d))),
    "bench-recoil": ({"c": 1e-6}, lambda r, p: in_phase(GAIN * G * p["c"] * A * r.w**2 * np.cos(r.d))),
    "yaw-lever": (
        {"lever_cos": 1e-4, "lever_sin": -2e-4},
        lambda r, p: in_phase(GAIN * A * r.w**2 * (p["lever_cos"] * np.cos(r.d) + p["lever_sin"] * np.sin(r.d))),
    ),
    "quadratic": ({"K2": 0.1}, lambda r, p: dc_and_twice(0.5 * p["K2"] * r.s**2 / GAIN)),
    "axis-tilt": (
        {"eps_cos": 1e-4, "eps_sin": -2e-4},
        lambda r, p: {("accel_v", "DC"): GAIN * G * (p["eps_cos"] * np.cos(r.d) + p["eps_sin"] * np.sin(r.d))},
    ),
    "resonance": ({"inv_w0_squared": 2e-3, "damping": 5e-3}, lambda r, p: both(resonant(r, p))),
    "time-skew": ({"tau": 2e-3}, lambda r, p: both(r.s * (np.exp(-1j * r.w * p["tau"]) - 1.0))),
    "thermal-gain": (
        {"kT": 1e-3},
        lambda r, p: {**in_phase(r.s * p["kT"] * r.warmer), ("accel_v", "DC"): DC * p["kT"] * r.warmer},
    ),
    "gain-drift": (
        {"rate": 1e-6},
        lambda r, p: {**in_phase(r.s * p["rate"] * r.later), ("accel_v", "DC"): DC * p["rate"] * r.later},
    ),
    "thermal-bias": ({"bT": 1e-3}, lambda r, p: {("accel_v", "DC"): p["bT"] * r.warmer}),
    "bias-drift": ({"rate": 1e-6}, lambda r, p: {("accel_v", "DC"): p["rate"] * r.later}),
}


@pytest.mark.parametrize("effect", SIGNATURES)
def test_the_accelerometer_and_the_heads_change_as_the_formula_says(package: Package, effect: str) -> None:
    sizes, formula = SIGNATURES[effect]
    change = changed(package, effect, sizes)
    expected = np.zeros_like(change)
    for key, values in formula(RUNS, sizes).items():
        expected[:, SERIES[key]] = values
    # Yaw turns the cube within the period: what the heads see of that is compared with the world elsewhere.
    columns = slice(None) if effect != "yaw" else slice(7)
    scale = np.abs(expected).max(axis=0) + 1e-4 * np.abs(expected).max()
    assert np.abs((change - expected) / scale)[:, columns].max() < 1e-3


@pytest.mark.parametrize("head", [1, 2, 3])
def test_a_beams_tilt_scales_its_head_by_the_ratio_of_cosines(package: Package, head: int) -> None:
    name, dt = f"laser_{head}_mm", 1e-3
    change = changed(package, "laser-cosine", {"dt": dt}, head=name)
    t = np.radians(TILT)
    before = {1: A * np.ones(6), 2: -A * np.tan(THETA), 3: 0.0 * THETA}[head] / np.cos(t)
    after = before * np.cos(t) / np.cos(t + dt)
    if head == 3:
        # The face that looks up stays level: it tells nothing of the motion, whatever the beam.
        assert np.abs(change).max() < 1e-15
        return
    expected = np.zeros_like(change)
    expected[:, SERIES[name, "nu in-phase"]] = after - before
    np.testing.assert_allclose(change, expected, rtol=1e-6, atol=1e-15)


def test_a_curved_head_shows_twice_the_frequency_as_the_square_of_its_reading(package: Package) -> None:
    change = changed(package, "laser-nonlinearity", {"q": 0.03}, head="laser_1_mm")
    expected = np.zeros_like(change)
    expected[:, SERIES["laser_1_mm", "2 nu in-phase"]] = 0.5 * 0.03 * (A / np.cos(np.radians(TILT))) ** 2
    np.testing.assert_allclose(change, expected, rtol=1e-9, atol=ROUNDING * A)


def test_only_the_side_head_sees_the_main_motion_by_crosstalk(package: Package) -> None:
    model = model_of(package, "laser-crosstalk")
    assert [name for name in (each.name for each in model.parameters) if name.startswith("chi")] == [
        "chi[laser_2_mm]"
    ]
    change = changed(package, "laser-crosstalk", {"chi": 1e-4}, head="laser_2_mm")
    expected = np.zeros_like(change)
    expected[:, SERIES["laser_2_mm", "nu in-phase"]] = 1e-4 * A
    np.testing.assert_allclose(change, expected, rtol=1e-9, atol=ROUNDING * A)


def test_every_effect_of_the_catalogue_has_its_formula_here() -> None:
    elsewhere = {"laser-cosine", "laser-nonlinearity", "laser-crosstalk", "mains-pickup"}
    assert {*SIGNATURES, *elsewhere} == set(catalogue("sensing-axis"))


def test_a_quadratic_sensor_squares_the_sum_of_the_forces(package: Package) -> None:
    """Roll and K2 together give their product at twice the frequency, whatever the order they are named in."""
    one, other = (
        prediction(package, ids, {"rho1": 1e-3, "K2[X]": 0.1})
        for ids in (["roll-gravity", "quadratic"], ["quadratic", "roll-gravity"])
    )
    np.testing.assert_array_equal(one, other)
    force = RUNS.s / GAIN + G * 1e-3 * A * np.cos(RUNS.d)
    np.testing.assert_allclose(
        one[:, SERIES["accel_v", "2 nu in-phase"]], 0.5 * GAIN * 0.1 * force**2, rtol=1e-9, atol=ROUNDING * DC
    )


def test_the_resonance_acts_on_the_rolls_share_too(package: Package) -> None:
    found = prediction(package, ["resonance", "roll-gravity"], {"rho1": 1e-4, "inv_w0_squared[X,pendulum]": 2e-3})
    plain = RUNS.s + GAIN * G * 1e-4 * A * np.cos(RUNS.d)
    np.testing.assert_allclose(found[:, SERIES["accel_v", "nu in-phase"]], plain / (1 - RUNS.w**2 * 2e-3), rtol=1e-9)


def test_drifts_count_from_the_recordings_means_whatever_part_is_looked_at(package: Package) -> None:
    whole = model_of(package, "thermal-gain")
    part = whole.with_runs(whole.runs[:2])
    values = values_of(whole, {"kT[X]": 1e-3})
    np.testing.assert_allclose(
        observed(part.predict(values)), observed(whole.predict(values))[:2], rtol=1e-12, atol=ROUNDING * DC
    )


def values_of(model: RecordingModel, given: Mapping[str, float]) -> np.ndarray:
    baseline = {"theta0[X,pendulum,1]": THETA0, "gain[X,pendulum]": GAIN, "dc[X,pendulum,1]": DC}
    names = [each.name for each in model.parameters]
    assert set(given) <= set(names), names
    return np.array([{**baseline, **given}.get(name, 0.0) for name in names])


def prediction(package: Package, ids: list[str], given: Mapping[str, float]) -> np.ndarray:
    one = model_of(package, ids[0])
    model = one.with_effects(chosen("sensing-axis", ids))
    return observed(model.predict(values_of(model, given)))


def changed(package: Package, effect: str, sizes: Mapping[str, float], head: str = "") -> np.ndarray:
    """What the effect adds to every series, (runs, series)."""
    model = model_of(package, effect)
    label = {"axis": "[X]", "axis-configuration": "[X,pendulum]", "head": f"[{head}]"}
    scope = catalogue("sensing-axis")[effect].scope
    given = {f"{name}{label.get(scope, '')}": size for name, size in sizes.items()}
    return observed(model.predict(values_of(model, given))) - observed(model.predict(values_of(model, {})))
