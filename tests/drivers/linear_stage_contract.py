"""What every `LinearStage` promises, as tests that anybody can run on a stage of theirs.

A module that does so imports everything from here and has a fixture `make_backend`, with a parameter for each stage:
it gives a function from a simulation clock to a `Backend`. See `test_linear_stage_contract.py`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError, LimitError, LinkError, MotionStopped
from rigctl.core.interfaces import LinearStage
from simulators.clock import ScaledClock, SimulationClock, VirtualClock


@dataclass
class Backend:
    """A stage not yet opened, and its time."""

    stage: LinearStage
    clock: Clock


MakeBackend = Callable[[SimulationClock], Backend]


@pytest.fixture
def make_clock() -> Callable[[], SimulationClock]:
    return VirtualClock


with_a_second_thread = pytest.mark.parametrize("make_clock", [lambda: ScaledClock(5.0)], ids=["scaled"])
"""A virtual clock would be at the end of a motion before another thread gets its turn."""


@pytest.fixture
def closed(make_backend: MakeBackend, make_clock: Callable[[], SimulationClock]) -> Iterator[Backend]:
    backend = make_backend(make_clock())
    yield backend
    backend.stage.stop()
    backend.stage.close()


@pytest.fixture
def opened(closed: Backend) -> Backend:
    closed.stage.open()
    return closed


@pytest.fixture
def homed(opened: Backend) -> Backend:
    opened.stage.home()
    return opened


def positions_mm(backend: Backend, duration_s: float, samples: int) -> np.ndarray:
    """What the encoder says now and then."""
    found = []
    for _ in range(samples):
        found.append(backend.stage.position().value)
        backend.clock.sleep_s(duration_s / samples)
    return np.array(found)


def at_rest(backend: Backend) -> bool:
    return bool(np.ptp(positions_mm(backend, 0.5, 5)) < 1e-3)


def test_it_is_a_linear_stage(closed: Backend) -> None:
    assert isinstance(closed.stage, LinearStage)


def test_nothing_can_be_asked_before_open_or_after_close(closed: Backend) -> None:
    with pytest.raises(LinkError):
        closed.stage.position()
    closed.stage.open()
    assert closed.stage.identify().model
    closed.stage.close()
    closed.stage.close()
    with pytest.raises(LinkError):
        closed.stage.position()


def test_opening_moves_nothing(opened: Backend) -> None:
    assert at_rest(opened)


def test_a_stage_not_homed_refuses_to_move(opened: Backend) -> None:
    if opened.stage.is_homed():
        pytest.skip("this stage is homed already")
    with pytest.raises(InstrumentError):
        opened.stage.move_to(0.5)
    assert at_rest(opened)


def test_homing_twice_is_homing_once(homed: Backend) -> None:
    assert homed.stage.is_homed()
    homed.stage.move_to(1.0)
    homed.stage.home()
    assert homed.stage.position().value == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("target_mm", [2.0, -0.25, 0.0])
def test_a_move_returns_at_rest_at_its_target(homed: Backend, target_mm: float) -> None:
    homed.stage.move_to(target_mm)
    reading = homed.stage.position()
    assert reading.value == pytest.approx(target_mm, abs=2e-3)
    assert reading.unit == "mm"
    assert abs(homed.clock.now_s() - reading.time_s) < 5.0
    assert at_rest(homed)


def test_limits_are_checked_at_both_ends(homed: Backend) -> None:
    limits = homed.stage.limits
    middle_mm = 0.5 * (limits.position_min_mm + limits.position_max_mm)
    half_mm = limits.position_max_mm - middle_mm
    refused: list[Callable[[], None]] = [
        lambda: homed.stage.move_to(limits.position_max_mm + 0.01),
        lambda: homed.stage.move_to(limits.position_min_mm - 0.01),
        lambda: homed.stage.oscillate(middle_mm, half_mm + 0.01, 0.1, 1.0),
        lambda: homed.stage.oscillate(middle_mm, 1.0, 1.01 * limits.speed_mm_s / (2 * math.pi), 1.0),
        lambda: homed.stage.oscillate(middle_mm, 1.0, math.sqrt(1.01 * limits.acceleration_mm_s2) / 6.283, 1.0),
    ]
    for motion in refused:
        with pytest.raises(LimitError):
            motion()
    assert at_rest(homed)


def test_an_oscillation_swings_about_its_centre(homed: Backend) -> None:
    homed.stage.oscillate(0.5, 2.0, 0.5, 20.0)
    swing_mm = positions_mm(homed, 10.0, 60)
    assert swing_mm.max() == pytest.approx(2.5, abs=0.3)
    assert swing_mm.min() == pytest.approx(-1.5, abs=0.3)
    assert swing_mm.max() <= 2.502
    assert swing_mm.min() >= -1.502


def test_an_oscillation_lasts_as_long_as_asked_and_ends_by_itself(homed: Backend) -> None:
    homed.stage.oscillate(0.0, 1.0, 1.0, 3.5)
    begun_s = homed.clock.now_s()
    while homed.clock.now_s() < begun_s + 3.0:
        assert np.ptp(positions_mm(homed, 0.5, 4)) > 0.05
    homed.clock.sleep_s(2.0)
    assert at_rest(homed)
    assert homed.stage.position().value == pytest.approx(-1.0, abs=2e-3)


def test_an_oscillation_ends_by_itself_when_its_computer_is_gone(homed: Backend) -> None:
    homed.stage.oscillate(0.0, 1.0, 1.0, 3.5)
    homed.stage.close()  # no stop, no rest: nobody is there any more
    homed.clock.sleep_s(8.0)
    homed.stage.open()
    assert not homed.stage.is_moving()


def test_a_new_oscillation_replaces_the_old(homed: Backend) -> None:
    homed.stage.oscillate(0.0, 2.0, 0.5, 200.0)
    homed.stage.oscillate(3.0, 0.5, 0.5, 200.0)
    swing_mm = positions_mm(homed, 4.0, 24)
    assert swing_mm.min() >= 2.498
    assert swing_mm.max() <= 3.502


def test_rest_ends_an_oscillation(homed: Backend) -> None:
    homed.stage.oscillate(0.0, 2.0, 0.5, 200.0)
    homed.stage.rest()
    assert at_rest(homed)
    homed.stage.rest()
    homed.stage.move_to(0.0)
    assert homed.stage.position().value == pytest.approx(0.0, abs=2e-3)


def test_stop_ends_an_oscillation_and_may_be_called_again(homed: Backend) -> None:
    homed.stage.oscillate(0.0, 2.0, 0.5, 200.0)
    homed.stage.stop()
    homed.stage.stop()
    assert at_rest(homed)
    assert homed.stage.is_homed()


@with_a_second_thread
def test_stop_from_another_thread_ends_a_motion_that_blocks(homed: Backend) -> None:
    homed.stage.move_to(-0.5)
    under_way = threading.Event()

    def watch_and_stop() -> None:
        while homed.stage.position().value < -0.4:
            pass
        under_way.set()
        homed.stage.stop()

    stopper = threading.Thread(target=watch_and_stop)
    stopper.start()
    try:
        with pytest.raises(MotionStopped):
            homed.stage.oscillate(10.0, 3.0, 0.3, 10.0)
    finally:
        stopper.join(20.0)
    assert under_way.is_set()
    assert at_rest(homed)


def test_a_stage_stopped_before_goes_on_when_told(homed: Backend) -> None:
    homed.stage.stop()
    homed.stage.move_to(0.5)
    assert homed.stage.position().value == pytest.approx(0.5, abs=2e-3)
