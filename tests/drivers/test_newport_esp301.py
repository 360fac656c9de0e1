"""The ESP301 driver against scripted replies: its exact bytes, and a line that falls out of step."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.newport_esp301 import Esp301Settings, NewportEsp301
from drivers.newport_esp301_line import QueuedError, parse_error
from drivers.transport import InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkTimeout, MotionStopped
from rigctl.core.interfaces import Identity
from simulators.clock import VirtualClock

NO_ERROR = "0, 451322, NO ERROR DETECTED"
VERSION = "ESP301 Version 3.0.1 6/1/99"
ANSWERS = {
    "VE?": VERSION,
    "TB?": NO_ERROR,
    "1MO?": "1",
    "1SN?": "7",
    "1SL?": "-170.0000",
    "1SR?": "170.0000",
    "1MD?": "1",
    "1TP?": "12.5001",
}
SEARCHED: dict[str, str | list[str]] = {"1MD?": ["1", "0", "1"], "1TP?": "0.0000"}
"""How a home search goes that is begun and ends."""
Script = dict[str, str | list[str]]


@dataclass
class Scripted:
    """Answers queries from a script, a list reply by reply, an empty text not at all; commands get nothing.

    Parameters that were set are answered as they were; `on_the_way` spoils what comes, or loses it.
    """

    script: Script
    on_the_way: Callable[[str], str] = lambda line: line
    lines: list[str] = field(default_factory=list)
    sends: list[Callable[[bytes], None]] = field(default_factory=list)
    hung_up: bool = False

    def connect(self, send: Callable[[bytes], None]) -> Scripted:
        self.sends.append(send)
        self.hung_up = False
        return self

    def receive(self, data: bytes) -> None:
        line = data.decode("ascii")
        assert line.endswith("\r")
        self.lines.append(line[:-1])
        came = self.on_the_way(line[:-1])
        if parameter := re.fullmatch(r"(\d(?:VA|AC|AG|OM))([\d.]+)", came):
            self.script[f"{parameter[1]}?"] = parameter[2]
        answer = self.script.get(came)
        if isinstance(answer, list):
            answer = answer.pop(0) if len(answer) > 1 else answer[0]
        if answer:
            self.sends[-1](f"{answer}\r\n".encode())

    def close(self) -> None:
        self.lines.append("<closed>")

    def commands(self) -> list[str]:
        """What is no question, locking the keypad apart."""
        return [line for line in self.lines if not line.endswith("?") and not line.startswith("LC")]


def opened(extra: Script | None = None, **settings: float) -> tuple[NewportEsp301, Scripted]:
    clock = VirtualClock()
    controller = Scripted(copy.deepcopy({**ANSWERS, **(extra or {})}))
    stage = NewportEsp301(
        "rotation", Esp301Settings(**settings), lambda: InProcessTransport("sim:esp", controller, clock), clock
    )
    stage.open()
    return stage, controller


def homed(extra: Script | None = None) -> tuple[NewportEsp301, Scripted]:
    """After a home search that went well; `extra` is what is answered from then on."""
    stage, controller = opened(SEARCHED)
    stage.home()
    controller.lines.clear()
    controller.script.update({**ANSWERS, **(extra or {})})
    return stage, controller


def test_opening_asks_who_is_there_and_empties_the_error_queue() -> None:
    stage, controller = opened({"TB?": ["6, 1, COMMAND DOES NOT EXIST", "106, 2, LIMIT", NO_ERROR]})
    assert controller.lines == ["VE?", "TB?", "TB?", "TB?", "LC0", "TB?"]
    assert stage.identify() == Identity("ESP301", "", "3.0.1 6/1/99", VERSION)


def test_on_a_line_without_parity_one_wrong_bit_makes_no_angle_and_no_rest() -> None:
    controller = Scripted({**ANSWERS, "1TP?": ["1.2500", "9.2500", "1.2500"], "1MD?": ["1", "0", "1"]})
    clock = VirtualClock()
    stage = NewportEsp301(
        "rotation",
        Esp301Settings(),
        lambda: InProcessTransport("sim:esp", controller, clock, guarded=False),
        clock,
    )
    stage.open()
    assert stage.angle().value == 1.25
    stage.stop()
    assert controller.lines.count("1MD?") == 4


def test_an_error_queue_without_an_end_is_a_bad_reply() -> None:
    with pytest.raises(BadReply, match="no end"):
        opened({"TB?": "6, 1, COMMAND DOES NOT EXIST"})


def test_homing_checks_the_axis_sets_it_up_and_looks_for_errors_after_each_command() -> None:
    stage, controller = opened({"1MD?": ["1", "1", "0", "0", "1"], "1TP?": "0.0001"})
    controller.lines.clear()
    stage.home()
    assert controller.lines == [
        "1SN?",
        "1MO?",
        "TB?",
        "1SL?",
        "1SR?",
        *("1VA10", "TB?", "1VA?", "1AC40", "TB?", "1AC?", "1AG40", "TB?", "1AG?", "1OM1", "TB?", "1OM?"),
        "LC1",
        *("TB?", "1MO", "TB?", "1MD?"),
        *("TB?", "1OR", "TB?"),
        *("1MD?", "TB?", "1MD?", "1MD?", "1MD?"),
        "TB?",
        "1TP?",
        "LC0",
    ]


def test_axis_home_mode_and_speed_come_from_the_settings() -> None:
    answers: Script = {f"2{query[1:]}": answer for query, answer in (ANSWERS | SEARCHED).items() if query[0] == "1"}
    stage, controller = opened(answers, axis_number=2, home_mode=4, speed_deg_s=2.5, acceleration_deg_s2=0.5)
    stage.home()
    assert controller.commands() == ["2VA2.5", "2AC0.5", "2AG0.5", "2OM4", "2MO", "2OR"]


@pytest.mark.parametrize(
    ("sent", "came"),
    [("1VA10", ""), ("1VA10", "1VA18"), ("1AC40", ""), ("1AG40", "1AG00"), ("1OM1", "1OM3"), ("1OM1", "1OM0")],
)
def test_a_parameter_that_was_lost_or_spoilt_on_its_way_is_read_back(sent: str, came: str) -> None:
    before: Script = {"1VA?": "4.0000", "1AC?": "20.0000", "1AG?": "20.0000", "1OM?": "3"}
    stage, controller = opened({**SEARCHED, **before})
    controller.on_the_way = lambda line: came if line == sent else line
    with pytest.raises(BadReply, match=rf"rotation: '{sent}' is .* when it is read back"):
        stage.home()
    assert not {"1MO", "1OR"} & set(controller.lines)
    controller.on_the_way = lambda line: line
    stage.home()
    assert stage.is_homed()


def test_a_speed_is_read_back_as_the_controller_rounds_it() -> None:
    stage, _ = opened({**SEARCHED, "1TP?": "0"}, speed_deg_s=3.3333333)
    stage.home()
    assert stage.is_homed()


def test_a_home_search_that_never_began_is_none() -> None:
    stage, controller = opened({"1TP?": "0.0000"})
    with pytest.raises(InstrumentError, match="'1OR' has not begun after 2 s; check cable"):
        stage.home()
    assert stage.is_homed() is False
    with pytest.raises(InstrumentError, match="not homed"):
        stage.move_to(1.0)
    assert "1PA1" not in controller.lines


def test_why_a_home_search_does_not_begin_is_told_as_soon_as_it_is_known() -> None:
    stage, controller = opened(SEARCHED)
    controller.script["1MD?"] = "1"
    controller.script["TB?"] = [*[NO_ERROR] * 11, "127, 1, INVALID TRAJECTORY FOR HOMING", NO_ERROR]
    with pytest.raises(InstrumentError, match="'1OR' failed with 127"):
        stage.home()


def test_a_home_search_that_was_stopped_from_the_front_panel_is_no_reference() -> None:
    stage, _ = opened({**SEARCHED, "1TP?": "-31.4000"})
    with pytest.raises(MotionStopped, match=r"'1OR' ended at -31.4 deg, not at its zero.*stopped by hand"):
        stage.home()
    assert stage.is_homed() is False


def test_a_move_is_sent_once_and_watched() -> None:
    stage, controller = homed({"1MD?": ["0", "0", "1"]})
    stage.move_to(12.5)
    assert controller.lines == [
        *("1SN?", "1MO?", "LC1", "TB?", "1PA12.5", "TB?"),
        *(*["1MD?"] * 3, "TB?", "LC0", "1TP?"),
    ]


@pytest.mark.parametrize(("angle_deg", "text"), [(-0.0, "0"), (1e-5, "0.00001"), (100.0, "100"), (0.1 + 0.2, "0.3")])
def test_targets_are_plain_decimals(angle_deg: float, text: str) -> None:
    stage, controller = homed({"1TP?": str(angle_deg)})
    stage.move_to(angle_deg)
    assert controller.commands() == [f"1PA{text}"]


def test_a_motor_switched_off_behind_our_back_must_be_homed_anew() -> None:
    stage, controller = homed({"1MO?": "0"})
    assert stage.is_homed() is False
    with pytest.raises(InstrumentError, match="not homed"):
        stage.move_to(1.0)
    assert controller.commands() == []


def test_the_error_of_a_command_is_raised_with_code_and_text() -> None:
    stage, controller = homed()
    controller.script["TB?"] = [NO_ERROR, "106, 130211, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED", NO_ERROR]
    with pytest.raises(InstrumentError, match="'1PA160' failed with 106") as raised:
        stage.move_to(160.0)
    assert (raised.value.code, raised.value.text) == ("106", "AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED")


def test_an_older_error_keeps_the_stage_from_moving() -> None:
    stage, controller = homed()
    controller.script["TB?"] = ["103, 1, AXIS-1 FOLLOWING ERROR THRESHOLD EXCEEDED", NO_ERROR]
    with pytest.raises(InstrumentError, match="before 1PA1"):
        stage.move_to(1.0)
    assert controller.commands() == []


def test_a_stage_that_did_not_arrive_was_stopped() -> None:
    stage, _ = homed()
    with pytest.raises(MotionStopped, match=r"ended at 12.5001 deg"):
        stage.move_to(13.0)


def test_another_unit_or_narrow_limits_are_refused_before_the_motor_is_on() -> None:
    stage, controller = opened({"1SN?": "2"})
    with pytest.raises(InstrumentError, match="not in degrees"):
        stage.home()
    assert controller.commands() == []
    stage, controller = opened({"1SL?": "-90"})
    with pytest.raises(LimitError, match="widen SL and SR"):
        stage.home()
    assert controller.commands() == []


def test_a_unit_that_somebody_changed_later_is_noticed_before_a_move_and_when_a_run_is_over() -> None:
    stage, controller = homed({"1SN?": "0"})
    for question in (stage.is_homed, lambda: stage.move_to(12.5)):
        with pytest.raises(InstrumentError, match="axis 1 counts in unit 0, not in degrees; set it up with SN7"):
            question()
    assert controller.commands() == []


def test_stop_decelerates_and_waits_until_it_stands() -> None:
    stage, controller = homed({"1MD?": ["0", "1"]})
    stage.stop()
    assert controller.lines == ["1ST", "1MD?", "1MD?"]


def test_stop_that_has_no_effect_becomes_an_abort() -> None:
    stage, controller = homed({"1MD?": "0"})
    with pytest.raises(InstrumentError, match="'1ST' has not ended"):
        stage.stop()
    assert controller.commands() == ["1ST", "1AB"]


def test_a_keypad_that_cannot_be_locked_is_left_alone() -> None:
    stage, controller = opened({**SEARCHED, "TB?": [NO_ERROR, "6, 1, COMMAND DOES NOT EXIST", NO_ERROR]})
    stage.home()
    controller.script["1TP?"] = "12.5001"
    stage.move_to(12.5)
    assert [line for line in controller.lines if line.startswith("LC")] == ["LC0"]


def test_a_motion_that_fails_leaves_the_keypad_unlocked() -> None:
    stage, controller = homed()
    controller.script["TB?"] = [NO_ERROR, "106, 130211, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED", NO_ERROR]
    with pytest.raises(InstrumentError, match="failed with 106"):
        stage.move_to(160.0)
    assert [line for line in controller.lines if line.startswith("LC")] == ["LC1", "LC0"]


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    stage, controller = homed({"1TP?": ["", "2.0000"]})
    with pytest.raises(LinkTimeout):
        stage.angle()
    controller.sends[-1](b"1.0000\r\n")
    controller.script["VE?"] = "1.0000\r\n" + VERSION
    assert stage.angle().value == 2.0
    assert controller.lines == ["1TP?", "VE?", "1TP?"]


def test_stop_goes_out_at_once_even_when_answers_are_overdue() -> None:
    stage, controller = homed({"1TP?": ""})
    with pytest.raises(LinkTimeout):
        stage.angle()
    stage.stop()
    assert controller.lines == ["1TP?", "1ST", "VE?", "1MD?"]


def test_after_a_lost_connection_the_reference_is_not_believed() -> None:
    stage, controller = homed()
    assert stage.is_homed()
    controller.hung_up = True
    assert stage.is_homed() is False
    assert len(controller.sends) == 2


@pytest.mark.parametrize("answer", ["", "abc", "1.0 2.0", "nan", "0x10"])
def test_an_angle_that_is_no_number(answer: str) -> None:
    stage, _ = homed({"1TP?": answer or " "})
    with pytest.raises(BadReply, match=r"rotation: '1TP\?' gave"):
        stage.angle()


@pytest.mark.parametrize(
    "answer", ["0", "0, 1", "x, 1, NO", "-1, 2, NO", "1, 2, NO ERROR DETECTED", "0, 2, FOLLOWING ERROR", "0, 2, "]
)
def test_an_error_report_of_another_form(answer: str) -> None:
    with pytest.raises(BadReply, match="code, timestamp, text"):
        opened({"TB?": answer})


@pytest.mark.parametrize("bit", range(7))
@pytest.mark.parametrize(
    "sent", ["4, 2815140, EMERGENCY STOP ACTIVATED", "106, 2, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED"]
)
def test_a_turned_bit_in_the_code_erases_no_safety_stop(sent: str, bit: int) -> None:
    stage, controller = homed()
    turned = chr(ord(sent[0]) ^ 1 << bit) + sent[1:]
    controller.script["TB?"] = [turned, NO_ERROR]
    assert sent.rpartition(", ")[2] in stage.safety_stop()


def test_a_turned_bit_in_the_answer_that_the_queue_is_empty_is_no_error() -> None:
    stage, controller = homed()
    for answer in ("4, 451322, NO ERROR DETECTED", "0, 451322, NO ERROS DETECTED"):
        controller.script["TB?"] = [answer, NO_ERROR]
        with pytest.raises(BadReply, match="that agree"):
            stage.safety_stop()


@given(
    code=st.integers(1, 999),
    timestamp=st.integers(0, 10**9),
    text=st.text(st.characters(min_codepoint=32, max_codepoint=126)).map(str.strip),
)
def test_an_error_report_parses_into_what_it_was_made_of(code: int, timestamp: int, text: str) -> None:
    assert parse_error(f"{code}, {timestamp}, {text}") == QueuedError(code, text)


@given(answer=st.text(st.characters(max_codepoint=255), max_size=40))
def test_no_text_crashes_the_parser(answer: str) -> None:
    try:
        error = parse_error(answer)
    except ValueError:
        return
    assert error.code == int(answer.split(",")[0])
