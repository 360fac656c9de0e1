"""Parameters of an axis that the controller stores and gives back: code, decimals or hex, and effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from simulators.newport_esp301.axis import EspAxis
from simulators.newport_esp301.errors import Refused
from simulators.newport_esp301.settings import Esp301SimulatorSettings


@dataclass(frozen=True)
class Parameter:
    """How an axis parameter is read and set; `whole`: shown without decimals."""

    get: Callable[[EspAxis], float]
    put: Callable[[EspAxis, float], None]
    whole: bool = False


def _put_acceleration(axis: EspAxis, value: float) -> None:
    axis.acceleration_deg_s2 = axis.allowed_acceleration(value)


def _put_deceleration(axis: EspAxis, value: float) -> None:
    axis.deceleration_deg_s2 = axis.allowed_acceleration(value)


def _put_emergency_deceleration(axis: EspAxis, value: float) -> None:
    axis.emergency_deceleration_deg_s2 = axis.allowed_acceleration(value)


def _put_left_limit(axis: EspAxis, value: float) -> None:
    if value >= axis.soft_limits_deg[1]:
        raise Refused(1, axis.number)
    axis.soft_limits_deg = (value, axis.soft_limits_deg[1])


def _put_right_limit(axis: EspAxis, value: float) -> None:
    if value <= axis.soft_limits_deg[0]:
        raise Refused(1, axis.number)
    axis.soft_limits_deg = (axis.soft_limits_deg[0], value)


def _whole(axis: EspAxis, value: float, largest: int) -> int:
    if value != int(value) or not 0 <= value <= largest:
        raise Refused(1, axis.number)
    return int(value)


def _put_unit(axis: EspAxis, value: float) -> None:
    axis.unit = _whole(axis, value, 11)


def _put_decimals(axis: EspAxis, value: float) -> None:
    axis.decimals = _whole(axis, value, 7)


def _put_home_mode(axis: EspAxis, value: float) -> None:
    axis.home_mode = _whole(axis, value, 6)


PARAMETERS: dict[str, Parameter] = {
    "VA": Parameter(lambda axis: axis.speed_deg_s, EspAxis.set_speed),
    "AC": Parameter(lambda axis: axis.acceleration_deg_s2, _put_acceleration),
    "AG": Parameter(lambda axis: axis.deceleration_deg_s2, _put_deceleration),
    "AE": Parameter(lambda axis: axis.emergency_deceleration_deg_s2, _put_emergency_deceleration),
    "SL": Parameter(lambda axis: axis.soft_limits_deg[0], _put_left_limit),
    "SR": Parameter(lambda axis: axis.soft_limits_deg[1], _put_right_limit),
    "SN": Parameter(lambda axis: axis.unit, _put_unit, whole=True),
    "FP": Parameter(lambda axis: axis.decimals, _put_decimals, whole=True),
    "OM": Parameter(lambda axis: axis.home_mode, _put_home_mode, whole=True),
    "DH": Parameter(lambda _: 0.0, EspAxis.define_position),
}


def stored_defaults(settings: Esp301SimulatorSettings) -> dict[str, float]:
    """Parameters without an effect on this simulation, which real clients set and read all the same."""
    return {
        "VU": settings.speed_max_deg_s,
        "AU": settings.acceleration_max_deg_s2,
        "JK": 10.0 * settings.acceleration_max_deg_s2,
        "JH": settings.speed_deg_s,
        "JW": 0.1 * settings.speed_deg_s,
        "OH": settings.home_speed_deg_s,
        "OL": 0.1 * settings.home_speed_deg_s,
        "SU": settings.resolution_deg,
        "FE": 1.0,
        "KP": 100.0,
        "KI": 10.0,
        "KD": 200.0,
        "KS": 100.0,
        "TJ": 1.0,
        "VB": 0.0,
    }
