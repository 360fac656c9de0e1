"""The gathering memory of the simulated XPS: what the encoder did, on the servo clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.newport_xps import SimulatedXps, XpsSimulatorSettings

Call = Callable[[str], str]
CONFIGURE = "GatheringConfigurationSet(Group1.Pos.CurrentPosition,Group1.Pos.SetpointVelocity)"
NUMBER = "GatheringCurrentNumberGet(int *,int *)"


class Bench:
    def __init__(self, **settings: int) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis()
        controller = SimulatedXps(
            self.clock, {"Group1": {"Pos": self.axis}}, XpsSimulatorSettings.model_validate(settings)
        )
        self.sent: list[bytes] = []
        self.connection = controller.connect(self.sent.append)

    def call(self, text: str) -> str:
        self.sent.clear()
        self.connection.receive(text.encode())
        (reply,) = self.sent
        return reply.decode()

    def rows(self, first: int, count: int) -> np.ndarray:
        reply = self.call(f"GatheringDataMultipleLinesGet({first},{count},char *)")
        text = reply.removeprefix("0,").removesuffix(",EndOfAPI")
        assert text.endswith("\n")
        return np.array([[float(value) for value in line.split(";")] for line in text.splitlines()])


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_gathering_holds_the_motion_at_every_divisor_of_the_servo_clock(bench: Bench) -> None:
    assert bench.call(CONFIGURE) == "0,,EndOfAPI"
    bench.axis.move_to(0.0, 40.0, 20.0, 80.0)
    assert bench.call("GatheringRun(200,80)") == "0,,EndOfAPI"
    bench.clock.sleep_s(3.0)
    assert bench.call(NUMBER) == "0,200,500000,EndOfAPI"
    times_s = 80 * 125e-6 * np.arange(200)
    position, velocity, _ = bench.axis.sample(times_s)
    rows = np.vstack([bench.rows(0, 150), bench.rows(150, 50)])
    np.testing.assert_allclose(rows[:, 0], position, atol=0.51e-4)
    np.testing.assert_allclose(rows[:, 1], velocity, atol=1e-9)
    first = bench.call("GatheringDataGet(100,char *)")
    assert first == f"0,{rows[100, 0]:.12g};{rows[100, 1]:.12g},EndOfAPI"


def test_what_was_gathered_before_a_later_command_stays(bench: Bench) -> None:
    bench.call(CONFIGURE)
    bench.axis.move_to(0.0, 40.0, 20.0, 80.0)
    bench.call("GatheringRun(100,80)")
    bench.clock.sleep_s(0.5)
    assert bench.call(NUMBER) == "0,51,500000,EndOfAPI"
    bench.axis.halt(0.5, 80.0)
    bench.clock.sleep_s(1.0)
    rows = bench.rows(0, 100)
    assert rows[50, 1] == 20.0
    assert rows[99, 1] == 0.0


def test_a_long_gathering_outlasts_the_memory_of_the_axis(bench: Bench) -> None:
    bench.call(CONFIGURE)
    bench.axis.move_to(0.0, 40.0, 20.0, 80.0)
    bench.call("GatheringRun(400,8000)")
    for _ in range(20):
        bench.clock.sleep_s(20.0)
        bench.axis.place(bench.clock.now_s(), 0.0)
    rows = bench.rows(0, 400)
    assert rows[1, 0] == pytest.approx(20.0 * 1.0 - 2.5)
    assert rows[10, 0] == 40.0


@pytest.mark.parametrize("stop", ["GatheringStop()", "GatheringStopAndSave()"])
def test_stopping_keeps_what_there_is(bench: Bench, stop: str) -> None:
    bench.call(CONFIGURE)
    bench.call("GatheringRun(100,80)")
    bench.clock.sleep_s(0.105)
    assert bench.call(stop) == "0,,EndOfAPI"
    bench.clock.sleep_s(1.0)
    assert bench.call(NUMBER) == "0,11,500000,EndOfAPI"
    assert bench.call(stop) == f"-30,{stop},EndOfAPI"
    assert bench.call("GatheringReset()") == "0,,EndOfAPI"
    assert bench.call(NUMBER) == "0,0,500000,EndOfAPI"


def test_refusals(bench: Bench) -> None:
    assert bench.call("GatheringRun(10,1)").startswith("-32,")
    assert bench.call("GatheringDataGet(0,char *)").startswith("-32,")
    assert bench.call("GatheringConfigurationSet(Group1.Pos.Nonsense)").startswith("-29,")
    assert bench.call("GatheringConfigurationSet()").startswith("-9,")
    bench.call(CONFIGURE)
    assert bench.call("GatheringConfigurationGet(char *)") == (
        "0,Group1.Pos.CurrentPosition;Group1.Pos.SetpointVelocity,EndOfAPI"
    )
    assert bench.call("GatheringRun(0,1)").startswith("-17,")
    assert bench.call("GatheringRun(500001,1)").startswith("-111,")
    bench.call("GatheringRun(10,8000)")
    assert bench.call(CONFIGURE).startswith("-43,")
    assert bench.call("GatheringRun(10,1)").startswith("-43,")
    assert bench.call("GatheringDataGet(1,char *)").startswith("-17,")
    assert bench.call("GatheringDataGet(0,char *)") == "0,0;0,EndOfAPI"


def test_more_than_a_reply_holds_is_refused_and_half_of_it_is_not(bench: Bench) -> None:
    bench.call(CONFIGURE)
    bench.axis.move_to(0.0, 40.0, 20.0, 80.0)
    bench.call("GatheringRun(8000,1)")
    bench.clock.sleep_s(2.0)
    assert bench.call("GatheringDataMultipleLinesGet(0,8000,char *)").startswith("-3,")
    assert bench.rows(0, 4000).shape == (4000, 2)
