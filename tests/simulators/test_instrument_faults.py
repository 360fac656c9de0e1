"""What befalls an instrument shows on its wire in the bytes its protocol has for it: every kind on every one."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.transport import InProcessTransport
from rigctl.core.errors import ConfigError, LinkLost, LinkTimeout
from rigctl.files.rig_file import parse_rig
from rigctl.rig import DRIVERS, Rig, build_simulation, simulator_of
from simulators.clock import VirtualClock
from simulators.declaration import Wiring
from simulators.faults import FaultPlan, FaultyInstrument, random_plans
from simulators.faults.draw import NEVER_DRAWN
from simulators.faults.telemetry import FaultyTelemetry
from simulators.keyence_lkg import SimulatedLkg3001, SimulatedLkg5000
from simulators.keyence_lkg.controller import Controller
from simulators.keysight_34465a import Simulated34465A
from simulators.measured import Measured, unheard
from simulators.rig import SimulatedRig
from simulators.wiring import TriggerLine

RIG = Path(__file__).parent.parent.parent / "campaigns" / "all-instruments.rig.toml"
PLAIN_STAGE = """
[instruments.stage.simulator.dialect]
always_send_eos = true
limit_reply = "refuse"
homing_needed = false
home_async = "keyword"
oscillate_distance = "peak-to-peak"
oscillate_waits = "as moves do"
oscillate_shows = true
oscillate_over_ascii = true
oscillate_frequencies = "optional"
capture_over_ascii = true
capture_short_read = "refuse"

[instruments.stage]
"""
"""The stage's lines here are written for a controller that reads the manual so."""
PLAIN_SOLOIST = (
    PLAIN_STAGE.replace("instruments.stage", "instruments.spare_stage")
    .replace(
        "\n[instruments.spare_stage]\n",
        'questions = "either"\nparameters = "ensemble"\n\n[instruments.spare_stage]\n',
    )
    .lstrip()
)
RIG_TEXT = (
    RIG.read_text(encoding="utf-8")
    .replace("[instruments.stage]\n", PLAIN_STAGE.lstrip(), 1)
    .replace("[instruments.spare_stage]\n", PLAIN_SOLOIST, 1)
)
NAMES = {
    "newport-xps": "rotation",
    "newport-esp301": "spare_rotation",
    "pi-gcs2": "another_rotation",
    "aerotech-ensemble": "stage",
    "aerotech-soloist": "spare_stage",
    "keyence-lkg3001": "lasers_a",
    "keyence-lkg5000": "spare_lasers",
    "keysight-34465a": "accelerometer",
    "keysight-3458a": "spare_meter",
    "keysight-33500b": "spare_source",
}
SIMULATORS = {driver.kind: simulator_of(driver) for driver in DRIVERS.sound()}
SUFFERED = {kind: simulator.faults for kind, simulator in SIMULATORS.items()}
ENDS = {
    "newport-xps": b",EndOfAPI",
    "newport-esp301": b"\r\n",
    "keysight-3458a": b"\r\n",
    "keyence-lkg3001": b"\r",
    "keyence-lkg5000": b"\r",
}


@dataclass(frozen=True)
class Says:
    """Send this and hear that, a regular expression; None: nothing comes."""

    command: str
    reply: str | None


@dataclass(frozen=True)
class Wait:
    """Until this rig time."""

    until_s: float


@dataclass(frozen=True)
class Lost:
    """The connection has ended and nobody listens; with `until_s`, until then."""

    until_s: float


Step = Says | Wait | Lost


clock_rig: WeakKeyDictionary[VirtualClock, SimulatedRig] = WeakKeyDictionary()


def rig_with(
    kind: str, fault: str, name: str = "", text: str = RIG_TEXT
) -> tuple[InProcessTransport, VirtualClock, Callable[[], InProcessTransport]]:
    name = name or NAMES[kind]
    text = text.replace(f"[instruments.{name}]\n", f"[instruments.{name}.faults]\n{fault}\n\n[instruments.{name}]\n")
    clock = VirtualClock()
    simulation = build_simulation(parse_rig(text, RIG), clock)
    clock_rig[clock] = simulation

    def connect() -> InProcessTransport:
        return InProcessTransport(name, simulation.instruments[name], clock)

    return connect(), clock, connect


