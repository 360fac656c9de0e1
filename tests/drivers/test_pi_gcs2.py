"""The driver of PI's GCS 2.0: the bytes of the C-863's manual, and what it refuses to guess."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.pi_gcs2 import GcsSettings, PiGcsStage
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, MotionStopped
from rigctl.core.findings import Finding
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.pi_gcs2 import Gcs2Dialect, Gcs2SimulatorSettings, SimulatedGcs2
from tests.drivers.ensemble_bench import Tap
from tests.drivers.expected import Expected, Send

IDENTITY = "(c)2021 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0120001234, 1.2.1.0"
HELP = " \n".join(("The following commands are valid:", "DFH?", "FRF", "FRF?", "PUN?", "RON", "RON?", "end of help"))
ZERO = ("DFH? 1", "1=0.000000")
GREETING = (("*IDN?", IDENTITY), ("ERR?", "0"), ("SAI?", "1"), ("HLP?", HELP), ZERO)
HOMED = (ZERO, ("FRF? 1", "1=1"), ("SVO? 1", "1=1"), ("RON? 1", "1=1"))
SEVERAL_AXES = b"SAI?\n", b"1 \n2\n"


def made(endpoint: Endpoint, clock: VirtualClock, **configured: Any) -> PiGcsStage:
    settings = GcsSettings(**{"unit": "deg"} | configured)
    return PiGcsStage("stage", settings, lambda: InProcessTransport("sim:stage", endpoint, clock), clock)


def conversation(*exchanges: tuple[str, str]) -> Expected:
    return Expected(
        *(
            (said.encode() + (b"" if said == "\x05" else b"\n"), reply.encode() + b"\n" if reply else b"")
            for said, reply in (*GREETING, *exchanges)
        )
    )


class Answering:
    """Answers questions, a list reply by reply; what is no question gets nothing."""

    def __init__(self, answers: dict[str, str | list[str]]) -> None:
        self.lines: list[str] = []
        self._answers = answers
        self._send: Send = lambda _: None

    def connect(self, send: Send) -> Answering:
        self._send = send
        return self

    def receive(self, data: bytes) -> None:
        line = data.decode().removesuffix("\n")
        self.lines.append(line)
        answer = self._answers.get(line, "")
        if said := answer.pop(0) if isinstance(answer, list) else answer:
            self._send(said.encode() + b"\n")

    def close(self) -> None:
        pass


class Bench:
    def __init__(self, simulated: dict[str, Any] | None = None, **configured: Any) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis()
        settings = Gcs2SimulatorSettings.model_validate(simulated or {})
        self.controller = SimulatedGcs2(self.clock, self.axis, settings)
        self.tap = Tap(self.controller)
        self.stage = made(self.tap, self.clock, **configured)

    def tell(self, *lines: str) -> None:
        """What another client says to the controller."""
        connection = self.controller.connect(lambda _: None)
        for line in lines:
            connection.receive(line.encode() + b"\n")
        connection.close()


def test_a_move_byte_by_byte() -> None:
    taken = [
        *(("ERR?", "0"), ("VEL 1 10", ""), ("ERR?", "0"), ("VEL? 1", "1=10.000000")),
        *(("ERR?", "0"), ("ACC 1 40", ""), ("ERR?", "0"), ("ACC? 1", "1=4.0000e+01")),
    ]
    said = conversation(
        *HOMED,
        ("PUN? 1", "1=deg"),
        *taken,
        ("ERR?", "0"),
        ("DEC 1 40", ""),
        ("ERR?", "0"),
        ("DEC? 1", "1=39.999"),
        ("ERR?", "10"),
        ("MOV 1 12.5", ""),
        ("ERR?", "0"),
        ("\x05", "1"),
        ("\x05", "0"),
        ("ONT? 1", "1=0"),
        ("SVO? 1", "1=1"),
        ("\x05", "0"),
        ("ONT? 1", "1=1"),
        ("ERR?", "0"),
        ("POS? 1", "1=12.500000"),
        ("STP", ""),
        ("\x05", "0"),
    )
    stage = made(said, VirtualClock())
    stage.open()
    stage.move_to(12.5)
    stage.stop()
    assert not said.left


@pytest.mark.parametrize(
    ("parameter", "others"), [("VEL", ["ACC", "DEC"]), ("ACC", ["VEL", "DEC"]), ("DEC", ["VEL", "ACC"])]
)
def test_a_parameter_that_came_as_another_is_read_back(parameter: str, others: list[str]) -> None:
    told = {each: "1=40" if each != "VEL" else "1=10" for each in others} | {parameter: "1=8"}
    answers = {**dict(HOMED), "PUN? 1": "1=deg", "ERR?": "0", **{f"{name}? 1": reply for name, reply in told.items()}}
    controller = Answering({**dict(GREETING), **answers})
    stage = made(controller, VirtualClock())
    stage.open()
    with pytest.raises(BadReply, match=rf"'{parameter} 1 \d+' is 8 when it is read back"):
        stage.move_to(12.5)
    assert not [line for line in controller.lines if line.startswith("MOV")]


def test_on_a_line_without_parity_one_wrong_bit_makes_no_angle_and_no_rest() -> None:
    controller = Answering({**dict(GREETING), "POS? 1": ["1=1.25", "1=9.25", "1=1.25"], "\x05": ["0", "1", "0", "0"]})
    clock = VirtualClock()

    def line() -> InProcessTransport:
        return InProcessTransport("sim:stage", controller, clock, guarded=False)

    stage = PiGcsStage("stage", GcsSettings(unit="deg"), line, clock)
    stage.open()
    assert stage.angle().value == 1.25
    stage.stop()
    assert controller.lines.count("\x05") == 4


def test_it_tells_who_it_is() -> None:
    bench = Bench()
    bench.stage.open()
    identity = bench.stage.identify()
    assert (identity.model, identity.serial, identity.firmware) == ("C-863.12", "0120001234", "1.2.1.0")


def test_a_unit_that_nobody_tells_is_not_guessed() -> None:
    bench = Bench(unit="unknown")
    bench.stage.open()
    with pytest.raises(InstrumentError, match=r"counts in 'unknown', not in degrees; .*0x07000601.*set `unit`"):
        bench.stage.home()
    assert not bench.axis.moving(bench.clock.now_s())
    (unit, *_) = _examined(Bench(unit="unknown"))
    assert (unit.outcome, "0x07000601" in unit.mend) == ("unknown", True)


def test_a_unit_that_the_controller_tells_goes_before_the_rig_file() -> None:
    millimetres = {"dialect": {"tells_unit": True}, "unit": "MM"}
    bench = Bench(millimetres)
    bench.stage.open()
    with pytest.raises(InstrumentError, match="counts in 'mm'"):
        bench.stage.home()
    degrees = Bench({"dialect": {"tells_unit": True}}, unit="unknown")
    degrees.stage.open()
    degrees.stage.home()


def test_a_question_that_the_controller_does_not_list_is_not_asked() -> None:
    bench = Bench()
    bench.stage.open()
    bench.stage.home()
    bench.stage.move_to(5.0)
    assert bench.tap.sent("PUN?") == []
    assert len(bench.tap.sent("HLP?")) == 1


def test_a_position_that_somebody_has_set_is_no_reference() -> None:
    bench = Bench()
    bench.stage.open()
    # As PIPython's start-up does with the reference mode POS.
    bench.tell("RON 1 0", "POS 1 33.0", "SVO 1 1")
    assert bench.stage.is_homed() is False
    bench.stage.home()
    bench.stage.move_to(5.0)
    assert bench.axis.position(bench.clock.now_s()) == pytest.approx(5.0, abs=1e-3)


def test_a_zero_that_somebody_has_defined_anew_is_an_error() -> None:
    bench = Bench()
    bench.stage.open()
    bench.stage.home()
    bench.stage.move_to(5.0)
    bench.tell("DFH 1")
    for ask in (bench.stage.is_homed, lambda: bench.stage.move_to(6.0)):
        with pytest.raises(InstrumentError, match=r"stage: the zero of axis 1 was defined anew \(DFH\?: 5, not 0\)"):
            ask()


def test_another_axis_or_several_are_refused() -> None:
    with pytest.raises(InstrumentError, match="axes are A, this driver takes one called 1; set `axis`"):
        Bench({"axis": "A"}).stage.open()
    Bench({"axis": "A"}, axis="A").stage.open()
    # Every line of an answer but its last ends in a space.
    said = Expected(*((f"{asked}\n".encode(), f"{reply}\n".encode()) for asked, reply in GREETING[:2]), SEVERAL_AXES)
    with pytest.raises(InstrumentError, match="axes are 1 2, this driver takes one called 1"):
        made(said, VirtualClock()).open()


def test_somebody_elses_stop_is_told_as_one() -> None:
    bench = Bench()
    bench.stage.open()
    bench.stage.home()
    other = made(bench.tap, bench.clock)
    bench.clock.call_at(bench.clock.now_s() + 1.0, other.stop)
    with pytest.raises(MotionStopped, match="MOV 1 90"):
        bench.stage.move_to(90.0)


def test_an_answer_for_another_axis_is_refused() -> None:
    stage = made(conversation(("POS? 1", "2=0.5"), ("*IDN?", IDENTITY)), VirtualClock())
    stage.open()
    with pytest.raises(BadReply, match=r"'POS\?' gave '2=0\.5' instead of '1=\.\.\.'"):
        stage.angle()


def test_an_examination_says_what_is_and_what_differs() -> None:
    assert [finding.outcome for finding in _examined(Bench())] == ["ok", "ok", "ok"]
    unit, limits, state = _examined(Bench(angle_max_deg=175.0))
    assert (unit.outcome, limits.outcome, state.found) == ("ok", "differs", "to be homed")
    assert Gcs2Dialect().tells_unit is False


def _examined(bench: Bench) -> list[Finding]:
    return list(bench.stage.examine())
