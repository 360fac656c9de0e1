"""The XPS driver against scripted replies: its exact bytes, and replies as the wire may deliver them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.newport_xps import NewportXps, XpsSettings
from drivers.newport_xps_socket import Reply, parse_reply
from drivers.transport import InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, LinkError, LinkTimeout, MotionStopped, OutOfStep
from rigctl.core.interfaces import Identity
from simulators.clock import VirtualClock

END = b",EndOfAPI"
SILENCE = b""
HOMED = {
    "FirmwareVersionGet(char *)": b"0,XPS-Q8 Firmware Precision Platform V1.4.2,EndOfAPI",
    "PositionerUserTravelLimitsGet(Group1.Pos,double *,double *)": b"0,-170,170,EndOfAPI",
    "PositionerSGammaParametersGet(Group1.Pos,double *,double *,double *,double *)": b"0,5,20,0.005,0.05,EndOfAPI",
    "PositionerSGammaParametersSet(Group1.Pos,10,40,0.005,0.05)": b"0,,EndOfAPI",
    "GroupStatusGet(Group1,int *)": b"0,11,EndOfAPI",
    "GroupMoveAbsolute(Group1,12.5)": b"0,,EndOfAPI",
    "GroupMoveAbort(Group1)": b"-22,GroupMoveAbort(Group1),EndOfAPI",
    "GroupPositionCurrentGet(Group1,double *)": b"0,0.000314605934,EndOfAPI",
}
PREPARATION = [
    "PositionerUserTravelLimitsGet(Group1.Pos,double *,double *)",
    "PositionerSGammaParametersGet(Group1.Pos,double *,double *,double *,double *)",
    "PositionerSGammaParametersSet(Group1.Pos,10,40,0.005,0.05)",
]
Script = dict[str, bytes | list[bytes]]


@dataclass
class Scripted:
    """Answers each request from a script; a list is used up reply by reply. Keeps (socket, request) pairs."""

    script: Script
    requests: list[tuple[int, str]] = field(default_factory=list)
    sends: list[Callable[[bytes], None]] = field(default_factory=list)

    def connect(self, send: Callable[[bytes], None]) -> ScriptedConnection:
        self.sends.append(send)
        return ScriptedConnection(self, len(self.sends))

    def answer(self, socket: int, request: str) -> bytes:
        self.requests.append((socket, request))
        reply = self.script[request]
        if isinstance(reply, list):
            return reply.pop(0) if len(reply) > 1 else reply[0]
        return reply

    def texts(self) -> list[str]:
        return [request for _, request in self.requests]


@dataclass
class ScriptedConnection:
    controller: Scripted
    socket: int

    def receive(self, data: bytes) -> None:
        self.controller.sends[self.socket - 1](self.controller.answer(self.socket, data.decode()))

    def close(self) -> None:
        self.controller.requests.append((self.socket, "<closed>"))


def stage_on(controller: Scripted, clock: VirtualClock | None = None, **settings: float) -> NewportXps:
    time = clock or VirtualClock()
    return NewportXps(
        "rotation", XpsSettings(**settings), lambda: InProcessTransport("sim:xps", controller, time), time
    )


def opened(extra: Script | None = None, clock: VirtualClock | None = None) -> tuple[NewportXps, Scripted]:
    controller = Scripted({**HOMED, **(extra or {})})
    stage = stage_on(controller, clock)
    stage.open()
    controller.requests.clear()
    return stage, controller


def test_opening_makes_two_connections_and_asks_who_is_there() -> None:
    controller = Scripted(dict(HOMED))
    stage = stage_on(controller)
    stage.open()
    assert len(controller.sends) == 2
    assert controller.texts() == ["FirmwareVersionGet(char *)"]
    assert stage.identify() == Identity("XPS-Q8", "", "V1.4.2", "XPS-Q8 Firmware Precision Platform V1.4.2")


def test_a_killed_group_is_killed_initialised_and_homed() -> None:
    status = [b"0,7,EndOfAPI", b"0,42,EndOfAPI", b"0,11,EndOfAPI"]
    done = {f"Group{act}(Group1)": b"0,,EndOfAPI" for act in ("Kill", "Initialize", "HomeSearch")}
    stage, controller = opened({"GroupStatusGet(Group1,int *)": status, **done})
    stage.home()
    assert controller.texts() == [
        *PREPARATION,
        "GroupStatusGet(Group1,int *)",
        "GroupKill(Group1)",
        "GroupInitialize(Group1)",
        "GroupStatusGet(Group1,int *)",
        "GroupHomeSearch(Group1)",
        "GroupStatusGet(Group1,int *)",
    ]


def test_an_initialised_group_is_only_homed_and_a_disabled_one_only_enabled() -> None:
    stage, controller = opened(
        {
            "GroupStatusGet(Group1,int *)": [b"0,42,EndOfAPI", b"0,11,EndOfAPI"],
            "GroupHomeSearch(Group1)": b"0,,EndOfAPI",
        }
    )
    stage.home()
    assert [text for text in controller.texts() if "Status" not in text] == [*PREPARATION, "GroupHomeSearch(Group1)"]
    stage, controller = opened(
        {
            "GroupStatusGet(Group1,int *)": [b"0,20,EndOfAPI", b"0,13,EndOfAPI"],
            "GroupMotionEnable(Group1)": b"0,,EndOfAPI",
        }
    )
    stage.home()
    assert [text for text in controller.texts() if "Status" not in text] == [
        *PREPARATION,
        "GroupMotionEnable(Group1)",
    ]


def test_a_homed_group_is_left_alone() -> None:
    stage, controller = opened()
    stage.home()
    assert controller.texts() == [*PREPARATION, "GroupStatusGet(Group1,int *)"]
    assert stage.is_homed()


def test_a_group_that_is_jogging_is_not_touched() -> None:
    stage, controller = opened(
        {
            "GroupStatusGet(Group1,int *)": b"0,47,EndOfAPI",
            "GroupStatusStringGet(47,char *)": b"0,Jogging state due to a JogEnable command,EndOfAPI",
        }
    )
    with pytest.raises(InstrumentError, match=r"Group1 is in state 47 .Jogging state") as raised:
        stage.home()
    assert raised.value.code == "47"
    assert not any("Kill" in text or "Home" in text for text in controller.texts())


def test_moves_and_queries_have_a_socket_each() -> None:
    stage, controller = opened({"GroupPositionCurrentGet(Group1,double *)": b"0,12.500314605934,EndOfAPI"})
    stage.move_to(12.5)
    assert stage.angle().value == 12.500314605934
    assert controller.requests == [
        *((1, text) for text in PREPARATION),
        (2, "GroupMoveAbsolute(Group1,12.5)"),
        (1, "GroupStatusGet(Group1,int *)"),
        (1, "GroupPositionCurrentGet(Group1,double *)"),
        (1, "GroupPositionCurrentGet(Group1,double *)"),
    ]


@pytest.mark.parametrize(
    ("status", "angle_deg"),
    [(b"44", b"5.0"), (b"44", b"12.5"), (b"11", b"0.0")],
    ids=["on the way", "near", "not yet"],
)
def test_a_reply_that_came_twice_ends_no_later_move(status: bytes, angle_deg: bytes) -> None:
    """The copy of an earlier move's reply comes when the next has just been sent."""
    stage, controller = opened(
        {
            "GroupMoveAbsolute(Group1,12.5)": b"0,,EndOfAPI",
            "GroupPositionCurrentGet(Group1,double *)": b"0," + angle_deg + b",EndOfAPI",
            "GroupStatusGet(Group1,int *)": b"0," + status + b",EndOfAPI",
            "GroupMoveAbort(Group1)": b"0,,EndOfAPI",
        }
    )
    with pytest.raises(
        OutOfStep, match=r"GroupMoveAbsolute.* was answered at .* it was stopped, measure again"
    ) as early:
        stage.move_to(12.5)
    assert early.value.instrument == "rotation"
    assert controller.requests[-2:] == [(2, "<closed>"), (1, "GroupMoveAbort(Group1)")]
    # The reply to the move that went on, on the old connection, is nobody's.
    controller.script["GroupPositionCurrentGet(Group1,double *)"] = b"0,12.5,EndOfAPI"
    controller.script["GroupStatusGet(Group1,int *)"] = b"0,12,EndOfAPI"
    stage.move_to(12.5)
    assert (3, "GroupMoveAbsolute(Group1,12.5)") in controller.requests


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(-0.0, "0"), (1e-5, "0.00001"), (-1e-9, "0"), (100.0, "100"), (0.1 + 0.2, "0.3"), (-33.3333333, "-33.333333")],
)
def test_targets_are_plain_decimals(angle_deg: float, text: str) -> None:
    request = f"GroupMoveAbsolute(Group1,{text})"
    there = f"0,{angle_deg},EndOfAPI".encode()
    stage, controller = opened({request: b"0,,EndOfAPI", "GroupPositionCurrentGet(Group1,double *)": there})
    stage.move_to(angle_deg)
    assert request in controller.texts()


