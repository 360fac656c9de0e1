"""What every rotation stage must do, whatever it speaks: one suite, run over each driver."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.newport_esp301 import Esp301Settings, NewportEsp301
from drivers.newport_xps import NewportXps, XpsSettings
from drivers.pi_gcs2 import GcsSettings, PiGcsStage
from drivers.transport import InProcessTransport
from rigctl.core.errors import InstrumentError, LimitError, LinkError, MotionStopped, RigError, WrongInstrument
from rigctl.core.interfaces import RotationStage
from rigctl.core.limits import RotationLimits
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.motion import MotionAxis
from simulators.newport_esp301 import Esp301SimulatorSettings, SimulatedEsp301
from simulators.newport_esp301.settings import Esp301Dialect
from simulators.newport_xps import XPS_D, SimulatedXps, XpsSimulatorSettings
from simulators.pi_gcs2 import Gcs2Dialect, Gcs2SimulatorSettings, SimulatedGcs2

SPEED_DEG_S, ACCELERATION_DEG_S2 = 10.0, 40.0
WAIT_S = 10.0
HOMING_STEPS = (b"GroupInitialize", b"GroupHomeSearch", b"1MO\r", b"1OR", b"SVO 1", b"FRF 1")


class Tap:
    """Passes bytes on to a simulator and keeps what was sent."""

    def __init__(self, simulator: Any) -> None:
        self.simulator = simulator
        self.sent: list[bytes] = []
        self.connections = 0

    def connect(self, send: Callable[[bytes], None]) -> Any:
        self.connections += 1
        connection = self.simulator.connect(send)
        receive = connection.receive

        def tapped(data: bytes) -> None:
            self.sent.append(data)
            receive(data)

        connection.receive = tapped
        return connection


class Stranger:
    """Something else at the address: it answers everything with the same bytes."""

    def __init__(self, answer: bytes) -> None:
        self.answer = answer

    def connect(self, send: Callable[[bytes], None]) -> Any:
        stranger = self

        class Connection:
            def receive(self, data: bytes) -> None:
                if stranger.answer:
                    send(stranger.answer)

            def close(self) -> None:
                pass

        return Connection()


@dataclass
class Bench:
    kind: str
    stage: RotationStage
    axis: MotionAxis
    tap: Tap
    clock: SimulationClock

    def moving(self) -> bool:
        return abs(self.axis.velocity(self.clock.now_s())) > 1.0


LIMITS = {
    "angle_min_deg": -120.0,
    "angle_max_deg": 150.0,
    "speed_deg_s": SPEED_DEG_S,
    "acceleration_deg_s2": ACCELERATION_DEG_S2,
}


def driver(kind: str, endpoint: Any, clock: SimulationClock, **settings: Any) -> RotationStage:
    def connect() -> InProcessTransport:
        return InProcessTransport("sim:stage", endpoint, clock)

    if kind.startswith("xps"):
        return NewportXps("stage", XpsSettings(**{**LIMITS, **settings}), connect, clock)
    if kind.startswith("gcs2"):
        return PiGcsStage("stage", GcsSettings(**{"unit": "deg"} | LIMITS | settings), connect, clock)
    return NewportEsp301("stage", Esp301Settings(**{**LIMITS, **settings}), connect, clock)


SIMULATORS: dict[str, Callable[[SimulationClock, MotionAxis], Any]] = {
    "xps": lambda clock, axis: SimulatedXps(clock, {"Group1": {"Pos": axis}}),
    # What the manuals leave open, read the other way.
    "xps, other codes": lambda clock, axis: SimulatedXps(
        clock, {"Group1": {"Pos": axis}}, XpsSimulatorSettings(outside_limits_code=-35, killed_motion_code=-26)
    ),
    "xps, D": lambda clock, axis: SimulatedXps(clock, {"Group1": {"Pos": axis}}, XPS_D),
    "esp301": lambda clock, axis: SimulatedEsp301(clock, [axis]),
    "gcs2": lambda clock, axis: SimulatedGcs2(clock, axis),
    "gcs2, gentle": lambda clock, axis: SimulatedGcs2(
        clock, axis, Gcs2SimulatorSettings(dialect=Gcs2Dialect(tells_unit=True, numbers="decimal", settle_s=0.0))
    ),
    "esp301, no lock": lambda clock, axis: SimulatedEsp301(
        clock, [axis], Esp301SimulatorSettings(dialect=Esp301Dialect(keypad_lock=False))
    ),
}


def bench(reading: str, clock: SimulationClock) -> Bench:
    kind = reading.partition(",")[0]
    axis = MotionAxis(2.0)
    tap = Tap(SIMULATORS[reading](clock, axis))
    return Bench(kind, driver(kind, tap, clock), axis, tap, clock)


@pytest.fixture(params=SIMULATORS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def virtual(kind: str) -> Bench:
    return bench(kind, VirtualClock())


@pytest.fixture
def scaled(kind: str) -> Bench:
    return bench(kind, ScaledClock(speed=200.0))


class Blocked:
    """A call that blocks in a thread of its own."""

    def __init__(self, call: Callable[[], None]) -> None:
        self.error: RigError | None = None
        self._call = call
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._call()
        except RigError as error:
            self.error = error

    def join(self) -> None:
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()


def test_it_is_a_rotation_stage_and_its_constructor_touches_nothing(virtual: Bench) -> None:
    assert isinstance(virtual.stage, RotationStage)
    assert virtual.stage.limits == RotationLimits(-120.0, 150.0, SPEED_DEG_S, ACCELERATION_DEG_S2)
    assert virtual.tap.connections == 0


def test_opening_identifies_and_moves_nothing(virtual: Bench) -> None:
    virtual.stage.open()
    identity = virtual.stage.identify()
    assert identity.model in identity.text
    assert identity.firmware in identity.text
    virtual.clock.sleep_s(5.0)
    assert virtual.axis.position(virtual.clock.now_s()) == 2.0
    assert not virtual.stage.is_homed()


def test_homing_finds_the_zero_and_a_second_homing_does_not_move(virtual: Bench) -> None:
    virtual.stage.open()
    virtual.stage.home()
    assert virtual.stage.is_homed()
    assert virtual.axis.position(virtual.clock.now_s()) == 0.0
    virtual.stage.move_to(30.0)
    before = len(virtual.tap.sent)
    virtual.stage.home()
    assert virtual.axis.position(virtual.clock.now_s()) == 30.0
    again = b" ".join(virtual.tap.sent[before:])
    assert b"HomeSearch" not in again
    assert b"OR" not in again


def test_a_move_returns_at_the_target_at_rest_with_the_set_speed(virtual: Bench) -> None:
    virtual.stage.open()
    virtual.stage.home()
    started_s = virtual.clock.now_s()
    virtual.stage.move_to(-60.5)
    now_s = virtual.clock.now_s()
    assert virtual.axis.position(now_s) == -60.5
    assert virtual.axis.velocity(now_s) == 0.0
    assert not virtual.axis.moving(now_s)
    trapezoid_s = 60.5 / SPEED_DEG_S + SPEED_DEG_S / ACCELERATION_DEG_S2
    assert now_s - started_s == pytest.approx(trapezoid_s, abs=0.2)
    reading = virtual.stage.angle()
    assert (reading.value, reading.unit) == (-60.5, "deg")
    assert now_s <= reading.time_s <= virtual.clock.now_s()


def test_a_move_to_where_it_stands_is_a_move(virtual: Bench) -> None:
    virtual.stage.open()
    virtual.stage.home()
    virtual.stage.move_to(12.5)
    virtual.stage.move_to(12.5)
    assert virtual.stage.angle().value == 12.5


@pytest.mark.parametrize("angle_deg", [150.0001, -120.5, float("nan"), float("inf")])
def test_a_target_outside_the_limits_sends_nothing(virtual: Bench, angle_deg: float) -> None:
    virtual.stage.open()
    virtual.stage.home()
    before = len(virtual.tap.sent)
    with pytest.raises(LimitError, match=r"deg is outside the limits -120 to 150 deg"):
        virtual.stage.move_to(angle_deg)
    assert len(virtual.tap.sent) == before


def test_a_stage_that_is_not_homed_does_not_move(virtual: Bench) -> None:
    virtual.stage.open()
    with pytest.raises(InstrumentError, match="home"):
        virtual.stage.move_to(5.0)
    assert virtual.axis.position(virtual.clock.now_s()) == 2.0


def test_limits_beyond_the_controllers_own_are_refused_before_anything_moves(kind: str) -> None:
    clock = VirtualClock()
    wide = bench(kind, clock)
    stage = driver(kind, wide.tap, clock, angle_max_deg=171.0)
    stage.open()
    with pytest.raises(LimitError, match=r"-120 to 171 deg reach beyond .* -170 to 170 deg"):
        stage.home()
    assert wide.axis.position(clock.now_s()) == 2.0


def test_stop_from_another_thread_ends_a_blocked_move(scaled: Bench) -> None:
    scaled.stage.open()
    scaled.stage.home()
    move = Blocked(lambda: scaled.stage.move_to(140.0))
    assert scaled.clock.wait_for(scaled.moving, 20.0)
    during = scaled.stage.angle()
    assert 0.0 <= during.value < 140.0
    scaled.stage.stop()
    move.join()
    assert isinstance(move.error, MotionStopped)
    rest_deg = scaled.axis.position(scaled.clock.now_s())
    assert 0.0 < rest_deg < 140.0
    scaled.stage.stop()
    scaled.stage.move_to(0.0)
    assert scaled.stage.angle().value == 0.0


def test_stop_from_another_thread_ends_homing(scaled: Bench) -> None:
    scaled.axis.place(scaled.clock.now_s(), 100.0)
    scaled.stage.open()
    homing = Blocked(scaled.stage.home)
    assert scaled.clock.wait_for(scaled.moving, 20.0)
    scaled.stage.stop()
    homing.join()
    assert isinstance(homing.error, MotionStopped)
    assert not scaled.stage.is_homed()
    scaled.stage.home()
    assert scaled.stage.is_homed()


@pytest.mark.parametrize(
    ("kind", "step"),
    [
        ("xps", b"PositionerSGammaParametersSet"),
        ("xps", b"GroupInitialize"),
        ("xps", b"GroupHomeSearch"),
        ("gcs2", b"VEL 1"),
        ("gcs2", b"SVO 1"),
        ("gcs2", b"FRF 1"),
        ("esp301", b"1VA"),
        ("esp301", b"1MO\r"),
        ("esp301", b"1OR"),
    ],
)
def test_a_stop_between_the_steps_of_homing_lets_none_of_the_later_ones_happen(virtual: Bench, step: bytes) -> None:
    """As a signal handler would call it: in the same thread, just before a step's bytes are out."""
    virtual.axis.place(virtual.clock.now_s(), 100.0)
    virtual.stage.open()

    class StopsAtStep(list[bytes]):
        def append(self, data: bytes) -> None:
            super().append(data)
            if data.startswith(step):
                virtual.stage.stop()

    virtual.tap.sent = StopsAtStep()
    with pytest.raises((MotionStopped, LinkError)):
        virtual.stage.home()
    before_stop = next(i for i, data in enumerate(virtual.tap.sent) if data.startswith(step))
    assert not any(data.startswith(HOMING_STEPS) for data in virtual.tap.sent[before_stop + 1 :])
    virtual.clock.sleep_s(30.0)
    assert virtual.axis.position(virtual.clock.now_s()) == pytest.approx(100.0, abs=1.0)
    assert not virtual.stage.is_homed()


