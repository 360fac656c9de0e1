"""The Soloist driver: the bytes of the drivers it was written from, and what it finds out of a controller."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Any

import numpy as np
import pytest

from drivers import aerotech_program
from drivers.aerotech_soloist import AerotechSoloist, SoloistSettings
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.errors import InstrumentError, LimitError, WrongInstrument
from rigctl.core.interfaces import LearnsByMoving, LinearStage, PacedRecorder
from simulators.aerotech_soloist import GENTLE, SimulatedSoloist, SoloistDialect, SoloistSimulatorSettings
from simulators.clock import SimulationClock, VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.drivers.ensemble_bench import Tap, expected

REGISTERS = 11
"""Of an imagined controller, found by halving 2 to the 20th: a question beyond the last is not understood."""


def halving(registers: str) -> list[tuple[str, str]]:
    there, beyond, exchanges = 0, 1 << 20, []
    while there < beyond:
        middle = (there + beyond) // 2
        exchanges.append((f"{registers}({middle})", "%0\n" if middle < REGISTERS else "!\n"))
        there, beyond = (middle + 1, beyond) if middle < REGISTERS else (there, middle)
    return exchanges


FIRST = (
    ("NONE", "!\n"),
    ("VERSION", "%2.05.000\n"),
    ("AXISSTATUS()", "%0\n"),
    ("GETPARM(257)", "%X\n"),
    ("GETPARM(140)", "%0.000\n"),
    ("GETPARM(3)", "%10000.000\n"),
    *halving("IGLOBAL"),
    *halving("DGLOBAL"),
    ("GETPARM(47)", "%-25.000\n"),
    ("GETPARM(48)", "%25.000\n"),
)
"""A controller with the numbers of EPICS."""
LATER = (
    ("NONE", "!"),
    ("VERSION", "%4.01.000\n"),
    ("AXISSTATUS()", "!"),
    ("GETPARM(257)", "!"),
    ("GETPARM(140)", "%Z\n"),
    ("GETPARM(129)", "%mm\n"),
    ("GETPARM(2)", "%10000.000\n"),
    ("GETPARM(124)", "%60.000\n"),
    ("GETPARM(125)", "%512.000\n"),
    ("GETPARM(37)", "%-25.000\n"),
    ("GETPARM(38)", "%25.000\n"),
)
"""One with the numbers of the Ensemble, as cockpit's, that knows no `()`."""


def soloist(endpoint: Endpoint, clock: SimulationClock, **configured: Any) -> AerotechSoloist:
    settings = SoloistSettings(**configured)
    return AerotechSoloist("stage", settings, lambda: InProcessTransport("sim:stage", endpoint, clock), clock)


class Bench:
    """A driver on a simulated controller, which is as hard as it can be but for what a test says."""

    def __init__(self, simulated: dict[str, Any] | None = None, **configured: Any) -> None:
        self.clock = VirtualClock()
        self.axis, self.line = MotionAxis(), TriggerLine()
        instrument = SimulatedSoloist(
            self.clock, self.axis, self.line, SoloistSimulatorSettings.model_validate(simulated or {})
        )
        self.tap = Tap(instrument)
        self.stage = soloist(self.tap, self.clock, **{"unit": "mm", "oscillate_distance": "amplitude"} | configured)


def test_a_move_of_a_controller_with_the_numbers_of_epics_byte_by_byte() -> None:
    conversation = expected(
        *FIRST,
        ("AXISSTATUS()", "%2097159\n"),
        ("GETPARM(3)", "%10000.000\n"),
        ("WAIT MODE NOWAIT", "%\n"),
        ("RAMP MODE RATE", "!\n"),
        ("SETPARM 103, 100", "%\n"),
        ("MOVEABS D12.5 F20", "%\n"),
        ("AXISSTATUS()", "%2097179\n"),
        ("AXISSTATUS()", "%2097159\n"),
        ("PFBKPROG()", "%12.499900\n"),
        ("ABORT", "%\n"),
        ("AXISSTATUS()", "%2097159\n"),
    )
    stage = soloist(conversation, VirtualClock(), unit="mm", program="")
    stage.open()
    stage.move_to(12.5)
    stage.stop()
    assert not conversation.left


def test_a_move_of_a_controller_with_the_numbers_of_the_ensemble_byte_by_byte() -> None:
    conversation = expected(
        *LATER,
        ("AXISSTATUS", "%2097159\n"),
        ("GETPARM(129)", "%mm\n"),
        ("GETPARM(2)", "%10000.000\n"),
        ("WAIT MODE NOWAIT", "%"),
        ("RAMP MODE RATE", "%"),
        ("RAMP RATE 100", "%"),
        ("MOVEABS D-1 F20", "%"),
        ("AXISSTATUS", "%2097159\n"),
        ("PFBKPROG", "%-1.000000\n"),
    )
    stage = soloist(conversation, VirtualClock(), program="")
    stage.open()
    stage.move_to(-1.0)
    assert not conversation.left


def test_a_stop_before_anything_is_known_asks_in_the_form_the_controller_knows() -> None:
    conversation = expected(("ABORT", "#"), ("AXISSTATUS()", "!"), ("AXISSTATUS", "%8\n"), ("AXISSTATUS", "%0\n"))
    soloist(conversation, VirtualClock(), program="").stop()
    assert not conversation.left


def test_it_tells_who_it_is() -> None:
    bench = Bench()
    bench.stage.open()
    assert bench.stage.identify().text == "Aerotech Soloist 4.01.000"
    assert isinstance(bench.stage, LinearStage)
    assert isinstance(bench.stage, PacedRecorder)
    assert isinstance(bench.stage, LearnsByMoving)


