"""Units as text: spellings of one unit are the same, others are not, and a product or quotient is a unit again."""

from __future__ import annotations

import pytest

from rigctl.core.units import known_unit, name_and_unit, power, ratio, same_unit


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("m/s2", "m s-2", True),
        ("V/(m/s2)", "V s²/m", True),
        ("rad/s^2", "rad/s**2", True),
        ("µm", "um", True),
        ("°C", "Celsius", True),
        ("m/s2", "m/s", False),
        ("V/(m/s2)", "V/m/s2", False),
        ("arb. u.", "V", False),
    ],
)
def test_spellings_of_one_unit(one: str, other: str, same: bool) -> None:
    assert same_unit(one, other) == same


@pytest.mark.parametrize("unit", ["s", "m/s2", "degC", "rad"])
def test_powers_and_quotients_are_units(unit: str) -> None:
    assert known_unit(ratio("V", power(unit, 2)))
    assert same_unit(ratio("V", power(unit, -1)), f"V*({unit})")


def test_the_suffix_of_a_column_is_its_unit() -> None:
    assert name_and_unit("gain_q_a_v_per_m_s2") == ("gain_q_a", "V/(m/s2)")
    assert name_and_unit("temperature_c") == ("temperature", "degC")
    assert name_and_unit("sensor_c") == ("sensor_c", "")
