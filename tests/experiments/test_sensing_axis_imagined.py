"""Runs that could be made: they tell what runs that were made tell, and stay within what the bench allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.campaign.store.store import Store
from rigctl.composition import allowed_by_rig
from rigctl.experiments.sensing_axis.observe import set_points
from rigctl.experiments.sensing_axis.observe.set_points import ROOM_S
from rigctl.experiments.sensing_axis.observe.store_reduction import reduction
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.study import Plannable, Proposal, Term
from rigctl.workbench.verdict.attempt import Attempt
from tests.flag_scan import flown

TERMS = (Term("roll-gravity"), Term("resonance"))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store.open(flown(tmp_path_factory.mktemp("imagined")))


@pytest.fixture(scope="module")
def study(store: Store) -> SensingAxisStudy:
    return SensingAxisStudy(store)


@pytest.fixture(scope="module")
def attempt(study: SensingAxisStudy) -> Attempt:
    return Attempt(study, TERMS)


def as_made(store: Store) -> list[Proposal]:
    """The runs of a store as proposals."""
    names = {"theta_asked_deg": "theta_deg", "frequency_hz": "frequency_hz", "amplitude_mm": "amplitude_mm"}
    return [
        Proposal(
            {
                **{ours: run.conditions[theirs] for theirs, ours in names.items()},
                "approach": run.conditions["approach"],
                "dwell_s": 20.0 / 3.0,  # whole periods
                "start_s": run.conditions["start_s"],
                "temperature_c": run.conditions["temperature_c"],
            },
            30.0,
        )
        for run in store.runs()
    ]


def test_an_imagined_run_tells_what_the_same_run_told(
    store: Store, study: SensingAxisStudy, attempt: Attempt
) -> None:
    imagined = Imagined(study, attempt, as_made(store))
    made = len(attempt.model.observations.value)
    assert imagined.fitted.shape[0] == imagined.beliefs + 2 * made
    real, likewise = np.split(imagined.fitted[imagined.beliefs :], 2)
    rows = np.isfinite(attempt.noise.dof) & (attempt.model.observations.pool_of > 0)
    size = np.linalg.norm(real[rows], axis=0)
    seen = size > 1.0  # what only the means know is rounding here
    assert seen.sum() > 8
    assert np.linalg.norm(likewise[rows], axis=0)[seen] == pytest.approx(size[seen], rel=0.05)
    overlap = np.sum(real[rows] * likewise[rows], axis=0)
    assert overlap[seen] / size[seen] ** 2 == pytest.approx(1.0, rel=0.05)


def test_measured_values_and_origins_stay(study: SensingAxisStudy, store: Store, attempt: Attempt) -> None:
    other = study.extended(as_made(store)[:3])
    given, mine = other.model(TERMS).observations, attempt.model.observations
    assert given.run_ids[: len(mine.run_ids)] == mine.run_ids
    assert np.array_equal(given.value[: len(mine.value)], mine.value)
    assert len(given.run_ids) == len(mine.run_ids) + 3
    assert len(study.model(TERMS).observations.run_ids) == len(mine.run_ids)
    assert other.model(TERMS).inner.origins == study.model(TERMS).inner.origins


def test_longer_runs_have_less_noise_but_no_steadier_mean(study: SensingAxisStudy, store: Store) -> None:
    short, long = (Proposal({**as_made(store)[0].settings, "dwell_s": dwell_s}, dwell_s) for dwell_s in (10.0, 40.0))
    given = study.extended([short, long]).model(TERMS).observations
    first, second = (given.sigma[given.run_of == len(given.run_ids) - back] for back in (2, 1))
    ratio = first / second
    assert ratio[0] == pytest.approx(1.0, rel=0.3)
    assert ratio[1:] == pytest.approx(2.0)


def test_options_are_within_the_range_and_the_stages_limits(study: SensingAxisStudy, store: Store) -> None:
    assert isinstance(study, Plannable)
    options = study.options()
    allowed = allowed_by_rig(store)
    assert allowed is not None
    kept = [each for each in options if allowed(each)]
    assert {-20.0, -0.8, 0.8, 20.0} <= {each.settings["theta_deg"] for each in kept}
    assert {0.3, 0.6, 1.0} <= {each.settings["frequency_hz"] for each in kept}
    assert {each.settings["approach"] for each in kept} == {1, -1}
    for each in kept:
        given = each.settings
        w = 2.0 * np.pi * given["frequency_hz"]
        volts = 100.0 * 1e-3 * given["amplitude_mm"] * w**2 * abs(np.sin(np.radians(given["theta_deg"])))
        assert volts < 10.0
        assert each.takes_s > given["dwell_s"]
    assert not allowed(Proposal({**kept[0].settings, "theta_deg": 175.0}))
    assert not allowed(Proposal({**kept[0].settings, "amplitude_mm": 30.0}))


def test_lasers_are_seen_near_the_null_only(study: SensingAxisStudy) -> None:
    settings = {"frequency_hz": 0.6, "amplitude_mm": 5.0, "approach": 1, "dwell_s": 10.0}
    near, far = (Proposal({**settings, "theta_deg": angle}, 25.0) for angle in (1.0, 20.0))
    given = study.extended([near, far]).model(TERMS).observations
    last = len(given.run_ids) - 1
    channels = [{given.series[s].channel for s in given.series_of[given.run_of == run]} for run in (last - 1, last)]
    assert channels[0] == {"accel_v", "laser_1_mm", "laser_2_mm", "laser_3_mm"}
    assert channels[1] == {"accel_v"}


SETTINGS = {"theta_deg": 0.8, "frequency_hz": 0.6, "amplitude_mm": 5.0, "approach": 1, "dwell_s": 10.0}


def conditions(study: SensingAxisStudy, *changes: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Start and temperature of imagined runs."""
    other = study.extended([Proposal({**SETTINGS, **each}, 25.0) for each in changes])
    given = other.model(TERMS).observations.covariates
    return given["start_s"][-len(changes) :], given["temperature_c"][-len(changes) :]