def play(kind: str, fault: str, steps: Sequence[Step], name: str = "") -> None:
    wire, clock, connect = rig_with(kind, fault, name)
    end = ENDS.get(kind, b"\n")
    for step in steps:
        match step:
            case Wait(until_s):
                clock.sleep_s(until_s - clock.now_s())
            case Lost(until_s):
                with pytest.raises(LinkLost):
                    wire.write(b"\n")
                clock.sleep_s(until_s - clock.now_s())
                wire = connect()
            case Says(command, reply):
                wire.write(command.encode() + (b"" if end == b",EndOfAPI" else b"\r" if b"\r" in end else b"\n"))
                if reply is None:
                    with pytest.raises(LinkTimeout, match="nothing came"):
                        wire.read_until(end, 0.05)
                else:
                    heard = wire.read_until(end, 60.0).removesuffix(end).decode()
                    assert re.fullmatch(reply, heard), (command, heard, reply)


XPS_BRAKES = [Says("GroupStatusGet(Group1,int *)", "0,40"), Wait(10.5)]
"""Who waited has been answered, and the stage still turns."""
XPS_READY = [
    Says("GroupInitialize(Group1)", "0,"),
    Says("GroupHomeSearch(Group1)", "0,"),
]
XPS_MOVE = "GroupMoveAbsolute(Group1,150)"
ESP_READY = [Says("1MO;1OR1;1WS;1MD?", "1"), Says("TB?", "0,.*")]
GCS_READY = [Says("SVO 1 1", None), Says("FRF 1", None), Wait(15.0), Says("FRF? 1", "1=1"), Says("ERR?", "0")]
STAGE_READY = [
    Says("ENABLE X", "%"),
    Says("WAIT MODE NOWAIT", "%"),
    Says("HOMEASYNC X", "%"),
    Wait(10.0),
    Says("AXISFAULT(X)", "%0"),
]
STAGE_MOVES = [*STAGE_READY, Says("MOVEABS X 20 XF1", "%"), Wait(20.5)]


METER_RECORDS = [
    Says("CONF:VOLT:DC 10;:SAMP:SOUR TIM;:SAMP:TIM 0.01;:SAMP:COUN 100000;:TRIG:SOUR BUS;:SENS:VOLT:APER 1e-3", None),
    Says("FORM ASC;:INIT;*TRG", None),
]

