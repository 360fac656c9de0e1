"""The simulated Soloist: the Ensemble's language without an axis, byte by byte."""

from __future__ import annotations

from typing import Any

import pytest

from simulators.aerotech_soloist import GENTLE, SimulatedSoloist, SoloistDialect, SoloistSimulatorSettings
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.simulators.test_aerotech_ensemble import Client


class Bench:
    def __init__(self, dialect: SoloistDialect = GENTLE, **settings: Any) -> None:
        self.clock = VirtualClock()
        said = SoloistSimulatorSettings(dialect=dialect, **settings)
        self.client = Client(SimulatedSoloist(self.clock, MotionAxis(), TriggerLine(), said))

    def __call__(self, *lines: str) -> list[str]:
        return [self.client.say(line).strip("\n") for line in lines]


def test_it_answers_the_lines_of_its_clients() -> None:
    bench = Bench()
    # EPICS
    assert bench("NONE", "ENABLE", "WAIT MODE NOWAIT", "AXISFAULT()") == ["!", "%", "%", "%0"]
    bench.clock.sleep_s(0.1)
    assert bench("AXISSTATUS()", "PFBKPROG()") == ["%2097157", "%0.000000"]
    # cockpit
    assert bench("MOVEABS D 5.000000 F 20.000000") == ["%"]
    bench.clock.sleep_s(5.0)
    assert bench("AXISSTATUS", "CMDPOS", "PCMD") == ["%2097157", "%5.000000", "%5.000000"]
    assert bench("MOVEINC D-1 F20", "ABORT", "DISABLE") == ["%", "%", "%"]


def test_it_knows_no_axis_and_no_plane() -> None:
    bench = Bench()
    for line in ("ENABLE X", "AXISSTATUS(X)", "PFBK X", "MOVEABS X 5 XF20", "PLANESTATUS(0)", "LINEAR D5 F20"):
        assert bench(line) == ["!"]


def test_the_numbers_of_epics() -> None:
    first = Bench(GENTLE.model_copy(update={"parameters": "first"}), axis="Z", counts_per_mm=1e4)
    assert first("GETPARM(257)", "GETPARM(3)", "GETPARM(47)", "GETPARM(48)", "GETPARM(108)") == [
        "%Z", "%10000.000", "%-25.000", "%25.000", "%0.000",
    ]  # fmt: skip
    assert first("GETPARM(140)", "GETPARM(129)", "GETPARM(9999)", "GETPARM(HomeOffset)") == ["%0.000"] * 2 + ["!"] * 2
    later = Bench()("GETPARM(140)", "GETPARM(129)", "GETPARM(257)", "GETPARM(HomeOffset)")
    assert later == ["%X", "%mm", "!", "%0.000"]


def test_without_ramp_the_parameter_is_the_ramp_from_then_on() -> None:
    hardest = Bench(SoloistDialect(always_send_eos=True, homing_needed=False), wait_mode="nowait")
    assert hardest("RAMP RATE 50", "ENABLE", "SETPARM 103, 50", "MOVEABS D5 F20") == ["!", "%", "%", "%"]
    hardest.clock.sleep_s(0.1)
    assert float(hardest("VFBK")[0][1:]) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("questions", "understood"), [("bare", [False, True]), ("parentheses", [True, False]), ("either", [True, True])]
)
def test_how_it_is_asked(questions: str, understood: list[bool]) -> None:
    bench = Bench(GENTLE.model_copy(update={"questions": questions}))
    for question in ("AXISSTATUS", "PFBKPROG", "VFBK"):
        assert [reply != "!" for reply in bench(f"{question}()", question)] == understood
    # What is no question, or has an argument, is written one way only.
    assert bench("ENABLE", "GETPARM(140)") == ["%", "%X"]
