"""Runs in an order, and at times, that show what slow noise hides: their promise, and that they are made so."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl import planning, runner
from rigctl.campaign.store.store import Store
from rigctl.composition import study_of
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.observe.set_points import ROOM_S
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.files.campaign_file import parse_campaign
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.hidden import HiddenInNoise
from rigctl.workbench.next.courses import revealing
from rigctl.workbench.next.imagined import Imagined, joint_noise
from rigctl.workbench.next.information import Information
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.next.rig_time import total_s
from rigctl.workbench.next.triangle import triangle_of
from rigctl.workbench.study import Course, Proposal, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.kernels import SlowNoise
from tests.flag_scan import flown

TERMS = (Term("roll-gravity"), Term("resonance"))
DRIFT = Term("bias-drift")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("courses"), "\n[world.temperature]\ndaily_k = 3.0\n")


@pytest.fixture(scope="module")
def study(path: Path) -> SensingAxisStudy:
    found = study_of(Store.open(path, readonly=True))
    assert isinstance(found, SensingAxisStudy)
    return found


@pytest.fixture(scope="module")
def attempt(study: SensingAxisStudy) -> Attempt:
    """With flicker noise, as strong as the white noise at one run in ten, as the law of the means."""
    plain = Attempt(study, TERMS)
    given = plain.model.observations
    where = np.flatnonzero(np.array([pool.dof <= 0.0 for pool in given.pools])[given.pool_of])
    at = given.of_runs("start_s")[where]
    slow = SlowNoise(where, "start_s", (("power 1", 10.0),), (float(np.min(np.diff(np.sort(at)))), float(np.ptp(at))))
    factor = np.linalg.cholesky(slow.correlation(at))
    noise = replace(plain.noise, factors=((where, factor),), slow=(slow,))
    plain.noise = noise
    return plain


def course(study: SensingAxisStudy, kind: str, runs: int | None = None) -> Course:
    return next(each for each in study.courses() if each.kind == kind and (runs is None or len(each.runs) == runs))


def covariance(attempt: Attempt, study: SensingAxisStudy, runs: tuple[Proposal, ...]) -> FloatArray:
    """Of all data, made and imagined, element by element."""
    given, made = study.extended(runs).model(TERMS).observations, attempt.model.observations
    (slow,) = attempt.noise.slow
    at, dc = given.of_runs("start_s"), np.array([pool.dof <= 0.0 for pool in given.pools])[given.pool_of]
    scale = float(np.median(attempt.noise.sigma[slow.where] / made.sigma[slow.where]))
    sigma = np.concatenate([attempt.noise.sigma, given.sigma[len(made.value) :]])
    new = np.arange(len(sigma)) >= len(made.value)
    for pool in {each.name for each in given.pools}:
        rows = np.array([each.name == pool for each in given.pools])[given.pool_of]
        old = [each.name == pool for each in made.pools]
        ratio = (attempt.noise.sigma / made.sigma)[np.array(old)[made.pool_of]]
        sigma[rows & new] *= float(np.median(ratio)) if len(ratio) else 1.0
    assert scale > 0.0
    found = np.eye(len(sigma))
    found[np.ix_(dc, dc)] = slow.correlation(at[dc])
    return np.asarray(found * np.outer(sigma, sigma))


def test_imagined_data_are_correlated_with_those_there_are_by_the_same_law(
    study: SensingAxisStudy, attempt: Attempt
) -> None:
    runs = course(study, "repeats against time").runs
    whole = study.extended(runs).model(TERMS).observations
    made = attempt.model.observations
    noise = joint_noise(attempt.noise, made, whole)
    white = noise.whiten(noise.whiten(covariance(attempt, study, runs)).T)
    np.testing.assert_allclose(white, np.eye(len(white)), atol=1e-6)
    some = np.random.default_rng(1).standard_normal(len(whole.value)) * whole.sigma
    there = len(made.value)
    np.testing.assert_allclose(noise.whiten(some)[:there], attempt.noise.whiten(some[:there]), rtol=1e-9, atol=1e-9)


def test_what_a_course_promises_is_the_noncentrality_of_generalised_least_squares(
    study: SensingAxisStudy, attempt: Attempt
) -> None:
    runs = course(study, "repeats against time").runs
    imagined = Imagined(study, attempt, runs, course=True)
    rate = np.array([1e-7])
    information = Information(triangle_of(imagined, [DRIFT]))
    for run in range(len(runs)):
        information.add(run)
    asked = information.asked(Question(DRIFT, None, rate, "if-white"))
    assert asked is not None
    (promised,) = information.noncentralities([asked])
    extended = study.extended(runs)
    model = extended.model(TERMS)
    values = np.array([attempt.values[each.name] for each in model.parameters])
    weight = np.linalg.inv(covariance(attempt, study, runs))
    free = model.jacobian(values)
    candidate = next(each for each in extended.candidates(model, values)[0] if each.term == DRIFT)
    effect = candidate.derivative @ rate
    beliefs = [0.0 if each.prior is None else each.prior.sigma**-2 for each in model.parameters]
    scale = 1.0 / np.sqrt(np.diag(free.T @ weight @ free))
    normal = (free * scale).T @ weight @ (free * scale) + np.diag(np.array(beliefs) * scale**2)
    along = (free * scale).T @ weight @ effect
    left = effect @ weight @ effect - along @ np.linalg.solve(normal, along)
    assert promised == pytest.approx(left, rel=1e-3)


def test_each_run_begins_when_the_one_before_is_over_and_its_waiting_too(study: SensingAxisStudy) -> None:
    for each in study.courses():
        starts = [float(run.settings["start_s"]) for run in each.runs]
        for (before, after), run in zip(itertools.pairwise(starts), each.runs[1:], strict=True):
            # All runs are of one length: what one takes, the waiting before it included, is when it begins.
            assert run.takes_s == pytest.approx(after - before, abs=0.2)
            room_s = ROOM_S if run.takes_s > ROOM_S else 0.0
            assert run.takes_s - room_s - float(run.settings.get("wait_s", 0.0)) < 60.0
    rooms = course(study, "alternation of the room", 12)
    asked = [run.settings["temperature_c"] for run in rooms.runs]
    cold, warm = asked[0], asked[3]
    assert asked == [cold] * 3 + [warm] * 3 + [cold] * 3 + [warm] * 3
    # Each return of the room costs its hour.
    assert total_s(rooms.runs) > 4 * ROOM_S


def test_where_the_room_warms_steadily_the_room_is_alternated(study: SensingAxisStudy, attempt: Attempt) -> None:
    hidden = HiddenInNoise(DRIFT, "start_s", 0.5, 1e-4, {"rate[X]": 4e-7}, {"rate[X]": 2e-7}, {"rate[X]": "V/s"})
    found = revealing(study, attempt, [hidden], 0.01, None)
    assert found is not None
    assert found.course.kind == "alternation of the room"
    (answer,), (size,) = found.answers, found.sizes
    assert answer.lambda_now < 1.0
    assert answer.power > 0.95
    assert size.promised["rate[X]"] < 2e-7 < size.if_repeated["rate[X]"]


def test_the_rig_waits_as_long_as_a_course_says_and_keeps_its_order(path: Path, study: SensingAxisStudy) -> None:
    with Store.open(path) as store:
        first = study.courses()[0].runs[1].settings
        runs = [
            Proposal({**first, "theta_deg": angle, "wait_s": wait}) for angle, wait in ((20.0, 0.0), (-0.8, 700.0))
        ]
        text = planning.campaign_text(store, runs, "next", path, [term.effect for term in TERMS])
    runner.extend(path, parse_campaign(text, path.with_name("next.toml")), runner.Options(unattended=True))
    with Store.open(path, readonly=True) as store:
        before, after = store.runs()[-2:]
        assert [round(run.conditions["theta_deg"], 1) for run in (before, after)] == [20.0, -0.8]
        assert 700.0 < after.conditions["start_s"] - before.conditions["start_s"] < 760.0


def test_next_proposes_the_course_and_says_what_it_promises(study: SensingAxisStudy) -> None:
    hidden = HiddenInNoise(DRIFT, "start_s", 0.5, 1e-4, {"rate[X]": 4e-7}, {"rate[X]": 2e-7}, {"rate[X]": "V/s"})
    found = Diagnosis("adequate", 0.01, TERMS, (), (), (), None, {}, (), 30.0, hidden_in_slow_noise=(hidden,))
    advice = recommend(study, TERMS, found)
    document = advice.as_json()
    assert (advice.purpose, document["course"]) == ("reveal", "alternation of the room")
    assert advice.runs == course(study, "alternation of the room", len(advice.runs)).runs
    (promise,), (size,) = document["promises"], document["smallest_detectable"]
    assert (promise["effect"], promise["from"], promise["size"]) == ("bias-drift", "slow noise", "if-white")
    assert promise["lambda"] > 20.0 > promise["lambda_now"]
    assert size["promised"]["rate[X]"] < size["now"]["rate[X]"]
    assert "as alternation of the room, in this order, would show what slow noise may hide" in advice.words
    # Whoever offers runs chooses among them, at any time.
    assert recommend(study, TERMS, found, offered=study.options()[:20]).course is None