SCRIPTS: dict[tuple[str, str], tuple[str, list[Step]]] = {
    ("newport-xps", "power_cycle"): (
        "power_cycle = { at_s = 10.0, lasting_s = 5.0 }",
        [
            *XPS_READY,
            Says("GroupStatusGet(Group1,int *)", "0,11"),
            Wait(11.0),
            Lost(16.0),
            Says("GroupStatusGet(Group1,int *)", "0,0"),
            Says(XPS_MOVE, r"-22,GroupMoveAbsolute\(Group1,150\)"),
            Says("ElapsedTimeGet(double *)", "0,1"),
        ],
    ),
    ("newport-xps", "following_error"): (
        "following_error = { at_s = 10.0 }",
        [
            *XPS_READY,
            Says(XPS_MOVE, r"-25,GroupMoveAbsolute\(Group1,150\)"),
            *XPS_BRAKES,
            Says("GroupStatusGet(Group1,int *)", "0,22"),
            Says("PositionerErrorGet(Group1.Pos,int *)", "0,2"),
        ],
    ),
    ("newport-xps", "limit_hit"): (
        "limit_hit = { at_s = 10.0 }",
        [
            *XPS_READY,
            Says(XPS_MOVE, r"-45,GroupMoveAbsolute\(Group1,150\)"),
            *XPS_BRAKES,
            Says("GroupStatusGet(Group1,int *)", "0,1"),
            Says("PositionerErrorRead(Group1.Pos,int *)", "0,512"),
            Says("PositionerHardwareStatusGet(Group1.Pos,int *)", "0,516"),
            Says("GroupInitialize(Group1)", "0,"),
            Says("PositionerHardwareStatusGet(Group1.Pos,int *)", "0,4"),
        ],
    ),
    ("newport-xps", "emergency_stop"): (
        "emergency_stop = { at_s = 10.0, lasting_s = 20.0 }",
        [
            *XPS_READY,
            Says(XPS_MOVE, r"-26,GroupMoveAbsolute\(Group1,150\)"),
            *XPS_BRAKES,
            Says("GroupStatusGet(Group1,int *)", "0,2"),
            Says("PositionerErrorGet(Group1.Pos,int *)", "0,1"),
            Says("GroupInitialize(Group1)", r"-26,GroupInitialize\(Group1\)"),
            Wait(30.0),
            Says("GroupInitialize(Group1)", "0,"),
            Says("GroupStatusGet(Group1,int *)", "0,42"),
        ],
    ),
    ("newport-esp301", "power_cycle"): (
        "power_cycle = { at_s = 10.0, lasting_s = 5.0 }",
        [
            *ESP_READY,
            Says("1PA90;1MO?", "1"),
            Wait(11.0),
            Says("1TP", None),
            Wait(16.0),
            Says("1MO?", "0"),
            Says("1TP", "0.0000"),
            Says("1PA5;TB?", "113, .*MOTOR NOT ENABLED"),
        ],
    ),
    ("newport-esp301", "following_error"): (
        "following_error = { at_s = 10.0 }",
        [*ESP_READY, Says("1PA90;1WS;TB?", "103, .*FOLLOWING ERROR.*"), Says("1MO?", "0")],
    ),
    ("newport-esp301", "limit_hit"): (
        "limit_hit = { at_s = 10.0 }",
        [*ESP_READY, Says("1PA-90;1WS;TB?", "105, .*NEGATIVE HARDWARE LIMIT.*"), Says("1MO?", "0")],
    ),
    ("newport-esp301", "emergency_stop"): (
        "emergency_stop = { at_s = 10.0, lasting_s = 20.0 }",
        [
            *ESP_READY,
            Says("1PA90;1WS;TB?", "4, .*EMERGENCY STOP ACTIVATED"),
            Says("1MO;1MO?", "0"),
            Says("TE?", "4"),
            Wait(30.0),
            Says("1MO;1MO?", "1"),
        ],
    ),
    ("newport-esp301", "wrong_unit"): (
        "wrong_unit = { at_s = 20.0, lasting_s = 10.0 }",
        [
            *ESP_READY,
            Says("1PA2.5;1WS;1TP", "2.5000"),
            Wait(21.0),
            Says("1SN?", "0"),
            Says("1TP", "25000.0000"),
            Says("1VA?", "100000.0000"),
            Says("1PA10000;1WS;1TP", "10000.0000"),
            Wait(31.0),
            Says("1SN?", "7"),
            Says("1TP", "1.0000"),
        ],
    ),
    ("aerotech-ensemble", "power_cycle"): (
        "power_cycle = { at_s = 20.0, lasting_s = 5.0 }",
        [*STAGE_MOVES, Lost(25.0), Says("AXISSTATUS(X)", "%0"), Says("PFBK(X)", "%0.000000")],
    ),
    ("aerotech-ensemble", "following_error"): (
        "following_error = { at_s = 20.0 }",
        [
            *STAGE_MOVES,
            Says("AXISFAULT(X)", "%1"),
            Says("ENABLE X", "#"),
            Says("FAULTACK X", "%"),
            Says("ENABLE X", "%"),
        ],
    ),
    ("aerotech-ensemble", "limit_hit"): (
        "limit_hit = { at_s = 20.0 }",
        [*STAGE_MOVES, Says("AXISFAULT(X)", "%4"), Says("MOVEABS X 1 XF1", "#")],
    ),
    ("aerotech-ensemble", "emergency_stop"): (
        "emergency_stop = { at_s = 20.0, lasting_s = 10.0 }",
        [
            *STAGE_MOVES,
            Says("AXISFAULT(X)", f"%{1 << 11}"),
            Says("AXISSTATUS(X)", r"%-\d+"),
            Says("ACKNOWLEDGEALL", "%"),
            Says("ENABLE X", "#"),
            Wait(31.0),
            Says("ENABLE X", "#"),
            Says("AXISSTATUS(X)", r"%\d+"),
            Says("ACKNOWLEDGEALL", "%"),
            Says("ENABLE X", "%"),
        ],
    ),
    ("aerotech-ensemble", "air_lost"): (
        "air_lost = { at_s = 20.0, lasting_s = 10.0 }",
        [
            *STAGE_MOVES,
            Says("AXISFAULT(X)", f"%{1 << 15}"),
            Says("MOVEABS X 1 XF1", "#"),
            Says("ACKNOWLEDGEALL", "%"),
            Says("ENABLE X", "#"),
            Wait(31.0),
            Says("ACKNOWLEDGEALL", "%"),
            Says("ENABLE X", "%"),
        ],
    ),
    ("aerotech-ensemble", "wrong_unit"): (
        "wrong_unit = { at_s = 40.0, lasting_s = 10.0 }",
        [
            *STAGE_MOVES,
            Wait(41.0),
            Says("GETPARM(X, 129)", "%in"),
            Says("PFBK(X)", "%0.787402"),
            Says("MOVEABS X 0.5 XF1", "%"),
            Wait(51.0),
            Says("GETPARM(X, 129)", "%mm"),
            Says("PFBK(X)", "%12.700000"),
        ],
    ),
    ("pi-gcs2", "power_cycle"): (
        "power_cycle = { at_s = 20.0, lasting_s = 5.0 }",
        [
            *GCS_READY,
            Says("MOV 1 150", None),
            Wait(20.5),
            Says("POS? 1", None),
            Wait(26.0),
            Says("FRF? 1", "1=0"),
            Says("SVO? 1", "1=0"),
        ],
    ),
    ("pi-gcs2", "following_error"): (
        "following_error = { at_s = 20.0 }",
        [
            *GCS_READY,
            Says("MOV 1 150", None),
            Wait(20.5),
            Says("ERR?", "1024"),
            Says("SVO? 1", "1=0"),
            Says("MOV 1 0", None),
            Says("ERR?", "5"),
        ],
    ),
    ("keysight-3458a", "power_cycle"): (
        "power_cycle = { at_s = 20.0, lasting_s = 5.0 }",
        [
            Says("MEM FIFO;NRDGS 7,AUTO;TRIG AUTO;TARM SGL", None),
            Says("MCOUNT?", " 7"),
            Wait(21.0),
            Lost(25.0),
            Says("MCOUNT?", " 0"),
            Says("TARM?", " 1"),
        ],
    ),
    ("keysight-34465a", "power_cycle"): (
        "power_cycle = { at_s = 5.0, lasting_s = 5.0 }",
        [
            Says("*CLS;*ESR?", r"\+0"),
            Says("FORM REAL;:FORM?", "REAL,64"),
            Says("INIT;*OPC?;:DATA:POIN?", r"1;\+1"),
            Wait(6.0),
            Lost(11.0),
            Says("*ESR?", r"\+128"),
            Says("FORM?", "ASC"),
            Says("DATA:POIN?", r"\+0"),
        ],
    ),
    ("keysight-34465a", "saturation"): (
        "saturation = { at_s = 5.0, lasting_s = 5.0 }",
        [
            Says("CONF:VOLT:DC 10;:READ?", r"[+-]\d\.\d{8}E[+-]0\d"),
            Says("*CLS;STAT:QUES:EVEN?", r"\+0"),
            Wait(6.0),
            Says("READ?", r"[+-]9\.90000000E\+37"),
            Says("STAT:QUES:EVEN?", r"\+1"),
            Wait(11.0),
            Says("READ?", r"[+-]\d\.\d{8}E[+-]0\d"),
        ],
    ),
    ("keysight-34465a", "memory_overflow"): (
        "memory_overflow = { at_s = 5.0 }",
        [*METER_RECORDS, Wait(4.9), Says("STAT:QUES:EVEN?", r"\+0"), Wait(5.1), Says("STAT:QUES:EVEN?", r"\+16384")],
    ),
    ("keysight-33500b", "power_cycle"): (
        "power_cycle = { at_s = 5.0, lasting_s = 5.0 }",
        [
            Says("*CLS;OUTP1 ON;:OUTP1?", "1"),
            Wait(6.0),
            Lost(11.0),
            Says("OUTP1?", "0"),
            Says("*ESR?", r"\+128"),
        ],
    ),
}


