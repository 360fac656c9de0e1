"""Turns of the XPS that take the time they are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.newport_xps import NewportXps, XpsSettings, cycloid_peaks
from drivers.transport import InProcessTransport
from rigctl.core.errors import LimitError
from rigctl.core.interfaces import TimedRotationStage
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.newport_xps import SimulatedXps, XpsSimulatorSettings

WIDE = {"travel_min_deg": -1e5, "travel_max_deg": 1e5, "speed_max_deg_s": 720.0, "acceleration_max_deg_s2": 400.0}
ARRIVED = ["GroupStatusGet(Group1,int *)", "GroupPositionCurrentGet(Group1,double *)"]
"""What is asked when a motion is said to have ended."""


class Platform:
    """A stage on a controller that turns by cycloids, and what was sent to it."""

    def __init__(self, law: str = "cycloid", **settings: Any) -> None:
        self.clock, self.axis, self.sent = VirtualClock(), MotionAxis(), bytearray()
        self.xps = SimulatedXps(
            self.clock,
            {"Group1": {"Pos": self.axis}},
            XpsSimulatorSettings.model_validate({**WIDE, "motion_law": law}),
        )
        limits = {"angle_min_deg": -400.0, "angle_max_deg": 400.0, "speed_deg_s": 100.0, "acceleration_deg_s2": 60.0}
        self.stage = NewportXps("platform", XpsSettings.model_validate({**limits, **settings}), self.wire, self.clock)
        self.stage.open()
        self.stage.home()
        self.sent.clear()

    def wire(self) -> InProcessTransport:
        return InProcessTransport("sim:platform", self, self.clock)

    def connect(self, send: Callable[[bytes], None]) -> Any:
        connection = self.xps.connect(send)
        receive = connection.receive

        def tapped(data: bytes) -> None:
            self.sent.extend(data + b"\n")
            receive(data)

        connection.receive = tapped  # type: ignore[method-assign]
        return connection

    @property
    def requests(self) -> list[str]:
        return self.sent.decode().splitlines()


def test_it_is_a_timed_stage() -> None:
    assert isinstance(Platform().stage, TimedRotationStage)


@pytest.mark.parametrize(
    ("angle_deg", "duration_s"), [(180.0, 10.0), (180.0, 5.0), (-15.0, 2.0), (360.0, 40.0 / 3.0)]
)
def test_the_motion_takes_its_time_and_is_a_cycloid(angle_deg: float, duration_s: float) -> None:
    platform = Platform()
    began_s = platform.clock.now_s()
    platform.stage.turn_to(angle_deg, duration_s)
    assert platform.clock.now_s() - began_s == pytest.approx(duration_s + 0.05, abs=1e-5)
    u = np.linspace(0.0, 1.0, 101)
    asked = angle_deg * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
    assert platform.axis.sample(began_s + duration_s * u)[0] == pytest.approx(asked, abs=1e-4)
    assert platform.stage.angle().value == pytest.approx(angle_deg, abs=1e-4)


def test_the_words_of_a_turn_and_back_to_the_limits() -> None:
    platform = Platform()
    platform.stage.turn_to(180.0, 10.0)
    platform.stage.turn_to(0.0, 10.0)
    platform.stage.move_to(5.0)
    assert platform.requests == [
        "GroupPositionCurrentGet(Group1,double *)",
        "PositionerSGammaParametersSet(Group1.Pos,36,11.309734,0.02,0.02)",
        "GroupMoveAbsolute(Group1,180)",
        *ARRIVED,
        "GroupPositionCurrentGet(Group1,double *)",
        "GroupMoveAbsolute(Group1,0)",
        *ARRIVED,
        "PositionerSGammaParametersSet(Group1.Pos,100,60,0.02,0.02)",
        "GroupMoveAbsolute(Group1,5)",
        *ARRIVED,
    ]


def test_another_law_arrives_earlier() -> None:
    platform = Platform("trapezoid")
    began_s = platform.clock.now_s()
    platform.stage.turn_to(180.0, 10.0)
    assert 8.0 < platform.clock.now_s() - began_s < 10.0


def test_a_turn_to_where_it_stands_is_a_move() -> None:
    platform = Platform()
    platform.stage.turn_to(90.0, 5.0)
    platform.stage.turn_to(90.0, 5.0)
    assert platform.requests[-3:] == ["GroupMoveAbsolute(Group1,90)", *ARRIVED]
    assert platform.stage.angle().value == 90.0


@pytest.mark.parametrize(
    ("angle_deg", "duration_s", "fault"),
    [
        (180.0, 3.0, r"180 deg in 3 s takes 120 deg/s and 126 deg/s2; the limits are 100 deg/s and 60 deg/s2"),
        (30.0, 1.5, r"30 deg in 1.5 s takes 40 deg/s and 83.8 deg/s2"),
        (401.0, 100.0, "401 deg is outside the limits -400 to 400 deg"),
        (10.0, 0.0, "a motion cannot take 0 s"),
        (10.0, float("nan"), "a motion cannot take nan s"),
    ],
)
def test_what_is_too_fast_or_too_far_does_not_move(angle_deg: float, duration_s: float, fault: str) -> None:
    platform = Platform()
    with pytest.raises(LimitError, match=f"^platform: {fault}"):
        platform.stage.turn_to(angle_deg, duration_s)
    assert not any("Move" in request or "Set" in request for request in platform.requests)


def test_the_peaks_are_those_of_the_cycloid() -> None:
    t = np.linspace(0.0, 10.0, 100_001)
    angle = 180.0 * (t / 10.0 - np.sin(0.2 * np.pi * t) / (2.0 * np.pi))
    speed = np.gradient(angle, t)
    peaks = np.abs(speed).max(), np.abs(np.gradient(speed, t)).max()
    assert cycloid_peaks(180.0, 10.0) == pytest.approx(peaks, rel=1e-3)