@pytest.mark.parametrize("questions", ["bare", "parentheses", "either"])
def test_how_it_is_asked_is_found_out(questions: str) -> None:
    bench = Bench({"dialect": {"questions": questions}})
    bench.stage.open()
    bench.stage.position()
    assert bench.tap.lines[-1] == ("PFBKPROG" if questions == "bare" else "PFBKPROG()")


def test_a_unit_that_the_controller_does_not_tell_has_to_be_said() -> None:
    with pytest.raises(WrongInstrument, match=r"counts in 'unknown': look up its unit in Soloist\.chm .* set `unit`"):
        Bench(unit="unknown").stage.open()
    Bench({"dialect": {"parameters": "ensemble"}}, unit="unknown").stage.open()


def test_a_unit_that_the_controller_tells_is_believed_before_the_rig_file() -> None:
    with pytest.raises(WrongInstrument, match=r"counts in 'deg': look up its unit"):
        Bench({"dialect": {"parameters": "ensemble"}, "units": "deg"}).stage.open()


@pytest.mark.parametrize(
    ("replies", "says"),
    [(("%1.000\n", "%0.000\n"), "neither"), (("!\n", "!\n"), "neither"), (("%X\n",) * 2, "both")],
)
def test_parameters_with_numbers_of_neither_source_are_refused(replies: tuple[str, str], says: str) -> None:
    conversation = expected(
        ("NONE", "!\n"),
        ("VERSION", "%4.01.000\n"),
        ("AXISSTATUS()", "%0\n"),
        ("GETPARM(257)", replies[0]),
        ("GETPARM(140)", replies[1]),
    )
    with pytest.raises(WrongInstrument, match=rf"parameters 257 and 140 are {says} a name: .*Soloist\.chm"):
        soloist(conversation, VirtualClock(), unit="mm").open()


@pytest.mark.parametrize("parameters", ["first", "ensemble"])
def test_narrower_limits_of_the_controller_are_told_with_their_numbers(parameters: str) -> None:
    bench = Bench({"dialect": {"parameters": parameters}, "position_max_mm": 20.0})
    numbers = "47 and 48" if parameters == "first" else "37 and 38"
    with pytest.raises(LimitError, match=rf"reaches beyond .* -25 to 20 mm; .*parameters {numbers}"):
        bench.stage.open()


def test_registers_are_counted_where_no_parameter_tells() -> None:
    bench = Bench({"integer_registers": 37})
    bench.stage.open()
    assert bench.stage.longest_record(0.01) == 37 - 10
    assert len(bench.tap.sent("IGLOBAL(")) <= 21


def test_too_few_registers_are_told_before_any_is_used() -> None:
    bench = Bench({"integer_registers": 6})
    bench.stage.open()
    bench.stage.home()
    with pytest.raises(InstrumentError, match=r"has 6 integer and 512 double registers, rigctl\.bcx needs 7 and 2"):
        bench.stage.oscillate(0.0, 1.0, 0.5, 10.0)


def source(name: str) -> str:
    return (files("drivers") / "aerobasic" / name).read_text(encoding="ascii")


def test_its_program_is_the_ensembles_without_an_axis() -> None:
    plain = re.sub(r"(?m)^\s*(?:'.*|DEFINE axisRegister.*|DIM axis .*|axis = .*)\n", "", source("rigctl.ab"))
    ours = re.sub(r"(?m)^\s*'.*\n", "", source("soloist.ab"))
    assert re.sub(r"@axis,? ", "", plain).split() == ours.split()
    assert f"programVersion {aerotech_program.VERSION}" in ours


def test_without_the_program_it_names_the_one_to_load() -> None:
    bench = Bench({"rigctl_program": False})
    bench.stage.open()
    bench.stage.home()
    with pytest.raises(InstrumentError, match=r"compile drivers/aerobasic/soloist\.ab .*#aerotech-soloist"):
        bench.stage.arm(5, 0.01)


@pytest.mark.parametrize("dialect", [SoloistDialect(), GENTLE], ids=["hardest", "gentle"])
def test_it_captures_while_it_oscillates(dialect: SoloistDialect) -> None:
    bench = Bench(
        {"dialect": dialect.model_dump(), "integer_registers": 200}, oscillate_distance=dialect.oscillate_distance
    )
    bench.stage.open()
    bench.stage.home()
    bench.stage.oscillate(0.0, 2.0, 0.5, 60.0)
    bench.stage.arm(150, 0.02)
    first_s = bench.clock.now_s() + 0.2
    bench.line.begin(first_s, 0.02, 150)
    bench.clock.sleep_s(4.0)
    rows = bench.stage.collect()
    truth_mm = bench.axis.sample(first_s + 0.02 * np.arange(150))[0]
    np.testing.assert_allclose(rows[:, 0], truth_mm, atol=2.5e-6 + 1e-12)
    assert np.ptp(truth_mm) == pytest.approx(4.0, abs=0.01)
    assert not [line for line in bench.tap.lines if "X" in line.replace("AXIS", "").replace(".bcx", "")]


@pytest.mark.parametrize("reading", ["peak-to-peak", "amplitude"])
def test_a_millimetre_tells_what_the_distance_is(reading: str) -> None:
    bench = Bench({"dialect": {"oscillate_distance": reading}}, oscillate_distance="unknown")
    bench.stage.open()
    bench.stage.home()
    with pytest.raises(InstrumentError, match=r"look up OSCILLATE in Soloist\.chm"):
        bench.stage.oscillate(0.0, 1.0, 0.5, 10.0)
    assert [(each.key, each.value) for each in bench.stage.learn_by_moving()] == [("oscillate_distance", reading)]
