"""Programs in the simulated Ensemble: the language as far as it goes, and the tasks that run them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.aerotech_ensemble import EnsembleDialect, EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.aerotech_ensemble.aerobasic import compiled
from simulators.aerotech_ensemble.aerobasic_expression import expression, tokens_of
from simulators.aerotech_ensemble.grammar import Command, Invalid
from simulators.aerotech_ensemble.registers import Registers
from simulators.aerotech_ensemble.tasks import SOURCES, TaskState
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine


class Names:
    def value(self, name: str) -> float:
        return {"A": 3.0, "B": -2.0}[name]

    def register(self, kind: str, index: float) -> float:
        return {"IGLOBAL": 100.0, "DGLOBAL": 200.0}[kind] + index


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("8 - 3 - 2", 3.0),
        ("-a * b", 6.0),
        ("IGLOBAL(a - 1) / 2", 51.0),
        ("DGLOBAL(0)", 200.0),
        ("a > b AND NOT b > a", 1.0),
        ("a = 3 or 1 / 0 > 2", 1.0),
        ("a <> 3", 0.0),
        ("2 <= 1 + 1", 1.0),
        (".5e1 - 1.5", 3.5),
    ],
)
def test_an_expression_has_its_value(text: str, value: float) -> None:
    if "1 / 0" in text:
        # Both sides are worked out, as in any BASIC.
        with pytest.raises(ZeroDivisionError):
            expression(tokens_of(text))(Names())
    else:
        assert expression(tokens_of(text))(Names()) == value


@pytest.mark.parametrize("text", ["", "1 +", "(1", "1)", "1 2", "IGLOBAL 3", "a ? b", "* 2"])
def test_what_is_no_expression_is_not_compiled(text: str) -> None:
    with pytest.raises(Invalid):
        expression(tokens_of(text))


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_arithmetic_is_that_of_doubles(a: float, b: float) -> None:
    assert expression(tokens_of(f"({a!r}) - ({b!r})"))(Names()) == a - b


COUNTING = """
' numbers up to IGLOBAL(0) that are no multiple of three, into IGLOBAL(1); their half into DGLOBAL(0)
HEADER
    DEFINE last 0
END HEADER
PROGRAM
    DIM i AS INTEGER
    DIM third AS INTEGER
    DIM half AS DOUBLE
    WHILE i < IGLOBAL(last)
        i = i + 1
        third = i / 3
        IF third * 3 = i THEN
            IGLOBAL(2) = i
        ELSEIF i = 1 THEN
            IGLOBAL(1) = 1
        ELSE
            IGLOBAL(1) = IGLOBAL(1) + 1
            half = IGLOBAL(1) / 2
            DGLOBAL(0) = half
        END IF
    WEND