def test_a_reply_may_come_in_pieces_and_late() -> None:
    clock = VirtualClock()
    request = "GroupPositionCurrentGet(Group1,double *)"
    stage, controller = opened({request: SILENCE}, clock)
    for delay_s, piece in ((0.5, b"0,12."), (1.0, b"5,EndO"), (1.5, b"fAPI")):
        clock.call_at(delay_s, lambda piece=piece: controller.sends[0](piece))  # type: ignore[misc]
    assert stage.angle().value == 12.5


@pytest.mark.parametrize("garbage", [b"\x00\xffrubbish,EndOfAPI", b",EndOfAPI", b"0x1,,EndOfAPI"])
def test_garbage_is_a_bad_reply_and_the_next_question_goes_over_a_new_connection(garbage: bytes) -> None:
    stage, controller = opened({"GroupPositionCurrentGet(Group1,double *)": [garbage, b"0,3.5,EndOfAPI"]})
    with pytest.raises(BadReply, match=r"rotation: to 'GroupPositionCurrentGet.Group1,double \*.'"):
        stage.angle()
    assert stage.angle().value == 3.5
    assert controller.requests[-1] == (3, "GroupPositionCurrentGet(Group1,double *)")


@pytest.mark.parametrize("values", [b"0,,EndOfAPI", b"0,1,2,EndOfAPI", b"0,nan,EndOfAPI", b"0,abc,EndOfAPI"])
def test_values_the_manual_does_not_allow_are_a_bad_reply(values: bytes) -> None:
    stage, _ = opened({"GroupPositionCurrentGet(Group1,double *)": values})
    with pytest.raises(BadReply, match="GroupPositionCurrentGet"):
        stage.angle()


