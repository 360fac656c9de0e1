"""Simulated instruments under the real `RunEngine`: scans, limits, faults, all at rest whatever ends a plan."""

from __future__ import annotations

import importlib
import math
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import event_model
import numpy as np
import pytest
from bluesky import RunEngine, protocols
from bluesky.plans import count, rel_scan, scan
from bluesky.preprocessors import stage_decorator
from bluesky.simulators import check_limits
from bluesky.utils import FailedStatus, RunEngineInterrupted

import rigctl.bluesky
from rigctl.bluesky import devices_of
from rigctl.core.errors import (
    ConfigError,
    InstrumentError,
    LimitError,
    LinkError,
    LinkLost,
    MotionStopped,
    OutOfStep,
    RigError,
)
from rigctl.files.rig_file import parse_rig
from rigctl.rig import Rig

GAIN_V_PER_M_S2, AMPLITUDE_M, OMEGA_RAD_S = 59.7, 5e-3, 2.0 * math.pi * 0.5
"""Of the shipped rig's sensor as a pendulum, and how the stage below it moves."""

FAST = (('clock = "virtual"', 'clock = "real"'), ("clock_speed = 1.0", "clock_speed = 20.0"))
"""A motion of 100 degrees takes half a second."""

Opened = Callable[..., Rig]


def changed_rig(campaigns: Path, *changes: tuple[str, str]) -> Rig:
    """The shipped rig with changes."""
    path = campaigns / "isa-rig.toml"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return Rig(parse_rig(text, path))


@pytest.fixture
def opened(campaigns: Path) -> Iterator[Opened]:
    """The same, open, the rotation stage homed."""
    with ExitStack() as open_rigs:

        def open_rig(*changes: tuple[str, str]) -> Rig:
            rig = open_rigs.enter_context(changed_rig(campaigns, *changes))
            rig.only("rotation").home()
            return rig

        yield open_rig


@pytest.fixture
def engine() -> RunEngine:
    return RunEngine({}, call_returns_result=True)


def mounted(rig: Rig) -> None:
    """The package as a pendulum about the axis of rotation, levelled."""
    assert rig.operator_link is not None
    rig.operator_link.request({"remount": {"axis": "Y", "configuration": "pendulum", "mounting": 1}})
    rig.operator_link.request({"level": True})


def test_a_scan_of_the_rotation_stage_finds_the_law_of_the_sine_in_ten_lines(campaigns: Path) -> None:
    rows: list[dict[str, float]] = []
    engine = RunEngine({})
    with Rig.from_file(campaigns / "isa-rig.toml") as rig:
        mounted(rig)
        devices = devices_of(rig, record_s=10.0, settle_s=10.0)
        rig.only("rotation").home()
        rig.only("linear").home()
        rig.only("linear").oscillate(0.0, amplitude_mm=5.0, frequency_hz=0.5, duration_s=1000.0)
        plan = scan([devices["accelerometer"]], devices["rotation"], -60, 60, 8)
        engine(plan, {"event": lambda _, event: rows.append(event["data"])})
    sines = np.sin(np.radians([row["rotation_deg"] for row in rows]))
    volts = np.array([row["accel_std_v"] for row in rows])
    # A rigid sensor's; the pendulum's resonance at 4.53 Hz adds 1.2 % at 0.5 Hz.
    rigid_v = GAIN_V_PER_M_S2 * AMPLITUDE_M * OMEGA_RAD_S**2 / math.sqrt(2.0)
    (slope_v, off_v), _, _, _ = np.linalg.lstsq(
        np.column_stack([sines, np.sqrt(1.0 - sines**2)]), volts * np.sign(sines), rcond=None
    )
    assert slope_v == pytest.approx(1.012 * rigid_v, rel=3e-3)
    assert abs(off_v / slope_v) < 0.01  # the sensing axis is a few milliradians off
    assert slope_v * sines + off_v * np.sqrt(1.0 - sines**2) == pytest.approx(volts * np.sign(sines), abs=0.01)

    assert len(rows) == 8
    assert [row["rotation_setpoint_deg"] for row in rows] == pytest.approx(np.linspace(-60, 60, 8).tolist())


