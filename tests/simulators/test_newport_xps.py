"""The simulated XPS on its wire: bytes, states, sockets."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.newport_xps import SimulatedXps, XpsSimulatorSettings
from simulators.newport_xps.controller_functions import CONTROLLER_FUNCTIONS
from simulators.newport_xps.grammar import Request, RequestReader, format_number, parse_request
from simulators.newport_xps.motion_functions import GROUP_FUNCTIONS, POSITIONER_FUNCTIONS

STATUS = "GroupStatusGet(Group1,int *)"
POSITION = "GroupPositionCurrentGet(Group1,double *)"


class Socket:
    """One client; every `send` of the instrument is one item."""

    def __init__(self, controller: SimulatedXps) -> None:
        self.sent: list[bytes] = []
        self.connection: Any = controller.connect(self.sent.append)

    def send(self, text: str) -> list[str]:
        """What comes back at once."""
        self.sent.clear()
        self.connection.receive(text.encode("latin-1"))
        return self.replies()

    def replies(self) -> list[str]:
        return [data.decode("latin-1") for data in self.sent]


class Bench:
    def __init__(self, groups: dict[str, dict[str, MotionAxis]] | None = None, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis(3.0)
        self.controller = SimulatedXps(
            self.clock, groups or {"Group1": {"Pos": self.axis}}, XpsSimulatorSettings(**settings)
        )
        self.a = Socket(self.controller)
        self.b = Socket(self.controller)

    def call(self, text: str, timeout_s: float = 100.0) -> str:
        """Send over socket A and wait for the one reply."""
        self.a.send(text)
        assert self.clock.wait_for(lambda: bool(self.a.sent), timeout_s)
        (reply,) = self.a.replies()
        return reply

    def home(self, group: str = "Group1") -> None:
        assert self.call(f"GroupInitialize({group})") == "0,,EndOfAPI"
        assert self.call(f"GroupHomeSearch({group})") == "0,,EndOfAPI"

    def status(self) -> str:
        (reply,) = self.b.send(STATUS)
        return reply


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def homed(bench: Bench) -> Bench:
    bench.home()
    return bench


# the wire


def test_the_gains_of_a_positioner_are_kept(bench: Bench) -> None:
    kind = "PositionerCorrectorPIDFFVelocity"
    assert bench.call("PositionerCorrectorTypeGet(Group1.Pos,char *)") == f"0,{kind},EndOfAPI"
    outputs = ",".join(["bool *", *["double *"] * 11])
    gains = "0,1.5,2,3,4,5,6,7,8,9,10,11"
    assert bench.call(f"{kind}Set(Group1.Pos,{gains})") == "0,,EndOfAPI"
    assert bench.call(f"{kind}Get(Group1.Pos,{outputs})") == f"0,{gains},EndOfAPI"
    wrong = f"{kind}Set(Group1.Pos,2{gains[1:]})"
    assert bench.call(wrong) == f"-12,{wrong},EndOfAPI"
    wrong = f"{kind}Get(Group1.Pos,{outputs.replace('bool', 'int')})"
    assert bench.call(wrong) == f"-12,{wrong},EndOfAPI"


def test_the_acceleration_of_a_move_is_told(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1.Pos,90)")
    homed.clock.sleep_s(0.1)
    told = [
        reply
        for text in ("Group1", "Group1.Pos")
        for reply in homed.b.send(f"GroupAccelerationSetpointGet({text},double *)")
    ]
    assert told == ["0,80,EndOfAPI"] * 2


def test_the_exchange_of_a_move_as_in_the_manual(homed: Bench) -> None:
    a, b = homed.a, homed.b
    assert b.send(STATUS) == ["0,11,EndOfAPI"]
    assert a.send("GroupMoveAbsolute(Group1.Pos,5.0)") == []
    assert b.send(STATUS) == ["0,44,EndOfAPI"]
    homed.clock.sleep_s(0.3)
    (position,) = b.send(POSITION)
    assert re.fullmatch(r"0,[1-4]\.\d{1,4},EndOfAPI", position)
    assert homed.clock.wait_for(lambda: bool(a.sent), 5.0)
    assert a.replies() == ["0,,EndOfAPI"]
    assert b.send(STATUS) == ["0,12,EndOfAPI"]
    assert b.send(POSITION) == ["0,5,EndOfAPI"]


@pytest.mark.parametrize(
    "spelling",
    [
        "GroupStatusGet(Group1,int *)",
        "GroupStatusGet (Group1,int *)",
        "GroupStatusGet(Group1, int *)",
        "GroupStatusGet(Group1,int*)",
        "GroupStatusGet( Group1 , int  * )",
        "\r\n GroupStatusGet(Group1,int *)",
        "GroupStatusGet(Group1.Pos,int *)",
    ],
)
def test_all_spacings_of_shipped_clients_are_understood(bench: Bench, spelling: str) -> None:
    assert bench.a.send(spelling) == ["0,0,EndOfAPI"]


@pytest.mark.parametrize(
    ("request_text", "reply"),
    [
        ("FirmwareVersionGet(char *)", "0,XPS-C8 Firmware V2.6.2,EndOfAPI"),
        ("InstallerVersionGet(char *)", "0,XPS-C8 Installer V2.6.2,EndOfAPI"),
        ("ElapsedTimeGet(double *)", "0,0,EndOfAPI"),
        ("Login(Administrator,Administrator)", "0,,EndOfAPI"),
        ("Login(Administrator,guess)", "-106,Login(Administrator,guess),EndOfAPI"),
        ("ErrorStringGet(-22, char *)", "0,Error -22: Not allowed action,EndOfAPI"),
        ("ErrorStringGet(-999,char *)", "-17,ErrorStringGet(-999,char *),EndOfAPI"),
        ("GroupStatusStringGet(12, char*)", "0,Ready state from motion,EndOfAPI"),
        ("PositionerErrorGet(Group1.Pos,int *)", "0,0,EndOfAPI"),
        ("PositionerErrorStringGet(0,char *)", "0,,EndOfAPI"),
        ("PositionerHardwareStatusStringGet(768,char *)", "0,Minus end of run - Plus end of run,EndOfAPI"),
        ("PositionerMaximumVelocityAndAccelerationGet(Group1.Pos,double *,double *)", "0,20,80,EndOfAPI"),
        ("PositionerUserTravelLimitsGet(Group1.Pos,double *,double *)", "0,-170,170,EndOfAPI"),
        ("Nonsense()", "-4,Nonsense(),EndOfAPI"),
        (")", "-4,),EndOfAPI"),
        ("GroupStatusGet()", "-9,GroupStatusGet(),EndOfAPI"),
        ("GroupStatusGet(Group1)", "-9,GroupStatusGet(Group1),EndOfAPI"),
        ("KillAll(Group1)", "-9,KillAll(Group1),EndOfAPI"),
        ("GroupStatusGet(Group2,int *)", "-19,GroupStatusGet(Group2,int *),EndOfAPI"),
        ("PositionerErrorGet(Group1.Foo,int *)", "-18,PositionerErrorGet(Group1.Foo,int *),EndOfAPI"),
        ("GroupMoveAbort(Group1.Foo)", "-18,GroupMoveAbort(Group1.Foo),EndOfAPI"),
        ("GroupStatusGet(Group1,double *)", "-15,GroupStatusGet(Group1,double *),EndOfAPI"),
        ("GroupMoveAbsolute(Group1,far)", "-14,GroupMoveAbsolute(Group1,far),EndOfAPI"),
        ("GroupMoveAbsolute(Group1,1e999)", "-14,GroupMoveAbsolute(Group1,1e999),EndOfAPI"),
        ("ErrorStringGet(1.5,char *)", "-15,ErrorStringGet(1.5,char *),EndOfAPI"),
        ("GroupMoveAbsolute(Group1,5)", "-22,GroupMoveAbsolute(Group1,5),EndOfAPI"),
        ("GroupMoveAbort(Group1)", "-22,GroupMoveAbort(Group1),EndOfAPI"),
        ("GroupHomeSearch(Group1)", "-22,GroupHomeSearch(Group1),EndOfAPI"),
    ],
)
def test_replies_at_power_on(bench: Bench, request_text: str, reply: str) -> None:
    assert bench.a.send(request_text) == [reply]


def test_the_error_list_splits_as_clients_split_it(bench: Bench) -> None:
    reply = bench.call("ErrorListGet(char *)")
    items = reply.removeprefix("0,").removesuffix(";,EndOfAPI").split(";")
    codes = {int(item.split(":", 1)[0].removeprefix("Error ")) for item in items}
    assert {0, -1, -17, -22, -27, -108} <= codes


def test_a_request_may_come_in_pieces_and_two_in_one_piece(bench: Bench) -> None:
    assert bench.a.send("GroupStatus") == []
    assert bench.a.send("Get(Group1,") == []
    assert bench.a.send("int *)GroupStatusGet(Group1,int *)") == ["0,0,EndOfAPI", "0,0,EndOfAPI"]


def test_an_endless_request_is_refused_once(bench: Bench) -> None:
    (reply,) = bench.a.send("x" * 70_000)
    assert reply.startswith("-3,xxx")
    assert bench.a.send(STATUS) == ["0,0,EndOfAPI"]


def test_a_busy_socket_refuses_while_others_answer(homed: Bench) -> None:
    assert homed.a.send("GroupMoveAbsolute(Group1,50)") == []
    assert homed.a.send(STATUS) == [f"-1,{STATUS},EndOfAPI"]
    assert homed.status() == "0,44,EndOfAPI"
    homed.a.sent.clear()
    homed.clock.sleep_s(10.0)
    assert homed.a.replies() == ["0,,EndOfAPI"]


def test_a_motion_outlives_the_socket_that_started_it(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,50)")
    homed.a.connection.close()
    homed.clock.sleep_s(10.0)
    assert homed.a.sent == []
    assert homed.status() == "0,12,EndOfAPI"
    assert homed.axis.position(homed.clock.now_s()) == 50.0


def test_a_hundred_sockets_and_not_one_more(bench: Bench) -> None:
    sockets = [Socket(bench.controller) for _ in range(98)]
    assert all(not socket.connection.hung_up for socket in sockets)
    assert all(socket.send(STATUS) == ["0,0,EndOfAPI"] for socket in sockets)
    assert Socket(bench.controller).connection.hung_up
    sockets[0].connection.close()
    assert not Socket(bench.controller).connection.hung_up


def test_closing_all_other_sockets_tells_them(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,50)")
    idle = Socket(homed.controller)
    assert homed.b.send("CloseAllOtherSockets()") == ["0,,EndOfAPI"]
    assert homed.a.replies() == ["-108,GroupMoveAbsolute(Group1,50),EndOfAPI"]
    assert idle.replies() == ["-108,,EndOfAPI"]
    assert homed.a.connection.hung_up
    assert not homed.b.connection.hung_up
    assert homed.a.send(STATUS) == []
    homed.clock.sleep_s(10.0)
    assert homed.status() == "0,12,EndOfAPI"


def test_a_reboot_ends_every_connection_and_forgets_the_reference(homed: Bench) -> None:
    assert homed.a.send("Reboot()") == []
    assert homed.a.connection.hung_up
    assert homed.b.connection.hung_up
    after = Socket(homed.controller)
    assert after.send(STATUS) == ["0,0,EndOfAPI"]
    assert after.send("ElapsedTimeGet(double *)") == ["0,0,EndOfAPI"]


# states


def test_from_power_on_to_ready(bench: Bench) -> None:
    bench.a.send("GroupInitialize(Group1)")
    assert bench.status() == "0,41,EndOfAPI"
    bench.clock.sleep_s(1.0)
    assert bench.a.replies() == ["0,,EndOfAPI"]
    assert bench.status() == "0,42,EndOfAPI"
    assert bench.b.send(POSITION) == ["0,0,EndOfAPI"]
    bench.a.send("GroupHomeSearch(Group1)")
    assert bench.status() == "0,43,EndOfAPI"
    assert bench.b.send("GroupMoveAbort(Group1)") == ["-22,GroupMoveAbort(Group1),EndOfAPI"]
    bench.clock.sleep_s(5.0)
    assert bench.a.replies() == ["0,,EndOfAPI"]
    assert bench.status() == "0,11,EndOfAPI"
    assert bench.axis.position(bench.clock.now_s()) == 0.0
    assert bench.call("GroupInitialize(Group1)") == "-22,GroupInitialize(Group1),EndOfAPI"
    assert bench.call("GroupHomeSearch(Group1)") == "-22,GroupHomeSearch(Group1),EndOfAPI"


def test_initialising_with_calibration_shows_its_own_state(bench: Bench) -> None:
    bench.a.send("GroupInitializeWithEncoderCalibration(Group1)")
    assert bench.status() == "0,49,EndOfAPI"
    bench.clock.sleep_s(1.0)
    assert bench.status() == "0,42,EndOfAPI"


def test_an_abort_ends_the_move_with_its_own_code_and_leaves_the_group_ready(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,100)")
    homed.clock.sleep_s(2.0)
    abort = Socket(homed.controller)
    abort.send("GroupMoveAbort(Group1)")
    homed.clock.sleep_s(1.0)
    assert homed.a.replies() == ["-27,GroupMoveAbsolute(Group1,100),EndOfAPI"]
    assert abort.replies() == ["0,,EndOfAPI"]
    assert homed.status() == "0,10,EndOfAPI"
    ramp_deg = braking_deg = 20.0**2 / (2 * 80.0)
    cruise_deg = 20.0 * (2.0 - 20.0 / 80.0)
    stands_deg = ramp_deg + cruise_deg + braking_deg
    assert homed.axis.position(homed.clock.now_s()) == pytest.approx(stands_deg)
    assert abort.send("GroupMoveAbort(Group1)") == ["-22,GroupMoveAbort(Group1),EndOfAPI"]
    assert homed.call("GroupMoveAbsolute(Group1,0)") == "0,,EndOfAPI"


def test_two_aborts_at_once_both_succeed(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,100)")
    homed.clock.sleep_s(2.0)
    first, second = Socket(homed.controller), Socket(homed.controller)
    first.send("GroupMoveAbort(Group1)")
    second.send("GroupMoveAbort(Group1)")
    homed.clock.sleep_s(1.0)
    assert first.replies() == second.replies() == ["0,,EndOfAPI"]


@pytest.mark.parametrize("kill", ["GroupKill(Group1)", "KillAll()"])
def test_a_kill_brakes_and_the_reference_is_lost(homed: Bench, kill: str) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,100)")
    homed.clock.sleep_s(2.0)
    assert homed.b.send(kill) == []
    assert Socket(homed.controller).send(STATUS) == ["0,40,EndOfAPI"]
    homed.clock.sleep_s(1.0)
    assert homed.a.replies() == ["-27,GroupMoveAbsolute(Group1,100),EndOfAPI"]
    assert homed.b.replies() == ["0,,EndOfAPI"]
    assert homed.status() == "0,7,EndOfAPI"
    assert homed.axis.velocity(homed.clock.now_s()) == 0.0
    homed.home()


def test_a_kill_ends_a_home_search(bench: Bench) -> None:
    bench.axis.place(0.0, 100.0)
    bench.call("GroupInitialize(Group1)")
    bench.a.send("GroupHomeSearch(Group1)")
    bench.clock.sleep_s(1.0)
    bench.b.send("GroupKill(Group1)")
    bench.clock.sleep_s(30.0)
    assert bench.a.replies() == ["-27,GroupHomeSearch(Group1),EndOfAPI"]
    assert bench.axis.position(bench.clock.now_s()) > 80.0


def test_disable_and_enable(homed: Bench) -> None:
    assert homed.call("GroupMotionEnable(Group1)").startswith("-22,")
    assert homed.call("GroupMotionDisable(Group1)") == "0,,EndOfAPI"
    assert homed.status() == "0,20,EndOfAPI"
    assert homed.call("GroupMoveAbsolute(Group1,1)").startswith("-22,")
    assert homed.call("GroupMotionEnable(Group1)") == "0,,EndOfAPI"
    assert homed.status() == "0,13,EndOfAPI"


def test_jogging_turns_until_told_otherwise_and_ends_only_at_rest(homed: Bench) -> None:
    assert homed.call("GroupJogParametersSet(Group1,5,40)").startswith("-22,")
    assert homed.call("GroupJogModeEnable(Group1)") == "0,,EndOfAPI"
    assert homed.status() == "0,47,EndOfAPI"
    assert homed.call("GroupJogParametersSet(Group1,21,40)").startswith("-42,")
    assert homed.call("GroupJogParametersSet(Group1,5,40)") == "0,,EndOfAPI"
    homed.clock.sleep_s(4.0)
    assert homed.call("GroupVelocityCurrentGet(Group1,double *)") == "0,5,EndOfAPI"
    assert homed.call("GroupJogParametersGet(Group1,double *,double *)") == "0,5,40,EndOfAPI"
    assert homed.call("GroupJogModeDisable(Group1)").startswith("-22,")
    assert homed.call("GroupJogParametersSet(Group1,0,40)") == "0,,EndOfAPI"
    homed.clock.sleep_s(1.0)
    assert homed.call("GroupJogModeDisable(Group1)") == "0,,EndOfAPI"
    assert homed.status() == "0,15,EndOfAPI"
    assert homed.axis.position(homed.clock.now_s()) == pytest.approx(20.0)


@pytest.mark.parametrize("velocity_deg_s", [15.0, -15.0])
def test_a_jog_stops_at_the_travel_limit(homed: Bench, velocity_deg_s: float) -> None:
    homed.call("GroupJogModeEnable(Group1)")
    homed.call(f"GroupJogParametersSet(Group1,{velocity_deg_s},40)")
    homed.clock.sleep_s(60.0)
    assert homed.axis.velocity(homed.clock.now_s()) == 0.0
    limit_deg = 170.0 if velocity_deg_s > 0 else -170.0
    assert homed.axis.position(homed.clock.now_s()) == pytest.approx(limit_deg, abs=1e-6)


def test_a_following_error_disables_and_its_word_is_cleared_by_one_of_two_readings(homed: Bench) -> None:
    homed.a.send("GroupMoveAbsolute(Group1,100)")
    homed.clock.sleep_s(2.0)
    homed.controller.fail_following("Group1")
    assert homed.a.replies() == ["-25,GroupMoveAbsolute(Group1,100),EndOfAPI"]
    # No state of rest while it still turns: 20 deg/s at 80 deg/s2.
    turning_s = 0.0
    while homed.axis.velocity(homed.clock.now_s()):
        assert homed.status() == "0,40,EndOfAPI"
        homed.clock.sleep_s(0.01)
        turning_s += 0.01
    assert turning_s > 0.1
    assert homed.status() == "0,22,EndOfAPI"
    for function in ("Read", "Read", "Get"):
        assert homed.call(f"PositionerError{function}(Group1.Pos,int *)") == "0,2,EndOfAPI"
    assert homed.call("PositionerErrorGet(Group1.Pos,int *)") == "0,0,EndOfAPI"
    assert homed.call("GroupMotionEnable(Group1)") == "0,,EndOfAPI"


def test_referencing_sets_a_position_without_motion(bench: Bench) -> None:
    bench.call("GroupInitialize(Group1)")
    assert bench.call("GroupReferencingStart(Group1)") == "0,,EndOfAPI"
    assert bench.status() == "0,64,EndOfAPI"
    action = "GroupReferencingActionExecute(Group1.Pos,SetPosition,None,12.5)"
    assert bench.call(action) == "0,,EndOfAPI"
    assert bench.call("GroupReferencingStop(Group1)") == "0,,EndOfAPI"
    assert bench.status() == "0,11,EndOfAPI"
    assert bench.call(POSITION) == "0,12.5,EndOfAPI"
    assert bench.call("GroupMoveAbsolute(Group1,13.5)") == "0,,EndOfAPI"
    assert bench.axis.position(bench.clock.now_s()) == 4.0


def test_home_search_and_relative_move(bench: Bench) -> None:
    bench.call("GroupInitialize(Group1)")
    assert bench.call("GroupHomeSearchAndRelativeMove(Group1,5)") == "0,,EndOfAPI"
    assert bench.call(POSITION) == "0,5,EndOfAPI"
    assert bench.status() == "0,12,EndOfAPI"


# motion


def test_relative_moves_add_up_and_a_move_to_the_same_place_ends_at_once(homed: Bench) -> None:
    assert homed.call("GroupMoveAbsolute(Group1,5)") == "0,,EndOfAPI"
    assert homed.call("GroupMoveRelative(Group1,-2.25)") == "0,,EndOfAPI"
    assert homed.call("GroupPositionTargetGet(Group1,double *)") == "0,2.75,EndOfAPI"
    assert homed.a.send("GroupMoveAbsolute(Group1,2.75)") == ["0,,EndOfAPI"]


def test_speed_and_acceleration_shape_the_move(homed: Bench) -> None:
    assert homed.call("PositionerSGammaParametersSet(Group1.Pos,10,40,0.01,0.03)") == "0,,EndOfAPI"
    get = "PositionerSGammaParametersGet(Group1.Pos,double *,double *,double *,double *)"
    assert homed.call(get) == "0,10,40,0.01,0.03,EndOfAPI"
    started_s = homed.clock.now_s()
    homed.call("GroupMoveAbsolute(Group1,100)")
    assert homed.clock.now_s() - started_s == pytest.approx(100 / 10 + 10 / 40 + 0.05)


@pytest.mark.parametrize("parameters", ["20.1,80,0.02,0.02", "20,81,0.02,0.02", "0,80,0.02,0.02", "20,80,0.03,0.02"])
def test_sgamma_parameters_beyond_the_maxima(homed: Bench, parameters: str) -> None:
    assert homed.call(f"PositionerSGammaParametersSet(Group1.Pos,{parameters})").startswith("-17,")


@pytest.mark.parametrize("code", [-17, -35])
def test_targets_outside_the_user_travel_limits(code: int) -> None:
    bench = Bench(outside_limits_code=code)
    bench.home()
    assert bench.call("PositionerUserTravelLimitsSet(Group1.Pos,-10,20)") == "0,,EndOfAPI"
    assert bench.call("GroupMoveAbsolute(Group1,20.1)") == f"{code},GroupMoveAbsolute(Group1,20.1),EndOfAPI"
    assert bench.call("GroupMoveRelative(Group1,-10.1)").startswith(f"{code},")
    assert bench.status() == "0,11,EndOfAPI"
    assert bench.call("GroupMoveAbsolute(Group1,20)") == "0,,EndOfAPI"
    assert bench.call("PositionerUserTravelLimitsSet(Group1.Pos,-171,20)").startswith("-17,")
    assert bench.call("PositionerUserTravelLimitsSet(Group1.Pos,20,-20)").startswith("-17,")


def test_the_encoder_has_steps_and_the_set_point_has_none(homed: Bench) -> None:
    assert homed.call("GroupMoveAbsolute(Group1,1.23456)") == "0,,EndOfAPI"
    assert homed.call(POSITION) == "0,1.2346,EndOfAPI"
    assert homed.call("GroupPositionSetpointGet(Group1,double *)") == "0,1.23456,EndOfAPI"
    assert homed.call("GroupCurrentFollowingErrorGet(Group1,double *)") == "0,-4e-05,EndOfAPI"


def test_a_group_of_two_takes_two_of_everything_and_its_parts_one() -> None:
    x, y = MotionAxis(), MotionAxis()
    bench = Bench({"XY": {"X": x, "Y": y}})
    bench.home("XY")
    assert bench.call("GroupMoveAbsolute(XY,1.0,2.0)") == "0,,EndOfAPI"
    assert bench.call("GroupPositionCurrentGet(XY,double *,double *)") == "0,1,2,EndOfAPI"
    assert bench.call("GroupMoveAbsolute(XY,1.0)").startswith("-9,")
    assert bench.call("GroupMoveAbsolute(XY.Y,7)") == "0,,EndOfAPI"
    assert (x.position(bench.clock.now_s()), y.position(bench.clock.now_s())) == (1.0, 7.0)
    assert bench.call("GroupPositionCurrentGet(XY.Y,double *)") == "0,7,EndOfAPI"


def test_hardware_status_and_motion_done(homed: Bench) -> None:
    assert homed.call("PositionerHardwareStatusGet(Group1.Pos,int *)") == "0,0,EndOfAPI"
    homed.call("GroupMoveAbsolute(Group1,3)")
    assert homed.call("PositionerHardwareStatusGet(Group1.Pos,int *)") == "0,4,EndOfAPI"
    homed.axis.place(homed.clock.now_s(), -171.0)
    assert homed.call("PositionerHardwareStatusGet(Group1.Pos,int *)") == "0,256,EndOfAPI"
    assert homed.call("PositionerMotionDoneSet(Group1.Pos,0.01,0.2,0.1,0.02,2)") == "0,,EndOfAPI"
    get = f"PositionerMotionDoneGet(Group1.Pos,{','.join(['double *'] * 5)})"
    assert homed.call(get) == "0,0.01,0.2,0.1,0.02,2,EndOfAPI"
    assert homed.call("PositionerMotionDoneSet(Group1.Pos,0.01,0.2,0.1,0.02,0)").startswith("-17,")


# any input

NAMES = st.sampled_from([*CONTROLLER_FUNCTIONS, *GROUP_FUNCTIONS, *POSITIONER_FUNCTIONS, "Nonsense"])
ARGUMENTS = st.lists(
    st.sampled_from(
        ["Group1", "Group1.Pos", "XY", "int *", "double *", "char *", "5", "-3.5", "0", "1e3", "", "SetPosition"]
    ),
    max_size=5,
)
CALLS = st.builds(lambda name, arguments: f"{name}({','.join(arguments)})", NAMES, ARGUMENTS)


@settings(max_examples=60)
@given(calls=st.lists(st.tuples(CALLS, st.sampled_from("ab"), st.sampled_from([0.0, 0.3, 50.0])), max_size=25))
def test_every_call_in_every_state_gets_exactly_one_reply(calls: list[tuple[str, str, float]]) -> None:
    bench = Bench({"Group1": {"Pos": MotionAxis(3.0)}})
    bench.home()
    bench.a.sent.clear()
    asked = {"a": 0, "b": 0}
    sockets = {"a": bench.a, "b": bench.b}
    for text, socket, wait_s in calls:
        if sockets[socket].connection.hung_up or text.startswith(("Reboot", "CloseAll")):
            continue
        asked[socket] += 1
        sockets[socket].connection.receive(text.encode())
        bench.clock.sleep_s(wait_s)
    bench.clock.sleep_s(200.0)
    for socket, count in asked.items():
        replies = sockets[socket].sent
        assert len(replies) == count
        assert all(re.fullmatch(rb"-?\d+,[^\x00]*,EndOfAPI", reply) for reply in replies)


@settings(max_examples=200)
@given(data=st.binary(max_size=80) | st.text(st.sampled_from("Ga(),* \r\nint"), max_size=40).map(str.encode))
def test_no_bytes_crash_it_and_each_parenthesis_gets_one_reply(data: bytes) -> None:
    bench = Bench()
    bench.a.connection.receive(data)
    assert len(bench.a.sent) == data.count(b")")


@given(data=st.text(st.characters(max_codepoint=255), max_size=60), cut=st.integers(0, 60))
def test_where_the_stream_is_cut_does_not_matter(data: str, cut: int) -> None:
    encoded = data.encode("latin-1")
    whole, pieces = RequestReader(), RequestReader()
    in_pieces = [*pieces.feed(encoded[:cut]), *pieces.feed(encoded[cut:])]
    assert in_pieces == list(whole.feed(encoded))


WORDS = st.from_regex(r"[A-Za-z0-9_.*-]{1,12}", fullmatch=True)


@given(name=st.from_regex(r"[A-Za-z]\w{0,20}", fullmatch=True), arguments=st.lists(WORDS, max_size=5))
def test_a_request_parses_into_what_it_was_made_of(name: str, arguments: list[str]) -> None:
    assert parse_request(f"{name} ({', '.join(arguments)})") == Request(name, tuple(arguments))


@given(value=st.floats(-1e6, 1e6))
def test_numbers_are_written_with_twelve_digits(value: float) -> None:
    text = format_number(value)
    assert float(text) == pytest.approx(value, rel=1e-11)
    assert text != "-0"


@pytest.mark.parametrize(
    "call",
    [
        "GroupSpinParametersSet(Group1,10,80)",
        "GroupSpinModeStop(Group1,80)",
        "GroupSpinCurrentGet(Group1,double *,double *)",
    ],
)
def test_functions_of_a_spindle_are_known_and_refused_to_another_group(call: str) -> None:
    assert Bench().call(call) == f"-8,{call},EndOfAPI"