def test_the_late_answer_of_a_move_that_timed_out_is_not_taken_for_the_next_one() -> None:
    clock = VirtualClock()
    stage, controller = opened(
        {
            "GroupMoveAbsolute(Group1,12.5)": SILENCE,
            "GroupMoveAbsolute(Group1,1)": b"-25,GroupMoveAbsolute(Group1,1),EndOfAPI",
            "ErrorStringGet(-25,char *)": b"0,Error -25: Following error,EndOfAPI",
            "GroupMoveAbort(Group1)": b"0,,EndOfAPI",
        },
        clock,
    )
    with pytest.raises(LinkTimeout, match="120 s"):
        stage.move_to(12.5)
    assert controller.requests[-2:] == [(2, "<closed>"), (1, "GroupMoveAbort(Group1)")]
    controller.sends[1](b"0,,EndOfAPI")
    with pytest.raises(InstrumentError, match="Following error"):
        stage.move_to(1.0)
    assert (3, "GroupMoveAbsolute(Group1,1)") in controller.requests
    assert controller.texts().count("GroupMoveAbsolute(Group1,12.5)") == 1


def test_a_move_aborted_by_anybody_is_motion_stopped() -> None:
    stage, _ = opened({"GroupMoveAbsolute(Group1,12.5)": b"-27,GroupMoveAbsolute(Group1,12.5),EndOfAPI"})
    with pytest.raises(MotionStopped) as raised:
        stage.move_to(12.5)
    assert raised.value.code == "-27"


@pytest.mark.parametrize("code", [-17, -35, -5, -113])
def test_error_codes_come_with_the_controllers_text(code: int) -> None:
    stage, _ = opened(
        {
            "GroupMoveAbsolute(Group1,12.5)": f"{code},GroupMoveAbsolute(Group1,12.5),EndOfAPI".encode(),
            f"ErrorStringGet({code},char *)": f"0,Error {code}: its own words,EndOfAPI".encode(),
        }
    )
    with pytest.raises(InstrumentError, match=r"GroupMoveAbsolute.Group1,12.5.") as raised:
        stage.move_to(12.5)
    assert (raised.value.code, raised.value.text) == (str(code), f"Error {code}: its own words")


@pytest.mark.parametrize("answer", [b"-4,ErrorStringGet,EndOfAPI", b"garbage,EndOfAPI", SILENCE])
def test_error_codes_have_a_text_even_when_the_controller_gives_none(answer: bytes) -> None:
    stage, _ = opened(
        {
            "GroupMoveAbsolute(Group1,12.5)": b"-25,GroupMoveAbsolute(Group1,12.5),EndOfAPI",
            "ErrorStringGet(-25,char *)": answer,
        }
    )
    with pytest.raises(InstrumentError) as raised:
        stage.move_to(12.5)
    assert (raised.value.code, raised.value.text) == ("-25", "following error")


def test_stop_aborts_and_nothing_moving_is_fine() -> None:
    stage, controller = opened({"GroupMoveAbort(Group1)": b"0,,EndOfAPI"})
    stage.stop()
    assert controller.requests == [(1, "GroupMoveAbort(Group1)"), (1, "GroupStatusGet(Group1,int *)")]
    stage, controller = opened()
    stage.stop()
    assert controller.texts()[:2] == ["GroupMoveAbort(Group1)", "GroupStatusGet(Group1,int *)"]


