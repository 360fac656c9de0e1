"""What differs with an XPS-D: its version is elsewhere, and an emergency stop leads to states of its own."""

from __future__ import annotations

import pytest

from drivers.newport_xps import NewportXps, XpsSettings
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.errors import InstrumentError, SafetyStop
from simulators.clock import VirtualClock
from simulators.faults.mishaps import EmergencyStop
from simulators.motion import MotionAxis
from simulators.newport_xps import XPS_D, SimulatedXps
from tests.drivers.expected import Expected


class Bench:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis()
        self.xps = SimulatedXps(self.clock, {"Group1": {"Pos": self.axis}}, XPS_D)
        self.stage = stage(self.xps, self.clock)

    def homed(self) -> Bench:
        self.stage.open()
        self.stage.home()
        return self

    def press(self) -> None:
        self.xps.befall(EmergencyStop(at_s=0.0))

    def release(self) -> None:
        self.xps.relieve(EmergencyStop(at_s=0.0))


def stage(endpoint: Endpoint, clock: VirtualClock) -> NewportXps:
    settings = XpsSettings(speed_deg_s=10.0, acceleration_deg_s2=40.0)
    return NewportXps("stage", settings, lambda: InProcessTransport("sim:stage", endpoint, clock), clock)


def test_its_firmware_is_what_its_installer_says() -> None:
    bench = Bench()
    bench.stage.open()
    identity = bench.stage.identify()
    assert (identity.model, identity.firmware, identity.text) == ("XPS-D", "XPS-D-N13006", "XPS-D XPS-D-N13006")


def test_after_an_emergency_stop_it_is_disabled_and_keeps_its_reference() -> None:
    bench = Bench().homed()
    bench.stage.move_to(30.0)
    bench.clock.call_at(bench.clock.now_s() + 1.0, bench.press)
    with pytest.raises(SafetyStop, match="-26"):
        bench.stage.move_to(90.0)
    bench.stage.stop()
    bench.clock.sleep_s(1.0)
    assert bench.axis.velocity(bench.clock.now_s()) == 0.0
    assert bench.stage.safety_stop() == "Disabled state due to an interlock"
    assert not bench.stage.is_homed()
    with pytest.raises(SafetyStop, match=r"GroupMotionEnable.*-26"):
        bench.stage.home()
    bench.release()
    stood_deg = bench.stage.angle().value
    bench.stage.home()
    assert bench.stage.angle().value == pytest.approx(stood_deg, abs=1e-3)
    assert bench.stage.safety_stop() == ""
    bench.stage.move_to(0.0)


def test_an_emergency_stop_before_it_is_referenced_takes_another_initialisation() -> None:
    bench = Bench()
    bench.stage.open()
    bench.clock.call_at(bench.clock.now_s() + 3.0, bench.press)
    with pytest.raises(InstrumentError):
        bench.stage.home()
    assert bench.stage.safety_stop() == "Not initialized state due to an interlock"
    bench.release()
    bench.stage.home()
    assert bench.stage.is_homed()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("0,Disabled state due to a motion done timeout,EndOfAPI", ""),
        ("0,Disabled state due to an Emergency signal,EndOfAPI", "Disabled state due to an Emergency signal"),
        ("-17,GroupStatusStringGet(90,char *),EndOfAPI", "no text"),
    ],
)
def test_what_has_disabled_it_is_told_by_the_text_of_its_state(text: str, told: str) -> None:
    clock = VirtualClock()
    firmware = "0,XPS-D Firmware V1.4,EndOfAPI"
    conversation = Expected(
        (b"FirmwareVersionGet(char *)", firmware.encode()),
        (b"GroupStatusGet(Group1,int *)", b"0,90,EndOfAPI"),
        (b"GroupStatusStringGet(90,char *)", text.encode()),
    )
    # One of its two connections is for motions.
    endpoints = iter((conversation, Expected()))
    asked = NewportXps("stage", XpsSettings(), lambda: InProcessTransport("sim:stage", next(endpoints), clock), clock)
    asked.open()
    assert asked.safety_stop() == told
    assert not conversation.left
