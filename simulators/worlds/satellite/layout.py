"""Where things are in the flat arrays of the compiled loop: name, place, how many."""

from __future__ import annotations

from collections.abc import Mapping

LANES = 16
"""Draws that go in lock step: four vectors of four, or two of eight."""

POLES = 12
"""Of the filter that makes white noise into the sensor's; more than the densities need, unused ones are zero."""


def _places(**counts: int) -> tuple[dict[str, int], int]:
    places, total = {}, 0
    for name, count in counts.items():
        places[name] = total
        total += count
    return places, total


FORCING, FORCINGS = _places(
    strength=1,
    cosine=1,
    sine=1,
    believed=4,
    falling=1,
    force=3,
    torque=3,
    wanted=3,
    attitude=3,
    moved=2,
    speed=2,
    pushed=2,
    reaction=2,
    centre=3,
    parted=1,
    applied=2,
    measured=2,
    gain=2,
    tracker=3,
    gradient=6,
    loudness=1,
)
"""What is the same for all draws, by step: see `forcing`."""

PARAMETER, PARAMETERS = _places(
    position_1=3,
    position_2=3,
    matrix_1=9,
    matrix_2=9,
    offset_1=3,
    offset_2=3,
    bias_1=3,
    bias_2=3,
    parasitic_1=3,
    parasitic_2=3,
    quadratic_1=3,
    quadratic_2=3,
    axis_1=3,
    axis_2=3,
    gyro=3,
    tracker=3,
    thruster=36,
)
"""What is constant, by draw."""

STATE, STATES = _places(
    attitude=3,
    rate=3,
    integral=3,
    double=3,
    lagged=3,
    angle=3,
    turning=3,
    drift=3,
    asked=6,
    thrust=6,
    readout=4,
    red_1=POLES,
    red_2=POLES,
)

CONSTANT, CONSTANTS = _places(
    step=1,
    input_1=1,
    input_2=1,
    gain=1,
    integral=1,
    lag=1,
    stiffness=1,
    damping=1,
    hybrid=1,
    sensor_yz=1,
    readout=1,
    angular=1,
    tracker=1,
    thrust=1,
    torque=1,
    least=1,
    smallest=1,
    largest=1,
    cubic=2,
    cross=2,
    range=1,
    spin=1,
)

COLUMNS = (
    *("m1_x", "m1_y", "m1_z", "m2_x", "m2_y", "m2_z"),
    *("t_xx", "t_xz", "t_yy", "t_zz", "t_xy", "t_yz"),
    *("dw_x", "dw_y", "dw_z", "att_x", "att_y", "att_z", "command_x", "command_y", "command_z"),
    *("g_x", "g_y", "g_z"),
)
"""What comes down, by sample."""


def by_lane(places: Mapping[str, int]) -> dict[str, int]:
    """As places in an array that holds all lanes of one thing side by side."""
    return {name: place * LANES for name, place in places.items()}