def without_axis(step: Step) -> Step:
    """The same to a Soloist: its axis is never named, `D` stands before a position and `F` before a speed."""
    if not isinstance(step, Says):
        return step
    line = step.command.replace("MOVEABS X ", "MOVEABS D").replace(" XF", " F")
    return Says(re.sub(r"\bX\b(, )?", "", line).strip(), step.reply)


SCRIPTS |= {
    ("aerotech-soloist", fault): (text, [without_axis(step) for step in steps])
    for (kind, fault), (text, steps) in SCRIPTS.items()
    if kind == "aerotech-ensemble"
}


@pytest.mark.parametrize(("kind", "fault"), SCRIPTS, ids=lambda each: str(each))
def test_it_shows_on_the_wire(kind: str, fault: str) -> None:
    play(kind, *SCRIPTS[kind, fault])


LASERS: dict[str, tuple[Callable[..., Controller], str]] = {
    "keyence-lkg3001": (SimulatedLkg3001, "M1"),
    "keyence-lkg5000": (SimulatedLkg5000, "MS,01"),
}


class Lasers:
    """A controller with a head that sees 1 mm and a tenth of the time, on a trigger line of ten edges a second."""

    def __init__(self, kind: str, **faults: object) -> None:
        make, self.display = LASERS[kind]
        self.clock = VirtualClock()
        pace = TriggerLine(pulse_s=4e-3)
        pace.begin(0.05, 0.1, 1000)
        plan = FaultPlan.model_validate(faults)
        wiring = Wiring(unheard(), plan, pace)
        inner = make(self.clock, [wiring.signal(lambda times_s: 1.0 + 0.1 * times_s)], wiring.trigger)
        faulty = FaultyInstrument(inner, plan, self.clock, serial=True)
        self.wire = InProcessTransport("lasers", faulty, self.clock)

    def at(self, at_s: float) -> Lasers:
        self.clock.sleep_s(at_s - self.clock.now_s())
        return self

    def ask(self, command: str) -> str:
        self.wire.write(command.encode() + b"\r")
        return self.wire.read_until(b"\r", 2.0).decode().removesuffix("\r")

    def shown(self) -> str:
        return self.ask(self.display).removeprefix(f"{self.display},")