def test_devices_keep_the_protocols_and_their_documents_are_valid(opened: Opened, engine: RunEngine) -> None:
    rig = opened()
    devices = devices_of(rig)
    for device in devices.values():
        for protocol in (protocols.Readable, protocols.Configurable, protocols.HasHints, protocols.HasParent):
            protocols.check_supports(device, protocol)
    for name in ("rotation", "stage"):
        for protocol in (protocols.Locatable, protocols.Stoppable, protocols.Checkable):
            protocols.check_supports(devices[name], protocol)
    for protocol in (protocols.Triggerable, protocols.Stageable):
        protocols.check_supports(devices["accelerometer"], protocol)
    protocols.check_supports(devices["rotation"].set(1.0), protocols.Status)

    found: list[tuple[str, Any]] = []
    rig.only("linear").home()
    detectors = [device for name, device in devices.items() if name not in {"rotation", "stage"}]
    engine(scan(detectors, devices["rotation"], 0, 1, devices["stage"], 0, 2, 2), lambda *given: found.append(given))
    for name, document in found:
        event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
    (descriptor,) = (document for name, document in found if name == "descriptor")
    units = {key: each["units"] for key, each in descriptor["data_keys"].items()}
    assert units == {
        **dict.fromkeys(["accel_mean_v", "accel_std_v"], "V"),
        **dict.fromkeys(["thermometer_c"], "degC"),
        **dict.fromkeys(["laser_1_mm", "laser_2_mm", "laser_3_mm", "stage_mm", "stage_setpoint_mm"], "mm"),
        **dict.fromkeys(["rotation_deg", "rotation_setpoint_deg"], "deg"),
    }
    assert descriptor["hints"]["rotation"] == {"fields": ["rotation_deg"]}
    assert descriptor["configuration"]["rotation"]["data"]["rotation_model"] == "XPS-C8"
    assert descriptor["configuration"]["accelerometer"]["data"]["accelerometer_samples"] == 100
    *_, last = (document for name, document in found if name == "event")
    assert last["data"]["stage_mm"] == pytest.approx(2.0, abs=1e-3)


def test_a_relative_scan_comes_back(opened: Opened, engine: RunEngine) -> None:
    rig = opened()
    devices = devices_of(rig)
    rig.only("rotation").move_to(2.0)
    engine(rel_scan([devices["thermometer"]], devices["rotation"], -1, 1, 2))
    assert rig.only("rotation").angle().value == pytest.approx(2.0, abs=1e-3)


def test_beyond_the_limits_nothing_is_sent(opened: Opened, engine: RunEngine, wire: Any) -> None:
    devices = devices_of(opened())
    wire.sent.clear()
    plan = lambda: scan([devices["thermometer"]], devices["rotation"], 0.0, 171.0, 2)  # noqa: E731 - for one look and one run
    with pytest.raises(LimitError, match=r"rotation: 171 deg is outside the limits -170 to 170 deg"):
        check_limits(plan())
    assert wire.sent == []
    with pytest.raises(LimitError, match=r"stage: nan mm is outside the travel"):
        engine(bps.mv(devices["stage"], math.nan))
    # What a plan has tried to set is stopped at its end, whether it moved or not.
    assert wire.sent
    assert wire.motions == []


@pytest.mark.parametrize("value", ["2.0", None, True, [1.0], 1j])
def test_what_is_no_number_is_no_position(opened: Opened, wire: Any, value: Any) -> None:
    stage = devices_of(opened())["stage"]
    wire.sent.clear()
    with pytest.raises(LimitError, match=rf"stage: {re.escape(repr(value))} is no position; give a number \[mm\]"):
        stage.set(value)
    stage.check_value(np.float32(0.5))
    assert wire.sent == []


def test_a_record_that_cannot_be_made_is_refused(opened: Opened) -> None:
    rig = opened()
    with pytest.raises(
        LimitError, match=r"accelerometer: record_s = 0.01 .* are 1 samples; 2 to 1000000 are possible"
    ):
        devices_of(rig, record_s=0.01)
    with pytest.raises(InstrumentError, match="accelerometer: nothing is recorded yet; trigger it first"):
        devices_of(rig)["accelerometer"].read()


