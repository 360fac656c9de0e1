"""What cannot be true is found at any size above the noise; what a sensor may really see is never rejected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.sample_checks import encoder_flaw, laser_flaw, odd_sample, sigmas_allowed, voltage_flaw
from procedures.sine_fit import Column, Sine
from rigctl.core.arrays import FloatArray
from rigctl.core.interfaces import Channel

RATE_HZ, FREQUENCY_HZ, AMPLITUDE_MM = 20.0, 0.6, 4.0
TIMES_S = np.arange(400) / RATE_HZ
PHASE = 2.0 * np.pi * FREQUENCY_HZ * np.arange(401) / RATE_HZ + 0.7
"""One more than a record has: what comes into it when one is dropped."""
NOISE_MM, NOISE_V = 5e-5, 3e-4
VOLTS = Channel("accel_v", "V", "voltage", full_scale=10.0)
ENCODER_MM = np.round(AMPLITUDE_MM * np.cos(PHASE), 6)


def column(values: FloatArray, frequency_hz: float = FREQUENCY_HZ) -> Column:
    return Column("channel", Sine(TIMES_S[: len(values)], frequency_hz), values)


def laser_mm(seed: int) -> FloatArray:
    noise = NOISE_MM * np.random.default_rng(seed).standard_normal(len(PHASE))
    return np.round(0.35 + 0.996 * ENCODER_MM + 1e-4 * ENCODER_MM**2 + noise, 4)


def volts(seed: int) -> FloatArray:
    return 0.2 - 0.4 * np.sin(PHASE + 0.1) + NOISE_V * np.random.default_rng(seed).standard_normal(len(PHASE))


Check = Callable[[FloatArray], Any]
COLUMNS: dict[str, tuple[Callable[[int], FloatArray], Check, float]] = {
    "encoder": (
        lambda _: ENCODER_MM,
        lambda values: encoder_flaw(column(values), 1000.0),
        5e-4,
    ),
    "laser": (
        laser_mm,
        lambda values: laser_flaw(column(values), column(ENCODER_MM[:400]), 0.0),
        30 * NOISE_MM,
    ),
    "voltage": (volts, lambda values: voltage_flaw(VOLTS, column(values)), 30 * NOISE_V),
}
"""A column by seed, its check, and the size from which on every wrong sample is to be found."""


def wrong_digit(column: FloatArray, place: int, random: np.random.Generator) -> FloatArray:
    text = f"{column[place]:.6f}"
    digit = random.choice([i for i, letter in enumerate(text) if letter.isdigit()])
    spoilt = column.copy()
    spoilt[place] = float(text[:digit] + str(random.integers(10)) + text[digit + 1 :])
    return spoilt


def repeated(column: FloatArray, place: int, _: object) -> FloatArray:
    return np.insert(column, place, column[place])[:401]


def dropped(column: FloatArray, place: int, _: object) -> FloatArray:
    return np.delete(column, place)


def other_sign(column: FloatArray, place: int, _: object) -> FloatArray:
    spoilt = column.copy()
    spoilt[place] *= -1.0
    return spoilt


SHIFTS = (repeated, dropped)
"""In a voltage they are found where the sine is steep."""


@pytest.mark.parametrize("kind", [wrong_digit, repeated, dropped, other_sign])
@pytest.mark.parametrize("name", COLUMNS)
def test_a_wrong_sample_is_found_and_named(name: str, kind: Callable[..., FloatArray]) -> None:
    make, check, size = COLUMNS[name]
    random = np.random.default_rng(5)
    tried = 0
    for seed in range(150):
        column = make(seed)
        place = int(random.integers(2, len(TIMES_S)))
        spoilt, column = kind(column, place, random)[:400], column[:400]
        off = np.abs(spoilt - column)[place : place + 2]
        at_once = float(off[off > 0.0][0]) if off.any() else 0.0
        if at_once < size or (name == "voltage" and kind in SHIFTS and at_once < 0.5 * np.abs(np.diff(column)).max()):
            continue
        tried += 1
        flaw = check(spoilt)
        assert flaw is not None, (seed, place, at_once)
        assert abs(flaw.sample - place) <= 3, (seed, place, at_once, flaw)
    assert tried > 40


def test_a_laser_that_comes_one_sample_late_throughout_is_found() -> None:
    late = np.roll(laser_mm(1), 1)[1:]
    flaw = laser_flaw(column(late), column(ENCODER_MM[1:]), 0.0)
    assert "ms away from the encoder" in flaw.why  # type: ignore[union-attr]


def test_its_known_latency_is_allowed_for() -> None:
    late_s = 0.05
    late = 0.35 + AMPLITUDE_MM * np.cos(2.0 * np.pi * FREQUENCY_HZ * (TIMES_S + late_s) + 0.7)
    assert laser_flaw(column(late), column(ENCODER_MM[:400]), late_s) is None
    assert laser_flaw(column(late), column(ENCODER_MM[:400]), 0.0) is not None


def test_a_voltage_beyond_its_range_is_no_saturation() -> None:
    for value in (80.0, -12.6):
        spoilt = volts(1)[:400]
        spoilt[7] = value
        assert voltage_flaw(VOLTS, column(spoilt)).sample == 7  # type: ignore[union-attr]
    saturated = np.clip(30.0 * volts(1)[:400], -10.0, 10.0)
    assert voltage_flaw(VOLTS, column(saturated)) is None


def test_an_oscillation_that_ends_before_its_time_is_found() -> None:
    ended = np.where(TIMES_S < 15.0, ENCODER_MM[:400], ENCODER_MM[300])
    assert encoder_flaw(column(ended), 1000.0) is not None


@given(
    st.integers(0, 2**32 - 1),
    st.integers(24, 3000),
    st.sampled_from(["white", "integrated", "twice integrated", "line", "ringing", "steps"]),
)
@settings(max_examples=150, deadline=None)
def test_no_course_of_noise_lines_or_transients_is_rejected(seed: int, samples: int, kind: str) -> None:
    random = np.random.default_rng(seed)
    white, time = random.standard_normal(samples), np.arange(samples)
    added = {
        "white": 0.0,
        "integrated": np.cumsum(white),
        "twice integrated": np.cumsum(np.cumsum(white)),
        "line": random.uniform(0.0, 30.0) * np.sin(random.uniform(0.0, np.pi) * time + 1.0),
        "ringing": 5.0 * np.exp(-time / 100.0) * np.sin(0.5 * time),
        "steps": np.round(white / 2.0) * 2.0 - white,
    }[kind]
    assert odd_sample(white + added, resolution=2.0 if kind == "steps" else 0.0) is None


@pytest.mark.parametrize("noise", [0.1, 0.25, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("samples", [24, 100, 1000])
def test_noise_of_any_part_of_the_last_digit_raises_no_alarm(noise: float, samples: int) -> None:
    random = np.random.default_rng(5)
    for _ in range(300):
        digits = np.round(noise * random.standard_normal(samples) + random.uniform(-0.5, 0.5))
        assert odd_sample(digits, resolution=1.0) is None


def test_in_a_column_without_noise_a_sample_some_digits_off_is_found() -> None:
    digits = np.zeros(400)
    digits[77] = 6.0
    assert odd_sample(digits, resolution=1.0)[0] == 77  # type: ignore[index]


@pytest.mark.parametrize("frequency_hz", [0.5, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("amplitude", [0.0, 3e-5, 0.2, 4.0])
def test_rounding_to_the_last_digit_alone_is_no_flaw(frequency_hz: float, amplitude: float) -> None:
    """A column without noise, whose roundings repeat with the sine."""
    rounded = np.round(0.35 + amplitude * np.cos(2.0 * np.pi * frequency_hz * TIMES_S + 0.7), 4)
    volts = Channel("accel_v", "V", "voltage")
    assert voltage_flaw(volts, column(rounded, frequency_hz)) is None


def test_the_limit_is_where_noise_gets_once_in_a_hundred_million_columns() -> None:
    """Scaled down to what can be tried: the same formula at a probability of 1e-2 holds in 3000 columns."""
    random = np.random.default_rng(3)
    assert sigmas_allowed(400, 1e-8) > sigmas_allowed(400, 1e-2) > 4.0
    alarms = sum(odd_sample(random.standard_normal(60), false_alarm=1e-2) is not None for _ in range(3000))
    assert alarms <= 60, "30 were to be expected without the margin for the scale"


def test_a_laser_set_to_micrometres_is_noticed() -> None:
    tilted = 1.1 * ENCODER_MM[:400]
    assert laser_flaw(column(tilted), column(ENCODER_MM[:400]), 0.0) is None
    flaw = laser_flaw(column(1e3 * tilted), column(ENCODER_MM[:400]), 0.0)
    assert flaw is not None
    assert "is it set to micrometres?" in flaw.why
