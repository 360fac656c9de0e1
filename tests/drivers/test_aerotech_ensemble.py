"""The Ensemble driver: against its manual's bytes, and against the simulated controller."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.connect import connector
from drivers.transport import InProcessTransport
from rigctl.core.clock import RealClock
from rigctl.core.errors import (
    BadReply,
    InstrumentError,
    LimitError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    RigError,
    WrongInstrument,
)
from rigctl.core.interfaces import Channel, LinearStage, PacedRecorder
from simulators.aerotech_ensemble import EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.aerotech_ensemble.status import AxisFault
from simulators.clock import ScaledClock, VirtualClock
from simulators.faults.mishaps import WrongUnit
from simulators.motion import MotionAxis
from simulators.serve import Server
from simulators.wiring import TriggerLine
from tests.drivers.ensemble_bench import (
    ASCII,
    BY_ASCII,
    GREETING,
    PATIENCE_S,
    UNIT,
    Bench,
    expected,
    in_thread,
    stage,
    talking,
    when_sent,
)

# the manual's bytes


@pytest.mark.parametrize("eos", ["\n", ""])
def test_homing_and_a_move_are_the_manuals_exchange(eos: str) -> None:
    moving, conversation = talking(
        ("DATAACQ X OFF", "%" + eos),
        ("AXISSTATUS(X)", "%0\n"),
        ("OSCILLATE X, 0.001, 1, 1, 1", "#" + eos),
        ("AXISSTATUS(X)", "%0\n"),
        ("ACKNOWLEDGEALL", "%" + eos),
        ("ENABLE X", "%" + eos),
        ("WAIT MODE NOWAIT", "%" + eos),
        ("AXISSTATUS(X)", "%2097157\n"),
        ("GETPARM(@0, 140)", "%Y\n"),
        ("GETPARM(@1, 140)", '%"X"\n'),
        ("IGLOBAL(32) = 1", "%" + eos),
        ("IGLOBAL(33) = 1", "%" + eos),
        ('PROGRAM RUN 5, "HomeAsync.bcx"', "%" + eos),
        ("AXISSTATUS(X)", "%2113545\n"),
        ("AXISSTATUS(X)", "%2097159\n"),
        ("PLANESTATUS(0)", "%0\n"),
        ("PFBK(X)", "%0.000000\n"),
        ("PFBKPROG(X)", "%0.000000\n"),
        ("AXISSTATUS(X)", "%-2145386489\n"),
        ("PLANESTATUS(0)", "%0\n"),
        *UNIT,
        ("WAIT MODE NOWAIT", "%" + eos),
        ("RAMP MODE RATE", "%" + eos),
        ("RAMP RATE X 100", "%" + eos),
        ("MOVEABS X 5 XF20", "%" + eos),
        ("AXISSTATUS(X)", "%2097179\n"),
        ("AXISSTATUS(X)", "%2097155\n"),
        ("PLANESTATUS(0)", "%1\n"),
        ("AXISSTATUS(X)", "%2097159\n"),
        ("PLANESTATUS(0)", "%0\n"),
        ("PFBKPROG(X)", "%4.999875\n"),
        program="",
    )
    moving.home()
    moving.move_to(5.0)
    assert not conversation.left


def test_a_line_feed_that_comes_late_belongs_to_the_reply_before() -> None:
    asked, _ = talking(("PFBKPROG(X)", "\n%1.25\n"), ("DATAACQ X OFF", "\r\n!"), program="")
    assert asked.position().value == 1.25
    with pytest.raises(InstrumentError, match="does not understand"):
        asked.arm(1, 0.01)


def test_a_capture_is_the_manuals_exchange() -> None:
    recording, conversation = talking(
        ("DATAACQ X OFF", "%\n"),
        ("AXISSTATUS(X)", "%0\n"),
        ("OSCILLATE X, 0.001, 1, 1, 1", "!\n"),
        ("OSCILLATE X, 0.001, 1, 1", "#\n"),
        ("DATAACQ X INPUT 1", "%\n"),
        ("DATAACQ X TRIGGER 1", "%\n"),
        ("DATAACQ X ON 3", "%\n"),
        ("IGLOBAL(51) = -2147483648", "%\n"),
        ("DATAACQ X READ 50, 2", "%\n"),
        ("IGLOBAL(50)", "%-12501\n"),
        ("IGLOBAL(51)", "%25000\n"),
        ("IGLOBAL(50) = -2147483648", "%\n"),
        ("DATAACQ X READ 50, 1", "%\n"),
        ("IGLOBAL(50)", "%37500\n"),
        *UNIT,
        capture_register_first=50,
        capture_registers=2,
        capture_read="continues",
        program="",
    )
    recording.arm(3, 0.01)
    np.testing.assert_array_equal(recording.collect(), [[-1.2501], [2.5], [3.75]])
    assert not conversation.left


def test_a_fault_reply_is_raised_with_the_faults_of_the_axis() -> None:
    refused, _ = talking(
        ("DATAACQ X OFF", "!\n"),
        ("AXISSTATUS(X)", "%0\n"),
        ("ACKNOWLEDGEALL", "%\n"),
        ("ENABLE X", "#\n"),
        ("AXISFAULT(X)", "%2064\n"),
        program="",
    )
    with pytest.raises(InstrumentError, match=r"'ENABLE X': it was refused .*positive soft limit") as raised:
        refused.home()
    assert (raised.value.code, raised.value.text) == ("2064", "positive soft limit, emergency stop")
    assert raised.value.instrument == "stage"


@pytest.mark.parametrize(
    ("reply", "error", "text"),
    [
        ("!\n", InstrumentError, "did not understand 'PFBKPROG"),
        ("$\n", InstrumentError, r"timed out on 'PFBKPROG\(X\)' \(answer \$\)"),
        ("%abc\n", BadReply, "no number"),
        ("%nan\n", BadReply, "no number"),
        ("%\n", BadReply, "no number"),
        ("?1.0\n", BadReply, "instead of one of"),
        ("\xff\xfe\n", BadReply, "instead of one of"),
        ("%1.0", LinkTimeout, "only b'1.0' came"),
        ("", LinkTimeout, "nothing came"),
    ],
)
def test_a_reply_the_manual_does_not_allow_is_named(reply: str, error: type[RigError], text: str) -> None:
    asked, _ = talking(("PFBKPROG(X)", reply))
    with pytest.raises(error, match=text):
        asked.position()


def test_the_controllers_own_status_character_is_the_code() -> None:
    asked, _ = talking(("VERSION", "!"))
    with pytest.raises(InstrumentError) as raised:
        asked.identify()
    assert raised.value.code == "!"


@given(st.binary(max_size=30))
def test_whatever_answers_only_typed_errors_come_out(noise: bytes) -> None:
    asked, _ = talking(("PFBKPROG(X)", noise.decode("latin-1")), ("AXISFAULT(X)", "%0\n"))
    with suppress(RigError):
        assert math.isfinite(asked.position().value)


# who answers


@pytest.mark.parametrize(
    ("greeting", "text"),
    [
        (("NONE", "E01\n"), "instead of one of"),
        (("NONE", "%\n"), "answered 'NONE' with '%'"),
        (("VERSION", "%hello\n"), "'VERSION' with 'hello'"),
        (("VERSION", "!\n"), "did not understand 'VERSION'"),
        (("GETPARM(X, 140)", "!\n"), "axis name"),
        (("GETPARM(X, 140)", "%Y\n"), "called 'Y', not 'X'"),
        (("GETPARM(X, 129)", "%deg\n"), "counts in 'deg'"),
    ],
)
def test_another_instrument_is_not_opened(greeting: tuple[str, str], text: str) -> None:
    exchanges = [greeting if greeting[0] == usual[0] else usual for usual in GREETING]
    wrong = stage(expected(*exchanges), VirtualClock())
    with pytest.raises(WrongInstrument, match=text):
        wrong.open()
    with pytest.raises(LinkLost, match="open it first"):
        wrong.position()


def test_a_scale_of_zero_counts_is_not_opened() -> None:
    exchanges = [
        ("GETPARM(X, 2)", "%0.000\n") if line == "GETPARM(X, 2)" else (line, reply) for line, reply in GREETING
    ]
    with pytest.raises(WrongInstrument, match="CountsPerUnit is 0"):
        stage(expected(*exchanges), VirtualClock()).open()


def test_a_unit_that_another_client_has_changed_is_noticed_before_a_motion_and_after_a_record() -> None:
    bench = Bench().homed()
    bench.stage.arm(1, 0.01)
    bench.line.begin(bench.clock.now_s() + 0.1, 0.01, 1)
    bench.clock.sleep_s(1.0)
    bench.ensemble.befall(WrongUnit(at_s=0.0))
    with pytest.raises(InstrumentError, match=r"axis X counts in .in. of .* now, not in mm"):
        bench.stage.collect()
    for move in (lambda: bench.stage.move_to(5.0), lambda: bench.stage.oscillate(0.0, 1.0, 1.0, 2.0)):
        with pytest.raises(InstrumentError, match="set UnitsName and CountsPerUnit back"):
            move()
    assert bench.tap.sent("MOVEABS") == bench.tap.sent("OSCILLATE") == []
    bench.ensemble.relieve(WrongUnit(at_s=0.0))
    bench.stage.move_to(5.0)


@pytest.mark.parametrize(
    "limits",
    [{"position_min_mm": -20.0}, {"position_max_mm": 20.0}, {"position_min_mm": 0.0, "position_max_mm": 50.0}],
)
def test_limits_of_the_controller_narrower_than_the_rig_files_are_told_in_one_line(limits: dict[str, float]) -> None:
    low, high = limits.get("position_min_mm", -25.0), limits.get("position_max_mm", 25.0)
    with pytest.raises(LimitError) as raised:
        Bench(simulated=limits).opened()
    assert (
        f"stage: the travel -25 to 25 mm reaches beyond the controller's own limits, {low:g} to {high:g} mm"
        in str(raised.value)
    )
    assert "parameters 37 and 38" in str(raised.value)


def test_wider_limits_of_the_controller_and_none_at_all_are_no_hindrance() -> None:
    Bench(simulated={"position_min_mm": -30.0, "position_max_mm": 30.0}).opened()
    opened, _ = talking()
    assert opened.limits.position_max_mm == 25.0
    none_set = [
        (line, "%0.000\n") if line in ("GETPARM(X, 37)", "GETPARM(X, 38)") else (line, reply)
        for line, reply in GREETING
    ]
    stage(expected(*none_set), VirtualClock()).open()


def test_the_constructor_touches_nothing_and_a_stop_needs_no_open() -> None:
    bench = Bench()
    bench.stage.close()
    bench.stage.close()
    assert bench.tap.connections == 0
    bench.stage.stop()
    assert bench.tap.lines == ["ABORT X", "PROGRAM STOP 1", "AXISSTATUS(X)", "PLANESTATUS(0)", "TASKSTATE(1)"]
    with pytest.raises(LinkLost, match="open it first"):
        bench.stage.position()


def test_an_abort_that_a_disabled_axis_refuses_is_a_stop_when_it_does_not_move() -> None:
    stopping, conversation = talking(
        ("ABORT X", "#\n"),
        ("PROGRAM STOP 1", "!\n"),
        ("AXISSTATUS(X)", "%0\n"),
        ("PLANESTATUS(0)", "%0\n"),
        ("TASKSTATE(1)", "%1\n"),
    )
    stopping.stop()
    assert not conversation.left


def test_it_says_who_it_is_and_is_what_it_says() -> None:
    bench = Bench(axis="@0").opened()
    assert bench.stage.identify().firmware == "4.01.000"
    assert isinstance(bench.stage, LinearStage)
    assert isinstance(bench.stage, PacedRecorder)
    assert bench.stage.channels() == (Channel("stage_x_mm", "mm", "position", 0.0),)


def test_opening_moves_nothing_and_changes_nothing() -> None:
    bench = Bench().opened()
    assert [line for line, _ in GREETING] == bench.tap.lines


@pytest.mark.parametrize(
    "wrong",
    [{"position_min_mm": 5.0, "position_max_mm": 5.0}, {"speed_mm_s": 0.0}, {"axis": "X Y"}, {"stroke_mm": 50.0}],
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        EnsembleSettings(**wrong)


# limits, before a byte


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda s: s.move_to(25.001), "outside the travel -25 to 25 mm"),
        (lambda s: s.move_to(math.nan), "outside the travel"),
        (lambda s: s.oscillate(30.0, 1.0, 0.5, 10.0), "30 mm is outside the travel"),
        (lambda s: s.oscillate(15.0, 10.5, 0.3, 10.0), r"travel .*can be 10 mm at most"),
        (lambda s: s.oscillate(0.0, 20.0, 1.0, 10.0), r"speed limit 100 mm/s; .*15\.92 mm at most"),
        (lambda s: s.oscillate(0.0, 4.0, 3.0, 10.0), r"acceleration limit 1000 mm/s2; .*2\.814 mm at most"),
        (lambda s: s.oscillate(0.0, 0.0, 0.5, 10.0), "above zero"),
        (lambda s: s.oscillate(0.0, 5.0, -0.5, 10.0), "above zero"),
        (lambda s: s.oscillate(0.0, 5.0, 0.5, math.nan), "above zero"),
        (lambda s: s.oscillate(0.0, math.nan, 0.5, 10.0), "above zero"),
        (lambda s: s.arm(41, 0.01), "at most 40"),
        (lambda s: s.arm(0, 0.01), "cannot capture 0"),
        (lambda s: s.arm(10, 0.0001), "shortest period is 0.0005 s"),
    ],
)
def test_a_set_point_beyond_a_limit_is_refused_before_a_byte(
    call: Callable[[AerotechEnsemble], None], text: str
) -> None:
    bench = Bench().homed()
    with pytest.raises(LimitError, match=text):
        call(bench.stage)
    assert bench.tap.lines == []


@given(st.floats(-25.0, 25.0), st.floats(0.001, 60.0), st.floats(0.05, 20.0))
def test_the_largest_amplitude_named_is_allowed_and_no_more(centre_mm: float, amplitude_mm: float, hz: float) -> None:
    checked = stage(expected(), VirtualClock())
    w = 2 * math.pi * hz
    within = abs(centre_mm) + amplitude_mm <= 25 and amplitude_mm * w <= 100 and amplitude_mm * w * w <= 1000
    error = LinkLost if within else LimitError  # LinkLost: it went on to the wire, which is not open
    with pytest.raises(error):
        checked.oscillate(centre_mm, amplitude_mm, hz, 1.0)


# motion


@pytest.mark.parametrize("way", [{}, ASCII], ids=["program", "ascii"])
def test_an_oscillation_starts_at_the_negative_end_and_lasts_whole_cycles(way: dict[str, Any]) -> None:
    bench = Bench(**way).homed()
    bench.stage.oscillate(2.0, 5.0, 0.3, 10.1)
    assert bench.tap.sent("MOVEABS") == ["MOVEABS X -3 XF20"]
    assert bench.tap.sent("OSCILLATE") == (["OSCILLATE X, 5, 0.3, 4, 1"] if way else [])
    start_s = bench.axis.end_s - 4 / 0.3
    times_s = np.linspace(start_s, bench.axis.end_s, 500)
    expected_mm = 2.0 - 5.0 * np.cos(2 * math.pi * 0.3 * (times_s - start_s))
    np.testing.assert_allclose(bench.axis.sample(times_s)[0], expected_mm, atol=1e-9)


def test_a_controller_that_takes_the_amplitude_moves_the_same() -> None:
    for convention in ("peak-to-peak", "amplitude"):
        bench = Bench(
            simulated={"dialect": {"oscillate_distance": convention}}, oscillate_distance=convention
        ).homed()
        bench.stage.oscillate(0.0, 5.0, 0.5, 10.0)
        start_s = bench.axis.end_s - 10.0
        positions_mm = bench.axis.sample(start_s + np.linspace(0.0, 9.99, 1000))[0]
        assert (positions_mm.min(), positions_mm.max()) == pytest.approx((-5.0, 5.0), abs=1e-4)


def test_a_third_of_a_hertz_for_three_seconds_is_one_cycle() -> None:
    bench = Bench(**ASCII).homed()
    bench.stage.oscillate(0.0, 1.0, 1 / 3, 3.0)
    assert bench.tap.sent("OSCILLATE") == ["OSCILLATE X, 1, 0.333333333, 1, 1"]


def test_waiting_firmware_settings_of_others_are_undone_before_a_motion() -> None:
    bench = Bench(**ASCII).homed()
    other = InProcessTransport("other", bench.ensemble, bench.clock)
    bench.stage.close()
    other.write(b"WAIT MODE MOVEDONE\n")
    assert other.read_exactly(1, 1.0) == b"%"
    other.close()
    bench.stage.open()
    bench.stage.oscillate(0.0, 5.0, 0.5, 1000.0)
    assert bench.axis.end_s > bench.clock.now_s() + 999.0


def test_positions_shifted_by_another_client_are_refused() -> None:
    bench = Bench().homed()
    bench.stage.close()
    other = InProcessTransport("other", bench.ensemble, bench.clock)
    other.write(b"POSOFFSET SET X, 3\n")
    other.close()
    bench.stage.open()
    with pytest.raises(InstrumentError, match="shifted by -3 mm"):
        bench.stage.home()


def test_an_axis_not_homed_is_not_moved() -> None:
    bench = Bench().opened()
    with pytest.raises(InstrumentError, match="not enabled and homed"):
        bench.stage.move_to(1.0)
    assert not bench.tap.sent("MOVEABS")


@pytest.mark.parametrize("style", ["refuse", "fault"])
def test_a_limit_of_the_controller_is_reported_with_its_fault(style: str) -> None:
    bench = Bench(**ASCII | {"simulated": {"dialect": BY_ASCII | {"limit_reply": style}}}).homed()
    # Somebody narrows them while the stage is in use.
    bench.stage._wire.tell("SETPARM X, 38, 10")
    with pytest.raises(InstrumentError, match=r"MOVEABS X 12 XF20.*positive soft limit") as raised:
        bench.stage.move_to(12.0)
    assert raised.value.code == "16"
    assert not isinstance(raised.value, MotionStopped)
    assert not bench.stage.is_homed()
    bench.stage.home()
    bench.stage.move_to(9.0)
    assert bench.stage.position().value == 9.0
    bench.stage.move_to(-5.0)
    with pytest.raises(InstrumentError, match=r"OSCILLATE.*positive soft limit"):
        bench.stage.oscillate(0.0, 11.0, 0.5, 10.0)


def test_a_fault_on_the_way_is_reported_with_where_it_stopped() -> None:
    bench = Bench().homed()
    bench.clock.call_at(bench.clock.now_s() + 0.6, lambda: bench.ensemble.controller.trip(AxisFault.ENCODER))
    with pytest.raises(InstrumentError, match=r"stopped at \d+\.?\d* mm \(encoder, AXISFAULT 524288\)") as raised:
        bench.stage.move_to(20.0)
    assert not isinstance(raised.value, MotionStopped)


def test_an_axis_that_somebody_else_stopped_did_not_arrive() -> None:
    bench = Bench().homed()
    bench.clock.call_at(bench.clock.now_s() + 0.6, bench.ensemble.controller.abort)
    with pytest.raises(InstrumentError, match=r"it stopped at .*no axis fault") as raised:
        bench.stage.move_to(20.0)
    assert not isinstance(raised.value, MotionStopped)


def test_a_move_that_never_ends_is_aborted() -> None:
    bench = Bench(move_speed_mm_s=0.1, motion_timeout_s=5.0).homed()
    with pytest.raises(InstrumentError, match="has not ended after 5 s and was aborted"):
        bench.stage.move_to(20.0)
    bench.clock.sleep_s(0.1)
    assert bench.at_rest()


def test_homing_that_finds_no_mark_is_an_error() -> None:
    bench = Bench(simulated={"home_position_mm": 20.0}).opened()
    bench.clock.call_at(bench.clock.now_s() + 1.0, bench.ensemble.controller.abort)
    with pytest.raises(InstrumentError, match="ended without the reference"):
        bench.stage.home()


def test_a_controller_without_asynchronous_homing_is_homed_all_the_same() -> None:
    bench = Bench(simulated={"home_search_s": 30.0}).opened()
    bench.stage.home()
    assert bench.stage.is_homed()
    assert bench.tap.sent("PROGRAM RUN 5") == ['PROGRAM RUN 5, "HomeAsync.bcx"']
    assert bench.tap.sent("HOME") == ["HOME X"]


# stopping


SLOW: dict[str, Any] = {"motion_timeout_s": 1000.0, "move_speed_mm_s": 0.1}
"""Motions that take minutes of rig time: none ends by itself before it is stopped."""


@pytest.mark.parametrize(
    ("keyword", "action"),
    [
        ("MOVEABS", lambda s: s.move_to(20.0)),
        ("MOVEABS", lambda s: s.oscillate(0.0, 20.0, 0.5, 10.0)),
        ("PROGRAM RUN 5", lambda s: s.home()),
    ],
    ids=["move", "way to an oscillation", "homing"],
)
def test_a_stop_from_another_thread_ends_a_blocked_motion(
    keyword: str, action: Callable[[AerotechEnsemble], None]
) -> None:
    homing = keyword == "PROGRAM RUN 5"
    dialect = {"home_async": "program"}
    simulated = {
        "dialect": dialect,
        "home_search_s": 0.1,
        "home_position_mm": 20.0 if homing else 0.0,
        "home_speed_mm_s": 0.1,
    }
    bench = Bench(clock=ScaledClock(20.0), simulated=simulated, **SLOW)
    bench = bench.opened() if homing else bench.homed()
    seen = when_sent(bench, keyword)
    with in_thread(lambda: action(bench.stage)) as raised:
        assert seen.wait(PATIENCE_S)
        bench.stage.stop()
        assert bench.at_rest()
    assert [type(error) for error in raised] == [MotionStopped]
    assert bench.at_rest()
    assert not bench.tap.sent("OSCILLATE")


def test_a_stop_from_another_thread_ends_an_oscillation() -> None:
    bench = Bench(clock=ScaledClock(20.0)).homed()
    bench.stage.oscillate(0.0, 5.0, 0.5, 1000.0)
    assert bench.axis.moving(bench.clock.now_s())
    with in_thread(bench.stage.stop) as raised:
        pass
    assert raised == []
    assert bench.at_rest()


def test_a_stop_while_the_wire_is_busy_with_others_gets_its_turn() -> None:
    bench = Bench(clock=ScaledClock(20.0), **SLOW).homed()
    seen = when_sent(bench, "MOVEABS")
    asking = threading.Event()

    def watch() -> None:
        while not asking.is_set():
            bench.stage.position()

    with in_thread(watch) as watched, in_thread(lambda: bench.stage.move_to(20.0)) as raised:
        assert seen.wait(PATIENCE_S)
        bench.stage.stop()
        asking.set()
    assert watched == []
    assert [type(error) for error in raised] == [MotionStopped]


def test_a_motion_stopped_while_it_is_prepared_never_begins() -> None:
    bench = Bench().homed()
    stopper = threading.Thread(target=bench.stage.stop)

    def stop_now(line: str) -> bool:
        if line.startswith("RAMP RATE"):
            stopper.start()
            deadline = time.monotonic() + PATIENCE_S
            while bench.stage._motion._stops == 0 and time.monotonic() < deadline:
                time.sleep(0)
        return True

    bench.tap.on_line = stop_now
    with pytest.raises(MotionStopped):
        bench.stage.move_to(1.0)
    stopper.join(PATIENCE_S)
    assert not bench.tap.sent("MOVEABS")
    assert bench.tap.sent("ABORT")


def test_two_threads_do_not_get_into_each_others_exchanges() -> None:
    bench = Bench().homed()
    asker = threading.Thread(target=bench.stage.position)
    waited = []

    def ask_as_well(line: str) -> bool:
        if line.startswith("IGLOBAL(0)") and not waited:
            asker.start()
            asker.join(0.05)
            waited.append(asker.is_alive())
        return True

    bench.tap.on_line = ask_as_well
    bench.stage.arm(1, 0.01)
    asker.join(PATIENCE_S)
    assert waited == [True]
    assert "PFBKPROG(X)" in bench.tap.lines


def test_a_blocking_homing_is_stopped_when_the_controller_listens_again() -> None:
    simulated = {"home_search_s": 5.0}
    bench = Bench(clock=ScaledClock(20.0), simulated=simulated).opened()
    seen = when_sent(bench, "HOME X")
    with in_thread(bench.stage.home) as raised:
        assert seen.wait(PATIENCE_S)
        bench.stage.stop()
    assert [type(error) for error in raised] == [MotionStopped]
    assert bench.tap.sent("ABORT")[0] == "ABORT X"


def test_a_stop_may_come_at_any_time_and_any_number_of_times() -> None:
    bench = Bench().homed()
    bench.stage.stop()
    bench.stage.oscillate(0.0, 5.0, 0.5, 100.0)
    bench.clock.sleep_s(0.5)
    assert not bench.at_rest()
    bench.stage.stop()
    assert bench.at_rest()
    bench.stage.stop()
    bench.stage.move_to(1.0)
    assert bench.stage.position().value == 1.0


def test_a_stop_ends_a_capture() -> None:
    bench = Bench().homed()
    bench.stage.arm(10, 0.01)
    bench.stage.stop()
    assert "IGLOBAL(0) = 5" in bench.tap.lines
    with pytest.raises(InstrumentError, match="no capture is armed"):
        bench.stage.collect()


# capture


@pytest.mark.parametrize(
    ("simulated", "configured"),
    [
        ({}, {}),
        ({"dialect": {"capture_read": "continues"}}, {}),
        ({"dialect": {"capture_read": "continues"}}, {"capture_read": "continues", "capture_registers": 7}),
        ({"dialect": {"capture_read": "continues"}, "integer_registers": 50}, {"capture_read": "continues"}),
        ({"dialect": {"always_send_eos": True}}, {}),
        (ASCII["simulated"], {key: value for key, value in ASCII.items() if key != "simulated"}),
        ({"capture_latency_s": 0.05}, {"latency_s": 0.05}),
        ({"capture_trigger": 3, "capture_input": 2}, {"capture_trigger": 3, "capture_input": 2}),
    ],
)
def test_what_is_collected_is_the_motion_at_the_edges(simulated: dict[str, Any], configured: dict[str, Any]) -> None:
    bench = Bench(simulated={"integer_registers": 310, **simulated}, **configured).homed()
    bench.stage.oscillate(0.0, 5.0, 0.5, 20.0)
    bench.stage.arm(300, 0.02)
    first_s = bench.clock.now_s() + 0.3
    bench.line.begin(first_s, 0.02, 300)
    bench.clock.sleep_s(first_s + 0.02 * 299 - bench.clock.now_s())
    rows = bench.stage.collect()
    edges_s = first_s + 0.02 * np.arange(300) + simulated.get("capture_latency_s", 0.0)
    assert rows.shape == (300, 1)
    # A count is 5 nm: what is right to a count is off by half of one at most.
    np.testing.assert_allclose(rows[:, 0], bench.axis.sample(edges_s)[0], atol=2.5e-6 + 1e-12)


@pytest.mark.parametrize("short_read", ["refuse", "partial"])
@pytest.mark.parametrize("way", [{}, ASCII], ids=["program", "ascii"])
def test_missed_edges_are_not_passed_over(way: dict[str, Any], short_read: str) -> None:
    dialect = {"capture_read": "continues", "capture_short_read": short_read} | (BY_ASCII if way else {})
    bench = Bench(**way | {"simulated": {"dialect": dialect}}, capture_read="continues", capture_registers=40).homed()
    for edges in (0, 39, 99):
        bench.stage.arm(100, 0.01)
        bench.line.begin(bench.clock.now_s() + 0.1, 0.01, edges)
        bench.clock.sleep_s(2.0)
        with pytest.raises(InstrumentError, match="fewer positions captured than the 100"):
            bench.stage.collect()


@pytest.mark.parametrize("way", [{}, ASCII], ids=["program", "ascii"])
def test_a_refused_read_with_an_axis_fault_names_the_fault(way: dict[str, Any]) -> None:
    dialect = {"capture_short_read": "refuse"} | (BY_ASCII if way else {})
    bench = Bench(**way | {"simulated": {"dialect": dialect}}).homed()
    bench.stage.arm(10, 0.01)
    bench.ensemble.controller.trip(AxisFault.OVER_CURRENT)
    with pytest.raises(InstrumentError, match="over-current"):
        bench.stage.collect()


def test_one_read_must_hold_all_where_reads_start_over() -> None:
    bench = Bench(simulated={"integer_registers": 1000}, capture_registers=100).homed()
    with pytest.raises(LimitError, match="at most 100"):
        bench.stage.arm(101, 0.01)


def test_how_many_registers_there_are_is_asked_and_limits_a_record() -> None:
    bench = Bench(simulated={"integer_registers": 50}).homed()
    assert bench.stage.longest_record(0.01) == 40
    with pytest.raises(LimitError, match=r"at most 40; .* raise the controller's GlobalIntegers"):
        bench.stage.arm(41, 0.01)
    assert bench.tap.lines == []
    with pytest.raises(LimitError, match="at most 0"):
        Bench(simulated={"integer_registers": 5}).homed().stage.arm(1, 0.01)


# the link


def test_a_connection_the_controller_has_closed_is_opened_again() -> None:
    bench = Bench(simulated={"socket_timeout_s": 60.0}).homed()
    for action in (bench.stage.position, lambda: bench.stage.move_to(1.0), bench.stage.stop, bench.stage.rest):
        before = bench.tap.connections
        bench.clock.sleep_s(61.0)
        action()
        assert bench.tap.connections == before + 1


def recorded(samples: int, **configured: Any) -> Bench:
    """A bench whose stage has been recorded while it oscillated."""
    bench = Bench(**configured).homed()
    bench.stage.oscillate(0.0, 5.0, 0.5, 20.0)
    bench.stage.arm(samples, 0.05)
    bench.line.begin(bench.clock.now_s() + 0.3, 0.05, samples)
    bench.clock.sleep_s(1.5)
    return bench


def test_a_read_out_that_was_cut_off_is_no_record() -> None:
    bench = recorded(20)
    bench.tap.on_line = lambda line: line != "IGLOBAL(15)"
    with pytest.raises(LinkLost):
        bench.stage.collect()


@pytest.mark.parametrize("register", [10, 11, 19, 29])
@pytest.mark.parametrize("fault", ["doubled", "previous", "dropped", "half"])
def test_a_fault_between_registers_gives_no_record(register: int, fault: str) -> None:
    bench = recorded(20)
    line = f"IGLOBAL({register})"
    replies: list[bytes] = []

    def spoil(reply: bytes) -> bytes:
        if bench.tap.lines.count(line) == 1 and bench.tap.lines[-1] == line:
            spoilt = {"doubled": reply * 2, "previous": replies[-1], "dropped": reply[:3] + reply[4:]}
            return spoilt.get(fault, reply[: len(reply) // 2])
        replies.append(reply)
        return reply

    bench.tap.on_reply = spoil

    def record() -> None:
        bench.stage.collect()
        bench.stage.confirm_in_step()

    with pytest.raises(RigError):
        record()
    bench.stage.confirm_in_step()


def test_a_motion_command_is_never_sent_twice() -> None:
    bench = Bench().homed()
    bench.tap.on_line = lambda line: not line.startswith("MOVEABS")
    with pytest.raises(LinkLost):
        bench.stage.move_to(1.0)
    assert len(bench.tap.sent("MOVEABS")) == 1
    bench.tap.on_line = lambda _: True
    assert bench.stage.position().value == 0.0


def test_an_abort_is_sent_again_on_a_new_connection() -> None:
    bench = Bench().homed()
    bench.stage.oscillate(0.0, 5.0, 0.5, 100.0)
    cuts = iter([False])
    bench.tap.on_line = lambda line: next(cuts, True) if line.startswith("ABORT") else True
    bench.stage.stop()
    assert len(bench.tap.sent("ABORT")) == 2
    assert bench.at_rest()


def test_a_late_reply_is_not_taken_for_the_next_one() -> None:
    bench = Bench(faults={"late": {"nth": [10], "delay_s": 2.5}}).opened()
    with pytest.raises(LinkTimeout, match="nothing came"):
        bench.stage.identify()
    assert bench.stage.position().value == 0.0
    assert bench.tap.connections == 2


def test_a_controller_busy_with_another_client_does_not_answer() -> None:
    bench = Bench()
    first = InProcessTransport("first", bench.ensemble, bench.clock)
    with pytest.raises(LinkTimeout):
        bench.stage.open()
    first.close()
    bench.stage.open()
    assert bench.stage.is_homed() is False


def test_over_a_real_socket_it_homes_moves_and_survives_a_restart_of_the_controller() -> None:
    clock = ScaledClock(200.0)
    settings = EnsembleSimulatorSettings(socket_timeout_s=0.0, home_search_s=1.0)
    server = Server(clock)
    port = server.add_tcp("stage", SimulatedEnsemble(clock, MotionAxis(), TriggerLine(), settings)).port
    serving = threading.Thread(target=server.serve)
    serving.start()
    try:
        rig_clock = RealClock(200.0)
        connect = Mock(wraps=connector(f"tcp://127.0.0.1:{port}", rig_clock))
        driver = AerotechEnsemble("stage", EnsembleSettings(), connect, rig_clock)
        driver.open()
        driver.home()
        driver.move_to(2.0)
        assert driver.position().value == 2.0
        with pytest.raises(LinkLost):
            driver._wire.tell("RESET")
        assert not driver.is_homed()
        assert connect.call_count == 2
        driver.home()
        driver.move_to(-2.0)
        assert driver.position().value == -2.0
        driver.close()
    finally:
        server.stop()
        serving.join(PATIENCE_S)
        server.close()