def test_a_stage_that_is_lost_fails_the_plan_with_its_line_and_the_other_rests(
    campaigns: Path, engine: RunEngine
) -> None:
    # When both are homed and move, nobody listens any more.
    faults = "[instruments.rotation.faults]\ndisconnect = { at_s = 30.0 }\nrefused = { between_s = [30.0, 1e9] }\n\n"
    rig = changed_rig(campaigns, *FAST, ("[instruments.stage]", f"{faults}[instruments.stage]"))

    def plan(devices: dict[str, Any]) -> Any:
        status = yield from bps.abs_set(devices["stage"], 20.0)
        for number in range(1000):
            if status.done:
                status = yield from bps.abs_set(devices["stage"], -20.0 if number % 4 else 20.0)
            yield from bps.mv(devices["rotation"], number % 2)

    with rig:
        rig.only("rotation").home()
        rig.only("linear").home()
        with pytest.raises(FailedStatus, match=r"^rotation: .*connection") as failed:
            engine(plan(devices_of(rig)))
        assert "\n" not in str(failed.value)
        assert isinstance(failed.value.__cause__, LinkError)
        assert not rig.only("linear").is_moving()
        assert rig.clock.now_s() > 30.0


def test_what_fails_brings_the_rest_of_the_rig_to_rest(
    turning: tuple[Rig, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, devices = turning
    turned = devices["rotation"].set(160.0)
    until_moving(rig)

    def lost(samples: int, period_s: float) -> float:
        raise LinkLost("accelerometer: gone")

    monkeypatch.setattr(rig.only("readout"), "start", lost)
    record = devices["accelerometer"].trigger()
    assert str(record.exception(10.0)) == "accelerometer: gone"
    # Its own failure is not told beside the one that had it stopped.
    assert turned.exception(10.0) is None
    assert rig.moving() == ()
    assert rig.only("rotation").angle().value < 150.0


@pytest.fixture
def turning(opened: Opened) -> tuple[Rig, dict[str, Any]]:
    """A rig on a clock that goes, so that motions last."""
    rig = opened(*FAST)
    return rig, devices_of(rig, record_s=600.0, period_s=0.1)


def until_moving(rig: Rig) -> None:
    until = time.monotonic() + 10.0
    while not rig.moving():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_what_a_plan_that_fails_has_set_is_at_rest(turning: tuple[Rig, dict[str, Any]], engine: RunEngine) -> None:
    rig, devices = turning

    @stage_decorator([devices["accelerometer"]])
    def plan() -> Any:
        yield from bps.abs_set(devices["rotation"], 160.0)
        yield from bps.trigger(devices["accelerometer"])
        until_moving(rig)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        engine(plan())
    assert rig.moving() == ()
    assert 0.0 < rig.only("rotation").angle().value < 150.0
    # The record of ten minutes has ended too, else the meter would refuse.
    assert math.isfinite(rig.only("readout").voltage().value)


def test_a_plan_that_is_paused_stands_and_goes_on(turning: tuple[Rig, dict[str, Any]], engine: RunEngine) -> None:
    rig, devices = turning

    def pause() -> None:
        until_moving(rig)
        engine.request_pause()

    def plan() -> Any:
        yield from bps.checkpoint()
        yield from bps.mv(devices["rotation"], 40.0)

    threading.Thread(target=pause).start()
    with pytest.raises(RunEngineInterrupted):
        engine(plan())
    assert rig.moving() == ()
    assert rig.only("rotation").angle().value < 39.0
    assert engine.resume().exit_status == "success"
    assert rig.only("rotation").angle().value == pytest.approx(40.0, abs=1e-3)


@pytest.mark.parametrize("ending", ["abort", "stop", "halt"])
def test_after_the_engine_ends_a_plan_all_is_at_rest(
    turning: tuple[Rig, dict[str, Any]], engine: RunEngine, ending: str
) -> None:
    rig, devices = turning

    def pause() -> None:
        until_moving(rig)
        engine.request_pause()

    threading.Thread(target=pause).start()
    with pytest.raises(RunEngineInterrupted):
        engine(bps.mv(devices["rotation"], 160.0))
    getattr(engine, ending)()
    assert rig.moving() == ()
    assert rig.only("rotation").angle().value < 150.0


def test_a_stage_that_moves_is_not_set_again(turning: tuple[Rig, dict[str, Any]]) -> None:
    rig, devices = turning
    devices["rotation"].set(160.0)
    with pytest.raises(RigError, match=r"^rotation: still on its way to 160; wait until it is there, or stop it$"):
        devices["rotation"].set(10.0)
    devices["rotation"].stop()
    assert devices["rotation"].set(1.0).exception(10.0) is None
    assert rig.only("rotation").angle().value == pytest.approx(1.0, abs=1e-3)


def test_a_motion_that_is_stopped_from_elsewhere_fails(turning: tuple[Rig, dict[str, Any]]) -> None:
    rig, devices = turning
    status = devices["rotation"].set(160.0)
    assert str(status) == "rotation: under way"
    until_moving(rig)
    rig.stop()
    assert isinstance(status.exception(10.0), MotionStopped)
    assert (status.done, status.success) == (True, False)
    heard: list[Any] = []
    status.add_callback(heard.append)
    assert heard == [status]


def test_without_the_package_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bluesky", None)
    with pytest.raises(ConfigError, match=r"^bluesky is not installed; pip install 'rigctl\[bluesky\]' brings it$"):
        importlib.reload(rigctl.bluesky)


POWER_CUT = "[instruments.{0}.faults]\npower_cycle = {{ at_s = 100.0, lasting_s = 20.0 }}\n\n[instruments.{0}]"
"""At a time when nothing has been measured yet."""

ESP301 = (
    'driver = "newport-xps"\naddress = "sim:"                  # tcp://192.168.0.254:5001\nrole = "rotation"\n'
    'group = "Group1"\npositioner = "Pos"',
    'driver = "newport-esp301"\naddress = "sim:"\nrole = "rotation"',
)


@pytest.mark.parametrize("changes", [(), (ESP301,)], ids=["XPS", "ESP301"])
@pytest.mark.parametrize("name", ["rotation", "stage"])
def test_a_stage_that_has_lost_its_power_is_not_believed_again_until_it_is_homed(
    opened: Opened, engine: RunEngine, name: str, changes: tuple[tuple[str, str], ...]
) -> None:
    rig = opened(*changes, (f"[instruments.{name}]", POWER_CUT.format(name)))
    rig.only("linear").home()
    devices = devices_of(rig)
    engine(bps.mv(devices["rotation"], 5.0, devices["stage"], 2.0))
    rig.clock.sleep_s(200.0 - rig.clock.now_s())
    for _ in range(2):
        # It says 0: the first plan finds the connection gone or made anew, the second has a new one.
        with pytest.raises((InstrumentError, LinkError), match=f"^{name}"):
            engine(count([devices[name]]))
    with pytest.raises(InstrumentError, match=f"^{name}: it is homed no more, so that its positions mean nothing"):
        devices[name].locate()
    rig.instruments[name].home()  # type: ignore[attr-defined] # both are stages
    engine(bps.mv(devices[name], 2.0))
    assert devices[name].locate()["readback"] == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("name", ["rotation", "lasers_a", "accelerometer", "thermometer"])
def test_a_reading_is_believed_when_the_instrument_is_in_step_after_it(
    opened: Opened, engine: RunEngine, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    rig = opened()

    def out_of_step() -> None:
        raise OutOfStep(f"{name}: measure again")

    monkeypatch.setattr(rig.instruments[name], "confirm_in_step", out_of_step)
    with pytest.raises((OutOfStep, FailedStatus), match=f"^{name}: measure again$"):
        engine(count([devices_of(rig)[name]]))


def test_a_stage_on_its_way_can_be_read(turning: tuple[Rig, dict[str, Any]]) -> None:
    rig, devices = turning
    status = devices["rotation"].set(160.0)
    until_moving(rig)
    assert 0.0 <= devices["rotation"].read()["rotation_deg"]["value"] < 160.0
    devices["rotation"].stop()
    assert status.exception(10.0) is None