@pytest.mark.parametrize("kind", LASERS)
@pytest.mark.parametrize(
    ("fault", "shown"),
    [("target_lost", "XXXXXXXX"), ("saturation", r"\+FFFFFFF"), ("stuck", r"\+01\.\d{4}")],
)
def test_a_head_that_is_lost_out_of_range_or_stuck(kind: str, fault: str, shown: str) -> None:
    lasers = Lasers(kind, **{fault: {"at_s": 5.0, "lasting_s": 4.0}})
    assert lasers.at(4.0).shown() == "+01.4000"
    first, later = lasers.at(5.5).shown(), lasers.at(8.5).shown()
    assert re.fullmatch(shown, first)
    assert later == first
    assert lasers.at(9.5).shown() == "+01.9500"


@pytest.mark.parametrize("kind", LASERS)
def test_lasers_forget_what_they_stored_and_their_zero_without_power(kind: str) -> None:
    lasers = Lasers(kind, power_cycle={"at_s": 5.0, "lasting_s": 2.0})
    first = kind == "keyence-lkg3001"
    zero, status, setting = ("V1", "AN,1", "SW,CI,0,000200,03") if first else ("VS,01", "AN", "SW,CF,0000020,10")
    for command in ("Q0", *([] if first else ["SW,OK,01,1"]), setting, "R0"):
        lasers.ask(command)
    lasers.at(1.0).ask("AS")
    assert lasers.at(1.1).ask(status) == ("AN,1,1,0000005" if first else "AN,1,0000001,0000000")
    lasers.ask(zero)
    assert lasers.at(1.2).shown() == "+00.0100"
    lasers.at(5.5)
    with pytest.raises(LinkTimeout, match="nothing came"):
        lasers.shown()
    assert lasers.at(8.0).shown() == "+01.8000"
    assert lasers.ask(status) == ("AN,1,0,0000000" if first else "AN,0,0000000,0000000")


def test_edges_that_do_not_arrive_are_not_stored() -> None:
    lasers = Lasers("keyence-lkg5000", missing_edges={"at_s": 1.0, "lasting_s": 0.5})
    for command in ("Q0", "SW,OK,01,1", "SW,CF,0000020,10", "R0"):
        lasers.ask(command)
    lasers.at(0.8).ask("AS")
    stored = lasers.at(2.9).ask("AN")
    assert stored.startswith("AN,1,0000016,")


def test_a_captured_position_is_missing_for_every_edge_that_is() -> None:
    recorded = []
    for fault in ("", "missing_edges = { at_s = 11.0, lasting_s = 0.5 }"):
        wire, clock, connect = rig_with("aerotech-ensemble", fault or "seed = 1")
        wire.close()
        simulation = clock_rig[clock]
        pace = simulation.instruments[NAMES["keysight-34465a"]]
        meter, stage = InProcessTransport("meter", pace, clock), connect()
        for command in ("DATAACQ X INPUT 1", "DATAACQ X TRIGGER 1", "DATAACQ X ON 20"):
            stage.write(command.encode() + b"\n")
            assert stage.read_until(b"\n", 1.0) == b"%\n"
        clock.sleep_s(10.05 - clock.now_s())
        meter.write(b"CONF:VOLT:DC 10;:VOLT:APER 1e-3;:SAMP:SOUR TIM;:SAMP:TIM 0.1;:SAMP:COUN 20\n")
        meter.write(b"TRIG:SOUR BUS;:INIT;*TRG\n")
        clock.sleep_s(5.0)
        stage.write(b"DATAACQ X READ 0, 20\n")
        recorded.append(stage.read_until(b"\n", 1.0))
    assert recorded == [b"%\n", b"#\n"]


def test_a_meter_on_a_sensor_that_is_stuck() -> None:
    clock = VirtualClock()
    wiring = Wiring(unheard(), FaultPlan.model_validate({"stuck": {"at_s": 2.5, "lasting_s": 2.0}}), TriggerLine())
    meter = Simulated34465A(
        clock, wiring.signal(lambda times_s: 0.1 * times_s), wiring.signal(lambda times_s: times_s)
    )
    wire = InProcessTransport("meter", meter, clock)
    wire.write(b"CONF:VOLT:DC 10;:VOLT:APER 1e-3\n")
    found = []
    for at_s in (2.0, 3.0, 4.0, 5.0):
        clock.sleep_s(at_s - clock.now_s())
        wire.write(b"READ?\n")
        found.append(float(wire.read_until(b"\n", 1.0)))
    assert found == pytest.approx([0.2, 0.3, 0.3, 0.5], abs=2e-3)
    assert found[1] == found[2]