def test_stop_is_harmless_at_rest_and_when_not_open(virtual: Bench) -> None:
    virtual.stage.stop()
    virtual.stage.open()
    virtual.stage.stop()
    virtual.stage.home()
    virtual.stage.stop()
    virtual.stage.stop()
    assert virtual.stage.is_homed()
    virtual.stage.move_to(1.0)
    virtual.stage.close()
    virtual.stage.close()
    virtual.stage.stop()


def test_a_following_error_is_an_instrument_error_and_homing_recovers(scaled: Bench) -> None:
    scaled.stage.open()
    scaled.stage.home()
    move = Blocked(lambda: scaled.stage.move_to(140.0))
    assert scaled.clock.wait_for(scaled.moving, 20.0)
    scaled.tap.simulator.fail_following("Group1" if scaled.kind == "xps" else 1)
    move.join()
    assert isinstance(move.error, InstrumentError)
    assert not isinstance(move.error, MotionStopped)
    assert (move.error.code, move.error.instrument) in {("-25", "stage"), ("103", "stage"), ("1024", "stage")}
    assert "following error" in move.error.text.lower()
    assert scaled.clock.wait_for(lambda: not scaled.axis.moving(scaled.clock.now_s()), 20.0)
    scaled.stage.home()
    scaled.stage.move_to(3.0)
    assert scaled.stage.angle().value == 3.0


