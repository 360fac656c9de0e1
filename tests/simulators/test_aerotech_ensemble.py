"""The simulated Ensemble: bytes in, bytes out, and an axis that moves as they say."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from simulators.aerotech_ensemble import GENTLE, EnsembleDialect, EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.aerotech_ensemble.grammar import Command, Invalid, move_words, number, parse, whole
from simulators.aerotech_ensemble.status import AxisFault, AxisStatus
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import EndsItself, TriggerLine

X = frozenset({"X", "@0"})
XF = frozenset({"XF", "F"})


class Bench:
    """A simulated Ensemble and one client that sees every byte."""

    def __init__(self, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis()
        self.line = TriggerLine()
        # In the gentler reading of the manual, with what a test says of it.
        said = {key: settings.pop(key) for key in tuple(settings) if key in EnsembleDialect.model_fields}
        dialect = GENTLE.model_copy(update={"home_async": "keyword", **said})
        simulated = EnsembleSimulatorSettings(dialect=dialect, **settings)
        self.ensemble = SimulatedEnsemble(self.clock, self.axis, self.line, simulated)
        self.client = Client(self.ensemble)

    def __call__(self, line: str) -> str:
        """The reply to one line, as far as it has come."""
        return self.client.say(line)

    def enabled(self) -> Bench:
        for line in ("ACKNOWLEDGEALL", "ENABLE X", "WAIT MODE NOWAIT", "RAMP RATE X 1000"):
            assert self(line) == "%\n"
        return self

    def homed(self) -> Bench:
        self.enabled()
        assert self("HOMEASYNC X") == "%\n"
        self.clock.sleep_s(30.0)
        assert self.status() & AxisStatus.HOMED
        return self

    def status(self) -> AxisStatus:
        return AxisStatus(int(self("AXISSTATUS(X)")[1:]) & 0xFFFFFFFF)

    def position_mm(self) -> float:
        return float(self("PFBK(X)")[1:])


class Client:
    def __init__(self, ensemble: SimulatedEnsemble) -> None:
        self.received = bytearray()
        self.connection = ensemble.connect(self.received.extend)

    def say(self, line: str) -> str:
        self.connection.receive(line.encode() + b"\n")
        return self.take()

    def take(self) -> str:
        reply = self.received.decode()
        self.received.clear()
        return reply


# the manual's bytes


def test_it_answers_the_example_exchange_byte_by_byte() -> None:
    bench = Bench(ramp_rate_mm_s2=100.0)
    assert bench("ACKNOWLEDGEALL") == "%\n"
    assert bench("WAIT MODE NOWAIT") == "%\n"
    assert bench("ENABLE X") == "%\n"
    assert bench("WAIT MODE NOWAIT") == "%\n"
    bench.clock.sleep_s(0.1)
    assert bench("AXISSTATUS(X)") == "%2097157\n"
    assert bench("MOVEABS X 5.0 XF20") == "%\n"
    bench.clock.sleep_s(0.1)
    assert bench("AXISSTATUS(X)") == "%2097177\n"
    assert bench("PFBK(X)") == "%0.500000\n"
    assert bench("MOVEABS X 999 XF20") == "#\n"
    assert bench("AXISFAULT(X)") == "%16\n"
    assert bench("NONE") == "!\n"


def test_without_the_bit_a_bare_acknowledge_has_no_line_feed() -> None:
    bench = Bench(always_send_eos=False)
    assert [bench("ENABLE X"), bench("NONE"), bench("ABORT X")] == ["%", "!", "%"]
    assert bench("VERSION") == "%4.01.000\n"


@pytest.mark.parametrize("form", ["PFBK(X)", "PFBK X", "pfbk ( x )", "PFBK(@0)", "PFBK @0", "  Pfbk  x  "])
def test_an_axis_is_named_in_every_form_clients_use(form: str) -> None:
    bench = Bench().enabled()
    bench("MOVEABS X 1.25 XF20")
    bench.clock.sleep_s(10.0)
    assert bench(form) == "%1.250000\n"


@pytest.mark.parametrize(
    "form",
    ["MOVEABS X 5.0 XF20.0", "MOVEABS X 5 XF 20", "MOVEABS @0 5. F 20", "moveabs x5 xf20", "MOVEINC X 5.0 F20.0"],
)
def test_a_move_is_written_in_every_form_clients_use(form: str) -> None:
    bench = Bench(bare_speed_word=True).enabled()
    assert bench(form) == "%\n"
    bench.clock.sleep_s(0.135)
    assert float(bench("VFBK(X)")[1:]) == pytest.approx(20.0)
    bench.clock.sleep_s(1.0)
    assert bench.position_mm() == 5.0


def test_a_bare_speed_word_is_understood_only_in_one_reading_but_in_every_coordinated_move() -> None:
    bench = Bench(bare_speed_word=False).enabled()
    assert bench("MOVEABS X 5.0 F20") == "!\n"
    assert bench("MOVEABS X 5.0 XF20") == "%\n"
    assert bench("LINEAR X 5.0 F20") == "%\n"


EPICS = (
    ("NONE", "!"),
    ("GETPARM(@0, 140)", "%X"),
    ("GETPARM(@1, 140)", "!"),
    ("GETPARM(@0, 47)", "%2.000"),
    ("GETPARM(@0, 2)", "%200000.000"),
    ("GETPARM(@0, 77)", "%0.000"),
    ("GETPARM(@0, 75)", "%0.000"),
    ("GETPARM(@0, 61)", "%6.000"),
    ("RAMP MODE @0 RATE", "%"),
    ("GETPARM(@0, 1)", "%0.000"),
    ("WAIT MODE NOWAIT", "%"),
    ("AXISFAULT @0", "%0"),
    ("ENABLE @0", "%"),
    ("WAIT MODE NOWAIT", "%"),
    ("AXISSTATUS(@0)", "%2097157"),
    ("PLANESTATUS(0)", "%0"),
    ("PFBKPROG(@0)", "%0.000000"),
    ("PCMDPROG(@0)", "%0.000000"),
    ("SETPARM @0, 76, 5.0000000", "%"),
    ("SETPARM @0, 75, 1", "%"),
    ("IGLOBAL(32) = 1", "%"),
    ("IGLOBAL(33) = 0", "%"),
    ('PROGRAM RUN 5, "HomeAsync.bcx"', "!"),
    ("POSOFFSET SET @0, 1.5000000", "%"),
    ("PFBKPROG(@0)", "%1.500000"),
    ("ABS", "%"),
    ("RAMP RATE 100.0000000", "%"),
    ("LINEAR @0 2.5000000 F20.0000000", "%"),
    ("PLANESTATUS(0)", "%5"),
    ("SETPARM @0, 73, 200.0000000", "%"),
    ("RAMP RATE @0 200.0000000", "%"),
    ("FREERUN @0 -2.5000000", "%"),
    ("ABORT @0", "%"),
    ("DISABLE @0", "%"),
)

OTHERS = (
    ("VERSION", "%4.01.000"),
    ("ENABLE X", "%"),
    ("GETMODE(1)", "%1"),
    ("WAIT MODE INPOS", "%"),
    ("GETMODE 1", "%2"),
    ("WAIT MODE NOWAIT", "%"),
    ("FAULTACK X", "%"),
    ("SCURVE 7", "%"),
    ("GETMODE(4)", "%7"),
    ("RAMP TIME 0.2", "%"),
    ("RAMP DIST X 1", "%"),
    ("VELOCITY ON", "%"),
    ("INC", "%"),
    ("GETMODE(0)", "%1"),
    ("PERR(X)", "%0.000000"),
    ("PCMD X", "%0.000000"),
    ("CMDPOS(X)", "%0.000000"),
    ("VCMD(X)", "%0.000000"),
    ("PLANESTATUS 0", "%0"),
    ("TASKSTATE(1)", "%1"),
    ("PROGRAM STOP 1", "%"),
    ('PROGRAM 1 RUN "sine.bcx"', "!"),
    ("DIN X", "%0"),
    ("DOUT X 1", "%"),
    ("AIN X", "%0.000000"),
    ("AOUT X 1.0", "%"),
    ("AOUT X 11", "!"),
    ("IGLOBAL(45)=7", "%"),
    ("IGLOBAL(45)", "%7"),
    ("DGLOBAL(1)=0.5", "%"),
    ("DGLOBAL(1)", "%0.500000"),
    ("DGLOBAL(512)", "!"),
    ("IGLOBAL(50)", "!"),
    ("IGLOBAL(1) = 0.5", "!"),
    ("SETPARM(X,DefaultRampRate,100)", "%"),
    ("GETPARM(@0,DefaultRampRate)", "%100.000"),
    ("GETPARM(X, UnitsName)", "%mm"),
    ("SETPARM X, 72, 0", "!"),
    ("GETPARM(X, 9999)", "!"),
    ("COMMITPARAMETERS", "%"),
    ("ABORT X Y", "!"),
    ("ENABLE Y", "!"),
    ("OSCILLATE X, 5, 0.5", "!"),
    ("OSCILLATE X, 5, 0.5, 10.5", "!"),
    ("OSCILLATE X, 5, 0, 10", "!"),
    ("OSCILLATE X, 5, 0.5, 10, 2", "!"),
    ("OSCILLATE X, 5, 0.5, 10, 1", "%"),
    ("DATAACQ X TRIGGER 1", "%"),
    ("DATAACQ X INPUT 1", "%"),
    ("DATAACQ X ON 200", "%"),
    ("DATAACQ X OFF", "%"),
    ("DATAACQ X READ 10, 40", "#"),
    ("DATAACQ X READ 50, 100", "!"),
    ("DATAACQ X SING 5", "!"),
)


@pytest.mark.parametrize("script", [EPICS, OTHERS], ids=["epics", "others"])
def test_foreign_clients_meet_the_answers_they_expect(script: tuple[tuple[str, str], ...]) -> None:
    bench = Bench()
    answers = []
    for line, _ in script:
        answers.append((line, bench(line).removesuffix("\n")))
        bench.clock.sleep_s(0.01)
    assert answers == list(script)


# the state machine


@pytest.mark.parametrize(("reading", "reply"), [("refuse", "#\n"), ("accept", "%\n")])
def test_an_abort_of_a_disabled_axis_does_as_set_up(reading: str, reply: str) -> None:
    bench = Bench(abort_disabled=reading)
    assert bench("ABORT X") == reply
    assert bench.enabled()("ABORT X") == "%\n"


def test_off_forgets_the_trigger_and_the_input() -> None:
    bench = armed(2)
    for line in ("DATAACQ X OFF", "DATAACQ X ON 2"):
        assert bench(line) == "%\n"
    bench.line.begin(bench.clock.now_s() + 0.1, 0.1, 2)
    bench.clock.sleep_s(1.0)
    assert bench("DATAACQ X READ 0, 2") == "#\n"


@pytest.mark.parametrize("line", ["MOVEABS X 1 XF5", "FREERUN X 1", "HOME X", "HOMEASYNC X", "OSCILLATE X,1,1,1"])
def test_a_disabled_axis_refuses_to_move(line: str) -> None:
    bench = Bench()
    assert bench(line) == "#\n"
    assert bench("AXISFAULT(X)") == "%0\n"
    assert not bench.axis.moving(bench.clock.now_s() + 1.0)


def test_an_axis_may_be_set_up_to_refuse_moves_before_homing() -> None:
    bench = Bench(homing_needed=True).enabled()
    assert bench("MOVEABS X 1 XF5") == "#\n"
    bench("HOMEASYNC X")
    bench.clock.sleep_s(30.0)
    assert bench("MOVEABS X 1 XF5") == "%\n"


def test_a_fault_disables_until_it_is_acknowledged() -> None:
    bench = Bench().enabled()
    bench("MOVEABS X 10 XF20")
    bench.clock.sleep_s(0.3)
    bench.ensemble.controller.trip(AxisFault.EMERGENCY_STOP)
    assert bench("AXISFAULT(X)") == "%2048\n"
    assert bench("ENABLE X") == "#\n"
    assert bench("FAULTACK X") == "%\n"
    bench.clock.sleep_s(1.0)
    assert bench.status() == AxisStatus(0)
    assert bench.position_mm() < 9.0
    assert bench("MOVEABS X 1 XF20") == "#\n"
    assert bench("ENABLE X") == "%\n"
    assert bench("WAIT MODE NOWAIT") == "%\n"
    assert bench("MOVEABS X 1 XF20") == "%\n"


@pytest.mark.parametrize(("style", "reply"), [("refuse", "#\n"), ("fault", "%\n")])
@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("MOVEABS X 25.1 XF5", 16),
        ("MOVEABS X -26 XF5", 32),
        ("MOVEABS X 1 XF2000", 1024),
        ("OSCILLATE X,26,0.1,1", 16),
    ],
)
def test_a_set_point_beyond_a_limit_faults_before_anything_moves(
    style: str, reply: str, line: str, fault: int
) -> None:
    bench = Bench(limit_reply=style).enabled()
    assert bench(line) == reply
    assert bench("AXISFAULT(X)") == f"%{fault}\n"
    bench.clock.sleep_s(5.0)
    assert bench.position_mm() == 0.0


def test_a_motion_the_motor_cannot_follow_is_a_position_error() -> None:
    bench = Bench(acceleration_max_mm_s2=100.0).enabled()
    assert bench("OSCILLATE X, 10, 2, 5") == "%\n"
    assert bench("AXISFAULT(X)") == "%1\n"


def test_a_jog_ends_at_the_soft_limit_and_may_leave_it() -> None:
    bench = Bench().homed()
    assert bench("FREERUN X 10") == "%\n"
    bench.clock.sleep_s(2.49)
    assert bench("AXISFAULT(X)") == "%0\n"
    bench.clock.sleep_s(10.0)
    assert bench("AXISFAULT(X)") == "%16\n"
    assert 25.0 <= bench.position_mm() < 25.2
    for line in ("FAULTACK X", "ENABLE X", "FREERUN X -10"):
        assert bench(line) == "%\n"
    bench.clock.sleep_s(1.0)
    assert bench("AXISFAULT(X)") == "%0\n"
    assert bench.position_mm() < 20.0


def test_before_homing_only_the_limit_switch_stands_in_the_way() -> None:
    bench = Bench(position_max_mm=100.0).enabled()
    assert bench("MOVEABS X 50 XF20") == "%\n"
    bench.clock.sleep_s(10.0)
    assert bench("AXISFAULT(X)") == "%4\n"
    assert bench.status() & AxisStatus.CW_LIMIT_LEVEL
    assert 26.0 <= bench.axis.position(bench.clock.now_s()) < 26.5


def test_homing_makes_positions_relative_to_the_mark() -> None:
    bench = Bench(home_position_mm=-3.0, home_search_s=2.0).enabled()
    bench("MOVEABS X 4 XF20")
    bench.clock.sleep_s(10.0)
    bench("HOMEASYNC X")
    assert bench.status() & (AxisStatus.HOMING | AxisStatus.HOMED) == AxisStatus.HOMING
    bench.clock.sleep_s(30.0)
    assert bench.status() & (AxisStatus.HOMING | AxisStatus.HOMED) == AxisStatus.HOMED
    assert bench.position_mm() == 0.0
    assert bench.axis.position(bench.clock.now_s()) == -3.0


def test_an_aborted_homing_leaves_the_axis_without_reference() -> None:
    bench = Bench(home_position_mm=-20.0).enabled()
    bench("HOMEASYNC X")
    bench.clock.sleep_s(1.0)
    assert bench("ABORT X") == "%\n"
    bench.clock.sleep_s(30.0)
    assert bench.status() == AxisStatus.ENABLED | AxisStatus.IN_POSITION | AxisStatus.SERVO_CONTROL


def test_a_home_program_homes_when_there_is_one() -> None:
    bench = Bench(home_async="program").enabled()
    assert bench('PROGRAM RUN 5, "HomeAsync.bcx"') == "%\n"
    bench.clock.sleep_s(30.0)
    assert bench.status() & AxisStatus.HOMED


def test_an_unknown_homeasync_is_invalid() -> None:
    assert Bench(home_async="none").enabled()("HOMEASYNC X") == "!\n"


def test_an_estop_level_makes_the_status_negative() -> None:
    assert Bench(estop_level=True)("AXISSTATUS(X)") == "%-2147483648\n"


# waiting


def test_home_blocks_the_interpreter_until_it_is_done() -> None:
    bench = Bench(home_search_s=5.0).enabled()
    assert bench("HOME X") == ""
    assert bench("ABORT X") == ""
    bench.clock.sleep_s(4.9)
    assert bench.client.take() == ""
    bench.clock.sleep_s(0.2)
    assert bench.client.take() == "%\n%\n"
    assert bench.status() & AxisStatus.HOMED


def test_enabling_brings_the_default_wait_mode_back() -> None:
    bench = Bench(wait_mode="movedone").enabled()
    assert bench("ENABLE X") == "%\n"
    assert bench("GETMODE(1)") == "%1\n"
    assert bench("MOVEABS X 10 XF10") == ""
    bench.clock.sleep_s(1.0)
    assert bench.client.take() == ""
    bench.clock.sleep_s(0.1)
    assert bench.client.take() == "%\n"


@pytest.mark.parametrize(
    ("waits", "mode", "reply"),
    [
        ("as moves do", "MOVEDONE", ""),
        ("as moves do", "NOWAIT", "%\n"),
        ("never", "MOVEDONE", "%\n"),
        ("always", "NOWAIT", ""),
    ],
)
def test_an_oscillation_waits_if_the_firmware_does(waits: str, mode: str, reply: str) -> None:
    bench = Bench(oscillate_waits=waits).enabled()
    bench(f"WAIT MODE {mode}")
    immediate = bench("OSCILLATE X, 1, 1, 3")
    assert immediate == reply
    bench.clock.sleep_s(3.01)
    assert immediate + bench.client.take() == "%\n"


def test_a_fault_ends_the_waiting_at_once() -> None:
    bench = Bench().enabled()
    bench("WAIT MODE MOVEDONE")
    assert bench("MOVEABS X 20 XF1") == ""
    bench.clock.sleep_s(1.0)
    bench.ensemble.controller.trip(AxisFault.OVER_CURRENT)
    assert bench.client.take() == "#\n"


def test_a_command_that_blocks_too_long_is_answered_with_a_timeout() -> None:
    bench = Bench(command_timeout_s=2.0, home_search_s=10.0).enabled()
    assert bench("HOME X") == ""
    bench.clock.sleep_s(2.1)
    assert bench.client.take() == "$\n"
    assert bench.status() & AxisStatus.HOMING
    bench.clock.sleep_s(30.0)
    assert bench.client.take() == ""


# motion


@pytest.mark.parametrize(("distance", "amplitude_mm"), [("peak-to-peak", 2.5), ("amplitude", 5.0)])
def test_an_oscillation_is_a_raised_cosine(distance: str, amplitude_mm: float) -> None:
    bench = Bench(oscillate_distance=distance, clock_ppm=100.0, harmonics=(0.01,)).enabled()
    start_s = bench.clock.now_s()
    assert bench("OSCILLATE X, 5, 0.5, 10") == "%\n"
    assert bench.status() & AxisStatus.MOVE_ACTIVE
    times_s = start_s + np.linspace(0.0, 19.9, 200)
    phase = 2 * math.pi * 0.5 * (1 + 100e-6) * (times_s - start_s)
    expected_mm = amplitude_mm * (1 - np.cos(phase)) + 0.01 * amplitude_mm * (1 - np.cos(2 * phase))
    np.testing.assert_allclose(bench.axis.sample(times_s)[0], expected_mm, atol=1e-9)
    bench.clock.sleep_s(20.1)
    assert not bench.status() & AxisStatus.MOVE_ACTIVE
    assert bench.position_mm() == 0.0


def test_abort_brakes_smoothly() -> None:
    bench = Bench(abort_deceleration_mm_s2=50.0).enabled()
    bench("OSCILLATE X, 10, 0.5, 100")
    bench.clock.sleep_s(0.5)
    speed_mm_s = bench.axis.velocity(bench.clock.now_s())
    assert bench("ABORT X") == "%\n"
    assert bench.status() & AxisStatus.DECELERATING
    bench.clock.sleep_s(abs(speed_mm_s) / 50.0 + 0.02)
    assert bench.status() & (AxisStatus.IN_POSITION | AxisStatus.MOVE_ACTIVE) == AxisStatus.IN_POSITION


def test_positions_come_in_counts() -> None:
    bench = Bench(counts_per_mm=100.0).enabled()
    bench("MOVEABS X 0.123456 XF20")
    bench.clock.sleep_s(5.0)
    assert bench("PFBK(X)") == "%0.120000\n"
    assert bench("PERR(X)") == "%0.003456\n"


def test_reset_loses_what_was_not_committed() -> None:
    bench = Bench(startup_s=5.0).homed()
    bench("SETPARM X, DefaultSpeed, 3")
    bench("COMMITPARAMETERS")
    bench("SETPARM X, DefaultSpeed, 4")
    assert bench("RESET") == ""
    assert bench.client.connection.hung_up
    again = Client(bench.ensemble)
    assert again.say("GETPARM(X, DefaultSpeed)") == ""
    bench.clock.sleep_s(5.0)
    assert again.take() == "%3.000\n"
    assert again.say("AXISSTATUS(X)") == "%0\n"


# capture


def captured(bench: Bench, first: int, count: int) -> list[float]:
    assert bench(f"DATAACQ X READ {first}, {count}") == "%\n"
    return [float(bench(f"IGLOBAL({i})")[1:]) for i in range(first, first + count)]


def armed(points: int, **settings: Any) -> Bench:
    bench = Bench(integer_registers=70, **settings).enabled()
    for line in ("OSCILLATE X, 10, 0.5, 10", "DATAACQ X INPUT 1", "DATAACQ X TRIGGER 1", f"DATAACQ X ON {points}"):
        assert bench(line) == "%\n"
    return bench


def test_captured_positions_are_the_axis_at_the_edges_plus_latency() -> None:
    bench = armed(50, capture_latency_s=0.003)
    assert bench.status() & AxisStatus.POSITION_CAPTURE
    start_s = bench.clock.now_s() + 0.25
    bench.line.begin(start_s, 0.02, 80)
    bench.clock.sleep_s(2.0)
    assert not bench.status() & AxisStatus.POSITION_CAPTURE
    expected_mm = bench.axis.sample(start_s + 0.003 + 0.02 * np.arange(50))[0]
    assert captured(bench, 10, 50) == np.round(expected_mm * 200_000).tolist()


def test_an_edge_counts_only_when_its_latency_is_over() -> None:
    bench = armed(1, capture_latency_s=0.1)
    bench.line.begin(bench.clock.now_s() + 0.5, 1.0, 1)
    bench.clock.sleep_s(0.55)
    assert bench("DATAACQ X READ 0, 1") == "#\n"
    bench.clock.sleep_s(0.05)
    assert bench("DATAACQ X READ 0, 1") == "%\n"


@pytest.mark.parametrize("mode", ["continues", "restarts"])
def test_a_second_read_does_as_set_up(mode: str) -> None:
    bench = armed(6, capture_read=mode)
    bench.line.begin(bench.clock.now_s() + 0.1, 0.1, 6)
    bench.clock.sleep_s(1.0)
    first, second = captured(bench, 0, 3), captured(bench, 0, 3)
    assert len(set(first)) == 3
    assert (first == second) is (mode == "restarts")
    assert all(value.is_integer() for value in first + second)


def test_a_read_of_more_than_there_is_does_as_set_up() -> None:
    for mode, reply, left in (("refuse", "#\n", "%7\n"), ("partial", "%\n", "%7\n")):
        bench = armed(3, capture_short_read=mode)
        bench("IGLOBAL(2) = 7")
        bench.line.begin(bench.clock.now_s() + 0.1, 0.1, 2)
        bench.clock.sleep_s(1.0)
        assert bench("DATAACQ X READ 0, 3") == reply
        assert bench("IGLOBAL(2)") == left


def test_off_ends_a_capture_and_other_sources_see_no_edges() -> None:
    bench = armed(5, capture_read="continues")
    bench.line.begin(bench.clock.now_s() + 0.1, 0.1, 5)
    bench.clock.sleep_s(0.35)
    bench("DATAACQ X OFF")
    bench.clock.sleep_s(1.0)
    assert len(captured(bench, 0, 3)) == 3
    assert bench("DATAACQ X READ 0, 1") == "#\n"
    bench("DATAACQ X TRIGGER 0")
    bench("DATAACQ X ON 1")
    bench.line.begin(bench.clock.now_s() + 0.1, 0.1, 5)
    bench.clock.sleep_s(1.0)
    assert bench("DATAACQ X READ 0, 1") == "#\n"


def test_encoder_noise_belongs_to_the_run_not_to_the_order_of_asking() -> None:
    def run(key: int, after_s: float) -> list[float]:
        bench = Bench(encoder_noise_mm=1e-4, seed=5, integer_registers=200).enabled()
        bench.clock.sleep_s(after_s)
        bench.ensemble.announce_run(key)
        for line in ("DATAACQ X INPUT 1", "DATAACQ X TRIGGER 1", "DATAACQ X ON 200"):
            bench(line)
        bench.line.begin(bench.clock.now_s() + 0.1, 0.01, 200)
        bench.clock.sleep_s(3.0)
        return captured(bench, 0, 200)

    assert run(1, 0.0) == run(1, 17.0)
    assert run(1, 0.0) != run(2, 0.0)
    assert np.std(run(1, 0.0)) / 200_000 == pytest.approx(1e-4, rel=0.2)


# the socket


def test_a_second_client_waits_until_the_first_has_gone() -> None:
    bench = Bench()
    second = Client(bench.ensemble)
    assert second.say("VERSION") == ""
    assert bench("VERSION") == "%4.01.000\n"
    assert second.take() == ""
    bench.client.connection.close()
    assert second.take() == "%4.01.000\n"
    assert second.say("NONE") == "!\n"


def test_a_silent_client_is_disconnected_and_a_talking_one_is_not() -> None:
    bench = Bench(socket_timeout_s=10.0)
    waiting = Client(bench.ensemble)
    waiting.say("VERSION")
    for _ in range(5):
        bench.clock.sleep_s(6.0)
        assert bench("NONE") == "!\n"
    assert isinstance(bench.client.connection, EndsItself)
    bench.clock.sleep_s(9.9)
    assert not bench.client.connection.hung_up
    bench.clock.sleep_s(0.2)
    assert bench.client.connection.hung_up
    assert waiting.take() == "%4.01.000\n"


def test_a_client_waiting_for_home_is_not_idle() -> None:
    bench = Bench(socket_timeout_s=10.0, home_search_s=60.0).enabled()
    bench("HOME X")
    bench.clock.sleep_s(65.0)
    assert bench.client.take() == "%\n"
    assert not bench.client.connection.hung_up


def test_lines_may_come_in_pieces() -> None:
    bench = Bench()
    for piece in (b"VER", b"SION\nNO", b"NE\n"):
        bench.client.connection.receive(piece)
    assert bench.client.take() == "%4.01.000\n!\n"


# the grammar

WORDS = """X @0 Y @1 5.0 -1 F20 XF 20 0 1E3 1E999 NAN . - ( ) , = , "a b.bcx" 140 DefaultSpeed 999999999999 0.0001 é
MODE RATE TIME MOVEDONE SET RUN STOP ON OFF READ INPUT TRIGGER"""
KEYWORDS = """VERSION ACKNOWLEDGEALL FAULTACK ENABLE DISABLE ABORT HOME HOMEASYNC PROGRAM TASKSTATE WAIT ABS INC
MOVEABS MOVEINC LINEAR FREERUN OSCILLATE RAMP SCURVE VELOCITY PFBK PFBKPROG PCMD PCMDPROG CMDPOS PERR VFBK VCMD
AXISSTATUS AXISFAULT PLANESTATUS POSOFFSET GETPARM SETPARM COMMITPARAMETERS GETMODE DIN DOUT AIN AOUT DATAACQ
IGLOBAL DGLOBAL NONE"""
KEYWORD = st.sampled_from(KEYWORDS.split())
ARGUMENTS = st.lists(st.sampled_from(WORDS.split()), max_size=7)
LINES = st.one_of(
    st.builds(lambda keyword, words: " ".join([keyword, *words]), KEYWORD, ARGUMENTS),
    st.builds(lambda keyword, words: f"{keyword}({', '.join(words)})", KEYWORD, ARGUMENTS),
    st.text(max_size=40).filter(lambda text: "\n" not in text),
)


@given(st.lists(LINES, max_size=12))
@example(["MOVEABS X 1E300 F1E300", "FREERUN X 1E300", "OSCILLATE X, 1E300, 1E3, 1"])
@example(
    ["MOVEABS X 5.0 XF20", "WAIT MODE MOVEDONE", "LINEAR X -1", "OSCILLATE X, 5.0, 20, 20", "HOME X", "FREERUN X -1"]
)
@hypothesis_settings(deadline=None, max_examples=150)
def test_every_line_has_exactly_one_reply(lines: list[str]) -> None:
    bench = Bench(socket_timeout_s=0.0)
    for line in ["ENABLE X", *lines]:
        bench.client.connection.receive(line.encode("utf-8") + b"\n")
        bench.clock.sleep_s(0.05)
        if not bench.client.received:
            bench.clock.sleep_s(1e13)
        reply = bench.client.take()
        assert reply[0] in "%!#"
        assert reply.count("\n") == 1
        assert reply.endswith("\n")


@given(st.floats(min_value=-1e9, max_value=1e9))
def test_a_number_survives_the_wire(value: float) -> None:
    assert number(f"{value:.9f}") == float(f"{value:.9f}")
    assert parse(f"MOVEABS X {value:.6f} F1".encode()).words == ("X", f"{value:.6f}", "F1")


def test_the_grammar_tells_calls_statements_and_assignments_apart() -> None:
    assert parse(b'program run 1, "Sine 1.bcx"\r') == Command("PROGRAM", ("RUN", "1", '"Sine 1.bcx"'))
    assert parse(b"DGLOBAL ( 3 ) = -0.5") == Command("DGLOBAL", ("3",), "-0.5")
    assert move_words(("X", "5", "XF", "20"), X, XF) == (5.0, 20.0)
    assert move_words(("X5", "F20"), X, XF) == (5.0, 20.0)
    assert move_words(("@0", "-.5"), X, XF) == (-0.5, None)
    assert whole("12.0", 0, 12) == 12


@pytest.mark.parametrize(
    "line",
    [b"", b"  ", b"PFBK(X", b"PFBK(X))", b"PFBK(X,,X)", b"PFBK(X) 3", b"(X)", b"DGLOBAL(1)=", b"A" * 300, b"\xff"],
)
def test_what_has_no_shape_is_invalid(line: bytes) -> None:
    with pytest.raises(Invalid):
        parse(line)


def test_limits_must_leave_room() -> None:
    with pytest.raises(ValueError, match="position_min_mm must lie below"):
        EnsembleSimulatorSettings(position_min_mm=1.0, position_max_mm=1.0)
    with pytest.raises(ValueError, match="travel_min_mm must lie below"):
        EnsembleSimulatorSettings(travel_min_mm=1.0, travel_max_mm=1.0)