def counted(fault: str, at_s: Sequence[float], name: str = "accelerometer", text: str = RIG_TEXT) -> list[int]:
    """Readings in memory at some times of a record of one every 10 ms from 2 s on, or of one for each edge."""
    wire, clock, _ = rig_with("keysight-34465a", fault, name, text)
    pacing = InProcessTransport("meter", clock_rig[clock].instruments["accelerometer"], clock)
    if name != "accelerometer":
        wire.write(b"CONF:TEMP FRTD;:SENS:TEMP:APER 1e-3;:TRIG:SOUR EXT;:TRIG:COUN 10000;:INIT\n")
    clock.sleep_s(2.0)
    pacing.write(b"CONF:VOLT:DC 10;:VOLT:APER 1e-3;:SAMP:SOUR TIM;:SAMP:TIM 0.01;:SAMP:COUN 100000\n")
    pacing.write(b"TRIG:SOUR BUS;:INIT;*TRG\n")
    found = []
    for each_s in at_s:
        clock.sleep_s(each_s - clock.now_s())
        wire.write(b"DATA:POIN?\n")
        found.append(int(wire.read_until(b"\n", 1.0)))
    return found


def test_a_sample_timer_that_stands_still_or_drifts() -> None:
    whole = counted("seed = 1", (4.0, 12.0))
    assert whole == [200, 1000]
    assert counted("clock_jump = { at_s = 3.005, jump_s = 2.0 }", (4.0, 12.0)) == [101, 800]
    assert counted("clock_drift = { ppm = 1e5 }", (4.0, 12.0)) == [220, 1100]


def test_a_jump_of_the_pacing_clock_reaches_those_it_paces() -> None:
    paced = "thermometer"
    head = "[instruments.accelerometer"
    jump = RIG_TEXT.replace(
        f"{head}]", f"{head}.faults]\nclock_jump = {{ at_s = 3.005, jump_s = 2.0 }}\n\n{head}]", 1
    )
    whole = counted("seed = 1", (12.0,), paced)[0]
    assert counted("seed = 1", (12.0,), paced, text=jump)[0] == pytest.approx(0.8 * whole, abs=2)


def test_a_meter_misses_the_edges_that_do_not_arrive() -> None:
    whole = counted("seed = 1", (12.0,), "thermometer")[0]
    assert counted("missing_edges = { at_s = 4.0, lasting_s = 5.0 }", (12.0,), "thermometer")[0] == pytest.approx(
        0.5 * whole, abs=2
    )
    some = counted("missing_edges = { at_s = 0.0, lasting_s = 100.0, share = 0.1 }", (12.0,), "thermometer")[0]
    assert abs(some - 0.9 * whole) < 4 * (0.09 * whole) ** 0.5


def test_somebody_sets_the_meter_to_fahrenheit() -> None:
    play(
        "keysight-34465a",
        "wrong_unit = { at_s = 5.0, lasting_s = 5.0 }",
        [
            Says("CONF:TEMP FRTD;:UNIT:TEMP?", "C"),
            Wait(6.0),
            Says("UNIT:TEMP?", "F"),
            Says("READ?", r"\+[67]\.\d{8}E\+01"),
            Wait(11.0),
            Says("READ?", r"\+2\.\d{8}E\+01"),
        ],
        "thermometer",
    )


def test_clocks_that_drift_make_another_frequency() -> None:
    wire, clock, _ = rig_with("aerotech-ensemble", "clock_drift = { ppm = 1e5 }")
    ready = (b"ENABLE X", b"WAIT MODE NOWAIT", b"OSCILLATE X, 4, 0.5, 10")
    for command in ready:
        wire.write(command + b"\n")
        assert wire.read_until(b"\n", 1.0) == b"%\n"
    axis = clock_rig[clock].bench.axes["linear"]
    assert axis.end_s - clock.now_s() == pytest.approx(20.0 / 1.100012, rel=1e-9)
    wire, clock, _ = rig_with("keysight-33500b", "clock_drift = { ppm = 1e5 }")
    kept = clock_rig[clock].measured.keep()
    wire.write(b"FREQ 0.1;:VOLT 2;:OUTP1 ON\n")
    clock.sleep_s(2.5)
    wire.write(b"PHAS 0\n")
    sine = 2.0 * np.sin(2.0 * np.pi * 0.1 * 1.1 * 2.5)
    assert abs(float(kept[-1].values[0])) == pytest.approx(abs(sine), rel=1e-6)


# a satellite, which has no wire