def test_stop_waits_until_the_controller_says_that_the_group_stands_still() -> None:
    moving, at_rest = b"0,44,EndOfAPI", b"0,10,EndOfAPI"
    script: Script = {
        "GroupMoveAbort(Group1)": b"0,,EndOfAPI",
        "GroupStatusGet(Group1,int *)": [moving, moving, at_rest],
    }
    stage, controller = opened(script)
    stage.stop()
    assert controller.texts().count("GroupStatusGet(Group1,int *)") == 3
    text = {"GroupStatusStringGet(44,char *)": b"0,Moving state,EndOfAPI"}
    stage, _ = opened(script | text | {"GroupStatusGet(Group1,int *)": moving})
    with pytest.raises(InstrumentError, match="not at rest after an abort, it is in state 44"):
        stage.stop()


def test_stop_kills_a_group_that_is_homing() -> None:
    stage, controller = opened(
        {
            "GroupStatusGet(Group1,int *)": [b"0,43,EndOfAPI", b"0,7,EndOfAPI"],
            "GroupKill(Group1)": b"0,,EndOfAPI",
        }
    )
    stage.stop()
    assert controller.texts()[-2:] == ["GroupKill(Group1)", "GroupStatusGet(Group1,int *)"]


def test_stop_tries_again_over_a_new_connection() -> None:
    stage, controller = opened({"GroupMoveAbort(Group1)": [SILENCE, b"0,,EndOfAPI"]})
    stage.stop()
    assert controller.requests == [
        (1, "GroupMoveAbort(Group1)"),
        (1, "<closed>"),
        (3, "GroupMoveAbort(Group1)"),
        (3, "GroupStatusGet(Group1,int *)"),
    ]


def test_a_stop_between_two_steps_of_homing_lets_the_next_one_not_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    stage, controller = opened({"GroupStatusGet(Group1,int *)": b"0,42,EndOfAPI"})
    ask_status = stage._wire.status

    def ask_status_and_be_stopped() -> int:
        monkeypatch.setattr(stage._wire, "status", ask_status)
        status = ask_status()
        stage.stop()
        return status

    monkeypatch.setattr(stage._wire, "status", ask_status_and_be_stopped)
    with pytest.raises(MotionStopped):
        stage.home()
    assert "GroupHomeSearch(Group1)" not in controller.texts()


def test_a_signal_handler_can_stop_in_the_middle_of_a_query_of_its_own_thread() -> None:
    clock = VirtualClock()
    stage, controller = opened({"GroupPositionCurrentGet(Group1,double *)": SILENCE}, clock)
    clock.call_at(0.5, stage.stop)
    with pytest.raises(LinkError):
        stage.angle()
    assert (3, "GroupMoveAbort(Group1)") in controller.requests


def test_stop_that_fails_says_so() -> None:
    stage, _ = opened({"GroupMoveAbort(Group1)": SILENCE})
    with pytest.raises(LinkError, match="nothing came"):
        stage.stop()


def test_a_socket_closed_by_the_administrator_is_replaced() -> None:
    stage, controller = opened(
        {
            "GroupPositionCurrentGet(Group1,double *)": [b"-108,,EndOfAPI", b"0,1,EndOfAPI"],
            "ErrorStringGet(-108,char *)": b"0,Error -108: closed,EndOfAPI",
        }
    )
    with pytest.raises(InstrumentError, match="-108"):
        stage.angle()
    assert stage.angle().value == 1.0
    assert controller.requests[-1][0] == 3


def test_firmware_that_is_no_xps_closes_what_was_opened() -> None:
    controller = Scripted({"FirmwareVersionGet(char *)": b"0,A3200 6.03,EndOfAPI"})
    stage = stage_on(controller)
    with pytest.raises(InstrumentError, match="no XPS answers"):
        stage.open()
    assert controller.texts().count("<closed>") == 2


@given(code=st.integers(-9999, 9999), text=st.text(st.characters(max_codepoint=255)))
def test_a_reply_parses_into_what_it_was_made_of(code: int, text: str) -> None:
    assert parse_reply(f"{code},{text}".encode("latin-1") + END) == Reply(code, text)


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=6))
def test_numbers_survive_the_wire(values: list[float]) -> None:
    reply = parse_reply(f"0,{','.join(map(repr, values))}".encode() + END)
    assert reply.numbers(len(values)) == tuple(values)
    with pytest.raises(ValueError, match="finite"):
        reply.numbers(len(values) + 1)


@given(data=st.binary(max_size=60) | st.binary(max_size=60).map(lambda data: data + END))
def test_no_bytes_crash_the_parser(data: bytes) -> None:
    try:
        reply = parse_reply(data)
    except ValueError:
        return
    assert data.endswith(END)
    assert reply.code == int(data.partition(b",")[0])
