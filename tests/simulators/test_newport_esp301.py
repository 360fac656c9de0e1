"""The simulated ESP301 on its wire: bytes, queues, motion."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.newport_esp301 import Esp301SimulatorSettings, SimulatedEsp301
from simulators.newport_esp301.commands import AXIS_COMMANDS, CONTROLLER_COMMANDS
from simulators.newport_esp301.grammar import Command, LineReader, format_number, parse_line
from simulators.newport_esp301.parameters import PARAMETERS

NO_ERROR = re.compile(r"0, \d+, NO ERROR DETECTED")


class Bench:
    def __init__(self, **changes: Any) -> None:
        self.clock = VirtualClock()
        self.axes = [MotionAxis(3.0), MotionAxis()]
        self.controller = SimulatedEsp301(self.clock, self.axes, Esp301SimulatorSettings(**changes))
        self.sent: list[bytes] = []
        self.connection = self.controller.connect(self.sent.append)

    def send(self, line: str) -> list[str]:
        """Send a line; the answers that come at once."""
        self.sent.clear()
        self.connection.receive(line.encode("latin-1") + b"\r")
        return self.answers()

    def answers(self) -> list[str]:
        assert all(data.endswith(b"\r\n") for data in self.sent)
        return [data.decode("latin-1")[:-2] for data in self.sent]

    def error(self) -> str:
        (code,) = self.send("TE?")
        return code

    def rest(self, axis: int = 0) -> float:
        self.clock.sleep_s(60.0)
        assert self.axes[axis].velocity(self.clock.now_s()) == 0.0
        return self.axes[axis].position(self.clock.now_s())


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def homed(bench: Bench) -> Bench:
    assert bench.send("1MO;1OR1;1WS0;1MD?") == []
    bench.clock.sleep_s(10.0)
    assert bench.answers() == ["1"]
    return bench


# the wire


def test_the_exchange_of_the_manual(bench: Bench) -> None:
    assert bench.send("1MO") == []
    assert bench.send("1OR1") == []
    assert bench.send("1MD?") == ["0"]
    bench.clock.sleep_s(5.0)
    assert bench.send("1MD?") == ["1"]
    assert bench.send("1PA5.0") == []
    bench.clock.sleep_s(0.4)
    (position,) = bench.send("1TP")
    assert re.fullmatch(r"[1-4]\.\d{4}", position)
    bench.clock.sleep_s(2.0)
    (answer,) = bench.send("TB?")
    assert NO_ERROR.fullmatch(answer)
    assert bench.send("1PA500") == []
    (answer,) = bench.send("TB?")
    assert re.fullmatch(r"106, \d+, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED", answer)
    (answer,) = bench.send("TB?")
    assert NO_ERROR.fullmatch(answer)
    assert len(answer.split(",")) == 3


@pytest.mark.parametrize(
    ("line", "answers"),
    [
        ("VE?", ["ESP301 Version 3.0.1 6/1/99"]),
        ("1ID?", ["RV120HAT, SN0001"]),
        ("1MO?", ["0"]),
        ("1TP", ["0.0000"]),
        ("1TP?", ["0.0000"]),
        ("01TP", ["0.0000"]),
        ("1tp?", ["0.0000"]),
        (" 1 TP ? ", ["0.0000"]),
        ("1DP?", ["0.0000"]),
        ("1TV", ["0.0000"]),
        ("1MD?", ["1"]),
        ("01MD", ["1"]),
        ("1VA?;1AC?;1AG?", ["10.0000", "40.0000", "40.0000"]),
        ("1VU?;1AU?", ["20.0000", "80.0000"]),
        ("1SN?", ["7"]),
        ("1SL?;1SR?", ["-170.0000", "170.0000"]),
        ("1PH", ["0H, 1H"]),
        ("1ZH?", ["24H"]),
        ("1ZB?", ["100H"]),
        ("1KP5.0;1UF;1KP?", ["5.0000"]),
        ("TS", ["P"]),
        ("1MO;TS;2MO?", ["X", "0"]),
        ("TE?", ["0"]),
        ("1FP6;1TP", ["0.000000"]),
        ("1JK5;1JK?", ["5.0000"]),
        ("1VA12.5;2VA?;1VA?", ["10.0000", "12.5000"]),
        (";; ;", []),
        ("", []),
    ],
)
def test_queries_at_power_on(bench: Bench, line: str, answers: list[str]) -> None:
    assert bench.send(line) == answers
    assert bench.error() == "0"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("1XX", "6"),
        ("1XX?", "6"),
        ("gibberish", "6"),
        ("1", "6"),
        ("1VA" + "0" * 80, "6"),
        ("PA5", "37"),
        ("TP?", "37"),
        ("3PA5", "9"),
        ("0TP?", "9"),
        ("1PA", "38"),
        ("1VA", "38"),
        ("1MV", "38"),
        ("1VAfast", "7"),
        ("1MV*", "7"),
        ("1VA-1", "101"),
        ("2SL200", "201"),
        ("1SN12", "101"),
        ("1VA20.1", "110"),
        ("2AC81", "211"),
        ("1PA5", "113"),
        ("2OR1", "213"),
        ("1MV+", "113"),
        ("1MO;1OR7", "101"),
        ("1MO;1PA170.1", "106"),
        ("1MO;1PA-170.1", "107"),
        ("1MO;1OR1;1PA5", "130"),
    ],
)
def test_what_goes_wrong_is_queued_and_not_answered(bench: Bench, line: str, code: str) -> None:
    assert bench.send(line) == []
    assert bench.error() == code
    assert bench.error() == "0"


def test_errors_are_told_oldest_first_with_their_time(bench: Bench) -> None:
    bench.send("1XX")
    bench.clock.sleep_s(2.0)
    bench.send("9TP")
    assert bench.send("TB?;TB?") == ["6, 0, COMMAND DOES NOT EXIST", "9, 5000, AXIS NUMBER OUT OF RANGE"]


def test_a_full_queue_keeps_the_oldest_errors() -> None:
    bench = Bench(errors_queued_max=2)
    bench.send("9TP;1XX;PA5")
    assert [bench.error() for _ in range(3)] == ["9", "6", "0"]


def test_a_line_may_come_in_pieces_and_line_feeds_are_ignored(bench: Bench) -> None:
    bench.connection.receive(b"1T")
    bench.connection.receive(b"P\r\n1M")
    assert bench.answers() == ["0.0000"]
    bench.connection.receive(b"D?\r\n")
    assert bench.answers() == ["0.0000", "1"]


def test_a_client_that_has_gone_is_not_answered(homed: Bench) -> None:
    homed.send("1PA5;1WS;1TP")
    homed.connection.close()
    homed.clock.sleep_s(10.0)
    assert homed.sent == []


# waits


def test_commands_queue_behind_a_wait_for_stop(homed: Bench) -> None:
    started_s = homed.clock.now_s()
    assert homed.send("1PA10;1WS500;1TP;TB?") == []
    assert homed.send("1MD?") == []
    assert homed.clock.wait_for(lambda: bool(homed.sent), 60.0)
    position, error, done = homed.answers()
    assert (position, error[:2], done) == ("10.0000", "0,", "1")
    assert homed.clock.now_s() - started_s == pytest.approx(10 / 10 + 10 / 40 + 0.05 + 0.5, abs=0.01)


def test_a_wait_for_a_position_ends_there_or_at_rest(homed: Bench) -> None:
    assert homed.send("1PA10;1WP4;1TP") == []
    homed.clock.sleep_s(5.0)
    (position,) = homed.answers()
    assert float(position) == pytest.approx(4.0, abs=0.1)
    assert homed.send("1PA0;1WP50;1TP") == []
    homed.clock.sleep_s(5.0)
    assert homed.answers() == ["0.0000"]


def test_waits_that_are_over_do_not_wait(homed: Bench) -> None:
    assert homed.send("1WS;WS0;1WP0;WT0;1MD?") == ["1"]
    assert homed.send("WT100;1MD?") == []
    homed.clock.sleep_s(0.11)
    assert homed.answers() == ["1"]


# motion


def test_moves_are_absolute_or_relative_to_the_last_target(homed: Bench) -> None:
    homed.send("1PA5;1WS;1PR-2.5;1WS;1DP?")
    assert homed.rest() == 2.5
    assert homed.send("1PA?;1DP?;1TP") == ["2.5000"] * 3
    assert homed.send("1PA2.5;1MD?") == ["1"]


@pytest.mark.parametrize(
    ("mode", "place_deg"), [(0, 0.0), (1, 0.0), (2, 0.0), (3, 170.0), (4, -170.0), (5, 170.0), (6, -170.0)]
)
def test_home_searches_end_where_their_mode_says(bench: Bench, mode: int, place_deg: float) -> None:
    bench.send(f"1MO;1OR{mode}")
    assert bench.rest() == place_deg
    assert bench.send("1TP;1MD?;TE?") == ["0.0000", "1", "0"]


def test_a_home_search_without_a_number_has_the_mode_that_was_set(bench: Bench) -> None:
    assert bench.send("1OM?") == ["1"]
    assert bench.send("1OM4;1OM?;TE?") == ["4", "0"]
    bench.send("1MO;1OR")
    assert bench.rest() == -170.0
    assert bench.send("1OM7;TE?;1OM?") == ["101", "4"]


def test_a_new_target_on_the_way_brakes_first(homed: Bench) -> None:
    homed.send("1PA100")
    homed.clock.sleep_s(2.0)
    assert homed.send("1PA0;TE?;1MD?") == ["0", "0"]
    assert homed.axes[0].velocity(homed.clock.now_s() + 0.1) > 0.0
    assert homed.rest() == 0.0


def test_the_end_of_a_move_that_was_replaced_is_not_the_end_of_its_successor(homed: Bench) -> None:
    homed.send("1PA100")
    homed.clock.sleep_s(2.0)
    homed.send("1PA-100")
    homed.clock.sleep_s(100 / 10 + 10 / 40)
    assert homed.axes[0].velocity(homed.clock.now_s()) == -10.0
    assert homed.send("1MD?") == ["0"]
    assert homed.rest() == -100.0


@pytest.mark.parametrize(("line", "motor"), [("1ST", "1"), ("ST", "1"), ("1AB", "0"), ("AB", "0"), ("1MF", "0")])
def test_stops_of_every_kind(homed: Bench, line: str, motor: str) -> None:
    homed.send("1PA100")
    homed.clock.sleep_s(2.0)
    assert homed.send(f"{line};1MD?") == ["0"]
    assert 15.0 < homed.rest() < 30.0
    assert homed.send("1MD?;1MO?;TE?") == ["1", motor, "0"]


def test_an_abort_may_leave_the_motor_on() -> None:
    bench = Bench(abort_turns_motor_off=False)
    assert bench.send("1MO;1AB;1MO?") == ["1"]


def test_a_stop_ends_a_home_search(bench: Bench) -> None:
    bench.axes[0].place(0.0, 100.0)
    bench.send("1MO;1OR1")
    bench.clock.sleep_s(2.0)
    bench.send("1ST")
    assert 70.0 < bench.rest() < 90.0
    assert bench.send("1MD?") == ["1"]


@pytest.mark.parametrize(("line", "place_deg", "code"), [("1MV+", 50.0, "106"), ("1MV-", -40.0, "107")])
def test_a_jog_ends_at_the_software_limit_with_an_error(homed: Bench, line: str, place_deg: float, code: str) -> None:
    homed.send(f"1SL-40;1SR50;{line}")
    assert homed.rest() == place_deg
    assert homed.error() == code


def test_a_move_to_the_hardware_limit_shows_in_the_limit_bits(homed: Bench) -> None:
    homed.send("1MT-")
    assert homed.rest() == -170.0
    assert homed.send("1PH") == ["100H, 0H"]
    homed.send("1MT+")
    assert homed.rest() == 170.0
    assert homed.send("1PH;TE?") == ["1H, 1H", "0"]


def test_after_a_shifted_zero_the_hardware_limit_comes_first(homed: Bench) -> None:
    homed.send("1DH100;1TP")
    assert homed.answers() == ["100.0000"]
    homed.send("1PA-150")
    assert homed.rest() == -170.0
    assert homed.error() == "105"


def test_a_following_error_is_queued_and_switches_the_motor_off(homed: Bench) -> None:
    homed.send("1PA100")
    homed.clock.sleep_s(2.0)
    homed.controller.fail_following(1)
    homed.rest()
    assert homed.send("TB?;1MO?;1MD?")[1:] == ["0", "1"]
    assert homed.send("1PA0;TE?") == ["113"]


def test_axes_move_on_their_own(homed: Bench) -> None:
    homed.send("2MO;2PA20;1PA-20")
    homed.clock.sleep_s(0.5)
    assert homed.send("TS") == ["["]
    assert (homed.rest(0), homed.rest(1)) == (-20.0, 20.0)


def test_a_reset_forgets_everything(homed: Bench) -> None:
    homed.send("1VA5;1PA5;1WS;9TP")
    homed.rest()
    assert homed.send("SM;RS;TE?;1VA?;1MO?;1TP") == ["0", "10.0000", "0", "0.0000"]


def test_speed_and_ramp_shape_the_move(homed: Bench) -> None:
    homed.send("1VA20;1AC80;1AG20;1PA100")
    started_s = homed.clock.now_s()
    assert homed.clock.wait_for(lambda: homed.controller.axes[0].done, 60.0)
    assert homed.clock.now_s() - started_s == pytest.approx(100 / 20 + 20 / 20 + 0.05)


# any input

CODES = [*CONTROLLER_COMMANDS, *AXIS_COMMANDS, *PARAMETERS, "XX"]
PARTS = st.builds(
    lambda axis, code, parameter: f"{axis}{code}{parameter}",
    st.sampled_from(["", "0", "1", "2", "3", "01"]),
    st.sampled_from(CODES),
    st.sampled_from(["", "?", "5", "-3.5", "0", "1", "+", "-", "1e3", "x", "12"]),
)


@settings(max_examples=60)
@given(lines=st.lists(st.tuples(st.lists(PARTS, max_size=4), st.sampled_from([0.0, 0.2, 20.0])), max_size=20))
def test_every_command_in_every_state_gets_one_answer_at_most(lines: list[tuple[list[str], float]]) -> None:
    bench = Bench()
    bench.send("1MO;1OR1")
    bench.sent.clear()
    asked = 0
    for parts, wait_s in lines:
        asked += len(parts)
        bench.connection.receive(";".join(parts).encode() + b"\r")
        bench.clock.sleep_s(wait_s)
    bench.clock.sleep_s(500.0)
    assert len(bench.sent) <= asked
    bench.send("VE?")
    bench.clock.sleep_s(500.0)
    assert bench.answers() == ["ESP301 Version 3.0.1 6/1/99"]


@settings(max_examples=200)
@given(data=st.binary(max_size=80) | st.text(st.sampled_from("12PATB?;\r +-."), max_size=60).map(str.encode))
def test_no_bytes_crash_it(data: bytes) -> None:
    bench = Bench()
    bench.connection.receive(data)
    bench.clock.sleep_s(500.0)
    assert len(bench.sent) <= data.count(b";") + data.count(b"\r")
    bench.connection.receive(b"\r")
    bench.clock.sleep_s(500.0)
    assert bench.send("VE?") == ["ESP301 Version 3.0.1 6/1/99"]


@given(text=st.text(st.sampled_from("1TP?;\r\n "), max_size=60), cut=st.integers(0, 60))
def test_where_the_stream_is_cut_does_not_matter(text: str, cut: int) -> None:
    data = text.encode()
    whole, pieces = LineReader(80), LineReader(80)
    assert [*pieces.feed(data[:cut]), *pieces.feed(data[cut:])] == list(whole.feed(data))


@given(
    axis=st.none() | st.integers(0, 99),
    code=st.from_regex(r"[A-Z]{2}", fullmatch=True),
    parameter=st.from_regex(r"-?[0-9]{0,5}(\.[0-9]{1,3})?", fullmatch=True),
    query=st.booleans(),
)
def test_a_command_parses_into_what_it_was_made_of(axis: int | None, code: str, parameter: str, query: bool) -> None:
    text = f"{'' if axis is None else axis}{code.lower()}{parameter}{'?' if query else ''}"
    assert parse_line(f" {text} ;") == (Command(axis, code, parameter, query),)


@given(value=st.floats(-1e4, 1e4), decimals=st.integers(0, 7))
def test_numbers_have_their_decimals(value: float, decimals: int) -> None:
    text = format_number(value, decimals)
    assert float(text) == pytest.approx(value, abs=0.51 * 10.0**-decimals)
    assert not re.fullmatch(r"-0\.?0*", text)
    assert len(text.partition(".")[2]) == decimals


def test_the_keypad_is_locked_but_where_the_command_is_unknown(bench: Bench) -> None:
    assert bench.send("LC1;LC?") == ["1"]
    assert bench.send("LC0;LC?") == ["0"]
    bench.send("LC2")
    assert bench.error() == "7"
    assert bench.controller.keypad_locked is False
    ignorant = Bench(dialect={"keypad_lock": False})
    ignorant.send("LC1")
    assert ignorant.error() == "6"