class Orbiter:
    """Sends a row a second; every accelerometer shows the time."""

    identity = {"model": "orbiter"}
    columns = ("t_s", "m1x_m_s2", "temperature_1_k")
    sample_period_s = 1.0

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.sent = 0

    def begin(self, command: object) -> float:
        return 0.0

    def fetch(self) -> np.ndarray:
        now = int(self.clock.now_s())
        rows = np.array([[t, 1e-9 * t, 290.0] for t in range(self.sent, now)]).reshape(-1, 3)
        self.sent = now
        return rows

    def end(self) -> None:
        pass


def telemetry(**faults: object) -> tuple[list[list[float]], list[float]]:
    """What comes down in four fetches, ten seconds apart, by time; and what was measured."""
    clock = VirtualClock()
    measured = Measured()
    kept = measured.keep()
    plan = FaultPlan.model_validate(faults)
    faulty = FaultyTelemetry(Orbiter(clock), plan, clock, measured.tap("satellite"))
    faulty.begin({})
    came = []
    for _ in range(4):
        clock.sleep_s(10.0)
        came.append(faulty.fetch()[:, 1].tolist())
    return came, np.concatenate([each.values for each in kept if each.channel == "m1x_m_s2"]).tolist()


def joined(packets: list[list[float]]) -> list[float]:
    return list(itertools.chain.from_iterable(packets))


def test_packets_of_telemetry_are_lost_late_or_doubled() -> None:
    whole, truth = telemetry()
    assert joined(whole) == truth
    assert telemetry(silent={"nth": [2]}) == ([whole[0], [], *whole[2:]], truth)
    assert telemetry(late={"nth": [2], "delay_s": 15.0}) == ([whole[0], [], [], joined(whole[1:])], truth)
    assert telemetry(duplicated={"nth": [2]}) == ([whole[0], whole[1] * 2, *whole[2:]], truth)
    with pytest.raises(LinkLost, match="wait for the next contact"):
        telemetry(disconnect={"nth": [3]})


def test_sensors_in_orbit_saturate_and_get_stuck() -> None:
    came, truth = telemetry(saturation={"at_s": 12.0, "lasting_s": 3.0})
    assert came[1] == pytest.approx([1e-8, 1.1e-8, 1e-6, 1e-6, 1e-6, *(1e-9 * t for t in range(15, 20))])
    assert joined(came) == truth
    assert telemetry(saturation={"at_s": 500.0})[0] == telemetry()[0]
    came, truth = telemetry(stuck={"at_s": 18.0, "lasting_s": 5.0})
    assert joined(came)[17:24] == pytest.approx([1.7e-8, *[1.8e-8] * 5, 2.3e-8])
    assert joined(came) == truth


METER = '[instruments.accelerometer]\ndriver = "keysight-34465a"'
"""The readout of the shipped rig, to be another."""


def block_of_a_3458a(fault: str) -> list[float]:
    """Eight readings by the accelerometer's 3458A, 0.25 s apart from 1 s on."""
    text = RIG_TEXT.replace(METER, METER.replace("34465a", "3458a"), 1)
    wire, clock, _ = rig_with("keysight-3458a", fault, "accelerometer", text)
    clock.sleep_s(1.0 - clock.now_s())
    wire.write(b"PRESET NORM;TARM HOLD;DCV 10;APER 1E-3;AZERO OFF;MEM FIFO;TIMER 0.25;NRDGS 8,TIMER;TRIG AUTO\n")
    wire.write(b"TARM SGL\n")
    wire.write(b"RMEM 1,8\n")
    reply = wire.read_until(b"\r\n", 10.0)
    return [clock.now_s(), *(float(value) for value in reply.decode().split(",")[::-1])]


def test_a_3458a_overloads_and_drifts() -> None:
    ended_s, *volts = block_of_a_3458a("seed = 1")
    assert max(map(abs, volts)) < 10.0
    assert ended_s == pytest.approx(1.0 + 1e-3 + 7 * 0.25, abs=1e-6)
    _, *spoilt = block_of_a_3458a("saturation = { at_s = 1.6, lasting_s = 0.5 }")
    assert [abs(value) == 1e38 for value in spoilt] == [False] * 3 + [True] * 2 + [False] * 3
    ended_s, *_ = block_of_a_3458a("clock_drift = { ppm = 1e5 }")
    assert ended_s == pytest.approx(1.0 + 1e-3 + 7 * 0.25 / 1.1, abs=1e-6)


# what there is for whom