END PROGRAM
"""


def nothing(_: Command) -> Iterator[float]:
    raise AssertionError


def test_loops_branches_and_variables_do_what_they_say() -> None:
    registers = Registers(EnsembleSimulatorSettings())
    registers.write("IGLOBAL", 0, 10)
    assert sum(compiled(COUNTING).run(registers, nothing)) > 0.0
    assert [registers.value("IGLOBAL", i) for i in (1, 2)] == [7.0, 9.0]
    assert registers.value("DGLOBAL", 0) == 3.5


@pytest.mark.parametrize(
    "source",
    [
        "",
        "PROGRAM",
        "PROGRAM\nIF 1 THEN\nEND PROGRAM",
        "PROGRAM\nWHILE 1\nEND PROGRAM",
        "PROGRAM\nELSE\nEND PROGRAM",
        "HEADER\nPROGRAM\nEND PROGRAM",
        "PROGRAM\nIF 1\nEND IF\nEND PROGRAM",
    ],
)
def test_what_is_no_program_is_not_compiled(source: str) -> None:
    with pytest.raises(Invalid):
        compiled(source)


class Controller:
    """A simulated Ensemble and one client; replies are without line feeds."""

    def __init__(self, *, enabled: bool = True, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis()
        dialect = EnsembleDialect(homing_needed=False, **settings.pop("dialect", {}))
        simulated = EnsembleSimulatorSettings(dialect=dialect, **settings)
        self.line = TriggerLine()
        self.ensemble = SimulatedEnsemble(self.clock, self.axis, self.line, simulated)
        self.received = bytearray()
        self.connection = self.ensemble.connect(self.received.extend)
        if enabled:
            self("ENABLE X")

    def __call__(self, line: str) -> str:
        self.connection.receive(line.encode() + b"\n")
        reply = self.received.decode().strip()
        self.received.clear()
        return reply

    def state(self, task: int) -> TaskState:
        return TaskState(int(self(f"TASKSTATE({task})")[1:]))


def test_a_task_begins_after_its_acknowledge_runs_and_completes() -> None:
    controller = Controller(programs={"wait.bcx": "PROGRAM\nDWELL 2\nEND PROGRAM"}, dialect={"program_start_s": 0.1})
    assert controller('PROGRAM RUN 3, "WAIT.BCX"') == "%"
    states = []
    for _ in range(3):
        states.append(controller.state(3))
        controller.clock.sleep_s(1.5)
    assert states == [TaskState.IDLE, TaskState.RUNNING, TaskState.COMPLETE]


def test_a_task_runs_one_program_until_it_is_stopped() -> None:
    controller = Controller(programs={"wait.bcx": "PROGRAM\nDWELL 2\nIGLOBAL(9) = 1\nEND PROGRAM"})
    assert controller('PROGRAM RUN 3, "wait.bcx"') == "%"
    assert controller('PROGRAM RUN 3, "wait.bcx"') == "#"
    assert controller('PROGRAM RUN 4, "wait.bcx"') == "%"
    controller.clock.sleep_s(1.0)
    for task in (3, 4):
        assert controller(f"PROGRAM STOP {task}") == "%"
        assert controller.state(task) is TaskState.IDLE
    controller.clock.sleep_s(5.0)
    assert controller("IGLOBAL(9)") == "%0"


@pytest.mark.parametrize(
    "line", ["IGLOBAL(60) = 1", "speed = 3", "OSCILLATE @0, 1", "MUMBLE", "OSCILLATE @0, 1, 1, 1"]
)
def test_a_line_that_cannot_be_done_ends_the_program_in_an_error(line: str) -> None:
    controller = Controller(enabled=False, programs={"bad.bcx": f"PROGRAM\n{line}\nEND PROGRAM"})
    controller('PROGRAM RUN 1, "bad.bcx"')
    controller.clock.sleep_s(1.0)
    assert controller.state(1) is TaskState.ERROR


def test_a_program_that_oscillates_leaves_the_interface_free_and_its_wait_mode_alone() -> None:
    source = "PROGRAM\nWAIT MODE MOVEDONE\nOSCILLATE @0, 1, 0.5, 3, 1\nEND PROGRAM"
    controller = Controller(programs={"sine.bcx": source})
    controller("WAIT MODE NOWAIT")
    controller('PROGRAM RUN 1, "sine.bcx"')
    controller.clock.sleep_s(3.0)
    assert controller.axis.moving(controller.clock.now_s())
    assert controller.state(1) is TaskState.RUNNING
    assert controller("GETMODE(1)") == "%0"
    assert controller("ABORT X") == "%"
    controller.clock.sleep_s(1.0)
    assert controller.state(1) is TaskState.COMPLETE


@pytest.mark.parametrize(
    ("keyword", "line"), [("oscillate", "OSCILLATE X, 1, 1, 1, 1"), ("capture", "DATAACQ X OFF")]
)
def test_the_interface_understands_oscillate_and_dataacq_only_in_some_readings(keyword: str, line: str) -> None:
    assert Controller()(line) == "!"
    assert Controller(dialect={f"{keyword}_over_ascii": True, "oscillate_waits": "never"})(line) == "%"


def test_power_lost_ends_all_programs() -> None:
    controller = Controller(programs={"wait.bcx": "PROGRAM\nDWELL 9\nIGLOBAL(9) = 1\nEND PROGRAM"})
    controller('PROGRAM RUN 1, "wait.bcx"')
    controller("RESET")
    controller.clock.sleep_s(20.0)
    controller.connection = controller.ensemble.connect(controller.received.extend)
    assert (controller.state(1), controller("IGLOBAL(9)")) == (TaskState.IDLE, "%0")


def test_our_program_says_its_version_and_takes_its_registers_at_once() -> None:
    controller = Controller(dialect={"program_start_s": 0.0})
    controller("IGLOBAL(0) = 1")
    assert controller('PROGRAM RUN 2, "rigctl.bcx"') == "%"
    controller.clock.sleep_s(1.0)
    assert [controller(f"IGLOBAL({i})") for i in (0, 1, 6)] == ["%-1", "%1", "%1"]


def test_our_program_is_in_ascii_with_comments_for_its_operator() -> None:
    source = (SOURCES / "rigctl.ab").read_text(encoding="ascii")
    assert "rigctl.bcx" in source
    assert Controller(rigctl_program=False)('PROGRAM RUN 2, "rigctl.bcx"') == "!"
