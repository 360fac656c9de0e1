"""The room: its own course, and where the operator brings it."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.worlds.bench_settings import TemperatureSettings
from simulators.worlds.temperature import Room


def test_left_alone_it_follows_the_sun_and_drifts() -> None:
    room = Room(TemperatureSettings(mean_c=20.0, daily_k=0.5, drift_k_per_day=0.1))
    day = 86400.0
    assert room.temperature_c(np.array([0.0, day / 4, day])) == pytest.approx([20.0, 20.525, 20.1])


def test_brought_somewhere_it_is_there_when_that_is_done_and_stays() -> None:
    room = Room(TemperatureSettings(mean_c=20.0, daily_k=0.0, drift_k_per_day=0.0, room_s=600.0))
    assert room.bring_to(24.0, 100.0) == 700.0
    assert room.temperature_c(np.array([0.0, 100.0, 400.0, 700.0, 5000.0])) == pytest.approx([20, 20, 22, 24, 24])
    assert room.warmer_k(np.array([5000.0])) == pytest.approx([4.0])


def test_brought_elsewhere_on_the_way_it_turns_from_where_it_is() -> None:
    room = Room(TemperatureSettings(mean_c=20.0, daily_k=0.0, drift_k_per_day=0.0, room_s=600.0))
    room.bring_to(24.0, 0.0)
    room.bring_to(20.0, 300.0)
    assert room.temperature_c(np.array([150.0, 300.0, 600.0, 900.0])) == pytest.approx([21, 22, 21, 20])