ELSEWHERE = {
    *((kind, fault) for kind in LASERS for fault in SUFFERED[kind]),
    *(("keysight-34465a", fault) for fault in ("stuck", "clock_jump", "clock_drift", "missing_edges", "wrong_unit")),
    *(
        (kind, fault)
        for kind in ("aerotech-ensemble", "aerotech-soloist")
        for fault in ("missing_edges", "clock_drift")
    ),
    ("keysight-3458a", "saturation"),
    ("keysight-3458a", "clock_drift"),
    ("keysight-33500b", "clock_drift"),
    ("drag-free-satellite", "saturation"),
    ("drag-free-satellite", "stuck"),
}
"""Shown by a test of its own."""


def test_every_fault_of_every_instrument_is_shown_here() -> None:
    assert set(SCRIPTS) | ELSEWHERE == {(kind, fault) for kind, faults in SUFFERED.items() for fault in faults}


@pytest.mark.parametrize("kind", NAMES)
def test_an_instrument_refuses_what_cannot_befall_it(kind: str) -> None:
    cannot = set(FaultPlan.model_fields) - {"seed"} - set(POSSIBLE[NAMES[kind]])
    tables = {
        "clock_drift": "{ ppm = 1.0 }",
        "bits": "{ nth = [1] }",
        **dict.fromkeys(
            set(FaultPlan.model_fields) & {f for each in SUFFERED.values() for f in each}, "{ at_s = 1.0 }"
        ),
    } | {"clock_drift": "{ ppm = 1.0 }"}
    assert cannot
    for fault in cannot:
        with pytest.raises(ConfigError, match=rf"instruments\.{NAMES[kind]}\.faults\.{fault}: .*; ") as refused:
            rig_with(kind, f"{fault} = {tables.get(fault, '{ at_s = 1.0 }')}")
        assert "\n" not in str(refused.value)


KINDS = {**{name: kind for kind, name in NAMES.items()}, "satellite": "drag-free-satellite"}
POSSIBLE = {
    name: SIMULATORS[kind].possible_faults(serial=DRIVERS.get(kind).serial_baud is not None)
    for name, kind in KINDS.items()
}


@given(seed=st.integers(0, 10_000), faults=st.integers(1, 6), length_s=st.floats(10.0, 1e6))
def test_a_random_plan_is_the_same_again_and_possible(seed: int, faults: int, length_s: float) -> None:
    plans = random_plans(seed, POSSIBLE, length_s=length_s, faults=faults)
    assert plans == random_plans(seed, POSSIBLE, length_s=length_s, faults=faults)
    assert 1 <= sum(len(plan.model_fields_set - {"seed"}) for plan in plans.values()) <= faults
    for name, plan in plans.items():
        assert plan.unsupported(KINDS[name], POSSIBLE[name]) == ""
        written = tomllib.loads(plan.as_toml(name))["instruments"][name]["faults"]
        assert FaultPlan.model_validate(written) == plan


def test_random_plans_reach_every_fault_of_every_instrument() -> None:
    drawn = {
        (KINDS[name], fault)
        for seed in range(1500)
        for name, plan in random_plans(seed, POSSIBLE, length_s=3600.0, faults=4).items()
        for fault in plan.model_fields_set - {"seed"}
    }
    wanted = {(kind, fault) for name, kind in KINDS.items() for fault in POSSIBLE[name] if fault not in NEVER_DRAWN}
    assert drawn == wanted
    assert len({fault for _, fault in drawn}) >= 12


def test_who_connects_in_this_process_while_nobody_listens_is_told() -> None:
    text = RIG_TEXT.replace("[instruments.stage]\n", "[instruments.stage.faults]\nREFUSED\n[instruments.stage]\n", 1)
    rig = Rig(parse_rig(text.replace("REFUSED", "refused = { between_s = [0.0, 60.0] }"), RIG))
    with pytest.raises(LinkLost, match=r"aerotech-ensemble \(simulated\): connection refused; check power"):
        rig.instruments["stage"].open()
    rig.clock.sleep_s(60.0)
    rig.instruments["stage"].open()
    rig.instruments["stage"].close()


def test_a_satellite_of_a_rig_suffers_its_plan_and_refuses_what_needs_a_wire() -> None:
    path = RIG.with_name("microscope-rig.toml")
    text = path.read_text(encoding="utf-8")

    def satellite(fault: str) -> object:
        table = f"[instruments.satellite.faults]\n{fault}\n\n[instruments.satellite]\n"
        file = parse_rig(text.replace("[instruments.satellite]\n", table, 1), path)
        return build_simulation(file, VirtualClock()).ground_segments["satellite"]

    assert isinstance(satellite("silent = { nth = [2] }"), FaultyTelemetry)
    assert not isinstance(satellite(""), FaultyTelemetry)
    with pytest.raises(
        ConfigError, match=r"instruments\.satellite\.faults\.echo: .*; it can have disconnect, duplicated"
    ):
        satellite("echo = { nth = [2] }")