def test_nobody_answers(kind: str) -> None:
    clock = VirtualClock()
    stage = driver(kind, Stranger(b""), clock, link_timeout_s=1.5)
    with pytest.raises(LinkError, match="nothing came"):
        stage.open()
    assert clock.now_s() == pytest.approx(1.5)
    with pytest.raises(LinkError, match="not connected"):
        stage.angle()


@pytest.mark.parametrize("answer", [b"0,KEITHLEY,EndOfAPI\r\n", b"KEYENCE,EndOfAPI\r\n", b"-4,x,EndOfAPI\r\n"])
def test_another_instrument_answers(kind: str, answer: bytes) -> None:
    stage = driver(kind, Stranger(answer), VirtualClock())
    with pytest.raises(WrongInstrument, match="stage: "):
        stage.open()


def test_calls_on_a_stage_that_is_not_open_say_so(virtual: Bench) -> None:
    with pytest.raises(LinkError, match="open it first"):
        virtual.stage.angle()
    virtual.stage.open()
    virtual.stage.close()
    with pytest.raises(LinkError, match="open it first"):
        virtual.stage.move_to(1.0)


def test_a_motion_that_never_ends_is_stopped_and_not_repeated(kind: str) -> None:
    clock = VirtualClock()
    slow = bench(kind, clock)
    stage = driver(kind, slow.tap, clock, motion_timeout_s=6.0)
    stage.open()
    stage.home()
    with pytest.raises((LinkError, InstrumentError), match="6 s"):
        stage.move_to(140.0)
    clock.sleep_s(30.0)
    assert slow.axis.position(clock.now_s()) < 80.0
    moves = [data for data in slow.tap.sent if b"MoveAbsolute" in data or b"PA" in data or b"MOV" in data]
    assert len(moves) == 1


@pytest.mark.parametrize("bad", [{"angle_min_deg": 10.0, "angle_max_deg": -10.0}, {"speed_deg_s": 0.0}, {"oops": 1}])
def test_settings_that_make_no_sense_are_refused(kind: str, bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"angle_min_deg|speed_deg_s|oops"):
        driver(kind, None, VirtualClock(), **bad)
