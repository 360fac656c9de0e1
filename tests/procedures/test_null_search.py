"""The null search on a twin, over the wire, against nature's null."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from procedures.sensing_axis.bench import Bench, SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting
from procedures.sensing_axis.null_search import NullSearch, NullSearchSettings
from rigctl.analysis.plane import ARCSEC
from rigctl.core.errors import LimitError, ProcedureError
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run

SETTINGS = NullSearchSettings(
    frequencies_hz=(0.3, 0.5, 0.6), amplitude_mm=5.0, sample_rate_hz=100.0, theta0_sigma_arcsec=2.0
)
EFFECTS = chosen("sensing-axis", ["roll-gravity", "resonance"])


def search(
    twin: Any, mounting: Mounting, settings: NullSearchSettings = SETTINGS, effects: Any = EFFECTS
) -> NullSearch:
    fixture = Fixture(twin.session, twin.bench)
    fixture.mount(mounting)
    return NullSearch(twin.session, twin.bench, fixture, mounting, settings, effects)


@pytest.mark.parametrize(("axis", "configuration"), [("X", "pendulum"), ("Y", "flag"), ("Z", "pendulum")])
def test_the_null_is_found_within_its_sigma(make_twin: Callable[..., Any], axis: str, configuration: str) -> None:
    twin = make_twin(seed=5)
    null = search(twin, Mounting(axis, configuration, 1)).find()
    assert null.theta0_sigma_rad <= 2.0 * ARCSEC
    error_rad = null.theta0_rad - np.radians(twin.theta0_deg)
    assert abs(error_rad) < 4.0 * null.theta0_sigma_rad


def test_a_tighter_target_takes_more_time_and_is_met(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=6)
    coarse = search(twin, Mounting("X", "flag", 1))
    coarse.find()
    fine = search(twin, Mounting("X", "flag", 2), replace(SETTINGS, theta0_sigma_arcsec=1.0))
    null = fine.find()
    assert null.theta0_sigma_rad <= 1.0 * ARCSEC
    seconds = [sum(run.duration_s for run in each.runs) for each in (coarse, fine)]
    # Four times less variance; the first, coarse runs and whole periods are common to both.
    assert 2.0 < seconds[1] / seconds[0] < 6.0


def test_only_the_outermost_frequencies_are_used_and_the_highest_alone_without_roll(
    make_twin: Callable[..., Any],
) -> None:
    twin = make_twin(seed=7, effects={})
    with_roll = search(twin, Mounting("X", "flag", 1))
    with_roll.find()
    assert {round(run.frequency_hz, 2) for run in with_roll.runs} == {0.3, 0.6}
    without = search(twin, Mounting("X", "flag", 2), effects=chosen("sensing-axis", ["resonance"]))
    null = without.find()
    assert {round(run.frequency_hz, 2) for run in without.runs} == {0.6}
    assert abs(null.theta0_rad - np.radians(twin.theta0_deg)) < 4.0 * null.theta0_sigma_rad


def test_a_start_where_the_lasers_miss_the_cube_is_refused_before_anything_moves(
    make_twin: Callable[..., Any],
) -> None:
    twin = make_twin(seed=8)
    with pytest.raises(LimitError, match=r"spot leaves the 15 mm cube"):
        search(twin, Mounting("X", "pendulum", 1), replace(SETTINGS, start_deg=2.5)).find()
    assert twin.store.runs() == []
    assert twin.bench.rotation.angle().value == 0.0


def test_a_loud_room_is_not_searched_for_ever(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=9, ground={"asd_m_s2_rthz": 3e-5})
    impatient = replace(SETTINGS, theta0_sigma_arcsec=0.5, max_run_s=10.0)
    with pytest.raises(ProcedureError, match="is the room quiet"):
        search(twin, Mounting("X", "pendulum", 1), impatient).find()


def test_the_plain_scan_is_displaced_by_roll_and_the_search_is_not(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=10)
    mounting = Mounting("Y", "pendulum", 1)
    null = search(twin, mounting).find()
    truth_rad = np.radians(twin.theta0_deg)

    fixture = Fixture(twin.session, twin.bench)
    fixture.mount(mounting)
    angles = [round(twin.theta0_deg + x, 4) for x in np.linspace(-0.02, 0.02, 9)]
    records = [
        twin.bench.run(
            twin.session,
            f"{theta_deg:g} deg",
            SetPoint("Y", "pendulum", 1, theta_deg, 0.3, 5.0, 40.0, 100.0),
            before=lambda: fixture.confirm(mounting),
        )
        for theta_deg in angles
    ]
    runs = observables([reduce_run(r.run_id, r.conditions, twin.store.samples(r.run_id)) for r in records])
    displacement = -9.7e-5 * 9.803 / (2 * np.pi * 0.3) ** 2
    volts_per_rad = 59.7 * runs[0].peak_acceleration_m_s2
    sigma_rad = np.mean([run.accel_v.sigma[1] for run in runs]) / volts_per_rad / np.sqrt(len(runs))
    assert sigma_rad < 2 * ARCSEC
    slope, offset = np.polyfit([run.theta_rad for run in runs], [run.accel_v.value[1].real for run in runs], 1)
    assert -offset / slope - truth_rad == pytest.approx(displacement, abs=4 * sigma_rad)
    assert abs(displacement) > 50 * ARCSEC
    assert abs(null.theta0_rad - truth_rad) < 8 * ARCSEC


def test_every_null_is_approached_from_below(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=12)
    moves: list[float] = []
    bench: Bench = twin.bench
    move_to = bench.rotation.move_to
    bench.rotation.move_to = lambda angle_deg: (moves.append(angle_deg), move_to(angle_deg))[1]  # type: ignore[method-assign]
    search(twin, Mounting("X", "pendulum", 1)).find()
    stops = [run.conditions["theta_asked_deg"] for run in twin.store.runs()]
    for stop in dict.fromkeys(stops):
        at = moves.index(stop)
        assert at > 0
        assert moves[at - 1] < stop