def test_a_room_left_to_itself_tells_temperature_from_time_in_no_run(
    study: SensingAxisStudy, attempt: Attempt
) -> None:
    start_s, temperature_c = conditions(study, {"dwell_s": 10.0}, {"dwell_s": 60.0})
    given = attempt.model.observations.covariates
    slope, level = np.polyfit(given["start_s"], given["temperature_c"], 1)
    assert np.ptp(start_s) == 0.0
    assert np.ptp(temperature_c) == pytest.approx(25.0 * slope)
    # The runs that were made are 6.7 s long.
    assert temperature_c[0] == pytest.approx(level + slope * (start_s[0] + 5.0 - 3.33), abs=1e-6)


def test_rooms_are_gone_to_one_after_the_other(study: SensingAxisStudy) -> None:
    start_s, temperature_c = conditions(study, {}, {"temperature_c": 22.0}, {"temperature_c": 18.0})
    assert start_s - start_s[0] == pytest.approx([0.0, 2.0 * ROOM_S, ROOM_S])
    assert temperature_c[1:].tolist() == [22.0, 18.0]


def test_a_room_is_paid_for_once(study: SensingAxisStudy) -> None:
    rooms = {each.settings.get("temperature_c"): each.sitting for each in study.options()}
    assert rooms.pop(None) == ""
    assert len(set(rooms.values())) == len(rooms) == 2
    assert all(each.sitting_s == (ROOM_S if each.sitting else 0.0) for each in study.options())
    assert max(each.takes_s for each in study.options()) < ROOM_S


def test_nothing_but_the_room_differs(study: SensingAxisStudy) -> None:
    offered = study.options()
    warm = [each.settings for each in offered if "temperature_c" in each.settings]
    assert {each["theta_deg"] for each in warm} == {-20.0, -0.8, 0.8, 20.0}
    assert {each["frequency_hz"] for each in warm} == {0.3, 0.6}
    assert {each["dwell_s"] for each in warm} == {max(each.settings["dwell_s"] for each in offered)}


def test_angles_are_those_of_the_mounting_that_is_there(store: Store) -> None:
    runs = reduction(store, ()).runs
    before = [replace(run, mounting=0, theta_rad=run.theta_rad + 1e-3, start_s=run.start_s - 1e4) for run in runs]
    limits = SensingAxisStudy(store).data.recorded.limits
    angles = {each.settings["theta_deg"] for each in set_points.options([*before, *runs], limits)}
    assert {round(float(np.degrees(run.theta_rad)), 4) for run in runs} <= angles
    assert not {round(float(np.degrees(run.theta_rad)), 4) for run in before} & angles
