"""Units as text: spellings of one unit are the same, others are not, and a product or quotient is a unit again."""

from __future__ import annotations

import pytest

from rigctl.core.units import contradicts, known_unit, name_and_unit, power, ratio, same_unit, unit_of_column


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


@pytest.mark.parametrize(
    "column",
    ["out_mv_v", "v_km_s", "torque_n_m", "vis_pa_s", "r_per_s", "v_cm_s", "psd_v2_hz", "force_kg_m_s2", "mm_s"],
)
def test_a_suffix_that_may_be_half_of_a_unit_promises_none(column: str) -> None:
    assert unit_of_column(column) == ""


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *(("speed_m_s", "m/s"), ("speed_mm_s", "mm/s"), ("rate_deg_s", "deg/s"), ("accel_m_s2", "m/s2")),
        *(("t_s", "s"), ("g_m_s2", "m/s2"), ("q_a_v", "V"), ("position_min_mm", "mm")),
    ],
)
def test_a_suffix_behind_a_name_is_the_unit(column: str, unit: str) -> None:
    assert unit_of_column(column) == unit


@pytest.mark.parametrize(
    ("unit", "column", "contradicted"),
    [
        ("V", "length_mm", True),
        ("mm/s2", "accel_m_s2", True),
        ("s", "speed_m_s", True),
        ("uV", "out_v", True),
        ("V", "gain_v_per_m_s2", True),
        ("V s²/m", "gain_v_per_m_s2", False),
        ("mV/V", "out_mv_v", False),
        ("N m", "torque_n_m", False),
        ("mV/V", "ratio_v", False),
        ("A s", "charge_a_s", False),
        ("µV/°C", "temp_coefficient_c", False),
    ],
)
def test_a_unit_is_contradicted_by_a_name_that_cannot_mean_it(unit: str, column: str, contradicted: bool) -> None:
    assert contradicts(unit, column) == contradicted
