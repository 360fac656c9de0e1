"""The Monte Carlo study: the same tables on any number of workers, and after being killed; what it scores."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import LocalCluster

from procedures.inflight import monte_carlo
from procedures.inflight.monte_carlo import Unit
from procedures.inflight.tables import MonteCarlo
from rigctl import results, runner
from rigctl.campaign.origin import truth_path
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, ConfigError, LinkError
from rigctl.core.workers import Workers
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.monte_carlo import DRAW
from rigctl.files.campaign_file import CampaignFile, read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.report.experiments import inflight as inflight_report
from rigctl.rig import Rig
from simulators.worlds.satellite.instrument import drawn
from simulators.worlds.satellite.layout import COLUMNS
from simulators.worlds.satellite.settings import SatelliteSettings

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
SMALL = """\
experiment = "inflight-calibration"
rig = "rig.toml"

[procedure]
name = "monte-carlo"
draws = DRAWS
orbits = 3.0
orbits_ac12 = 3.0
common_hz = 1.2324929971988796e-3
turn_hz = 1.2324929971988796e-3
displacement_hz = 3.0812324929971988e-3
quadratic_hz = 8.963585434173669e-3
workers = 1
"""
QUICK = "seed = 1707\nsettle_s = 3000.0\nsample_period_s = 1.0\nnoise_on = false"
WITHIN = {"m": 2e-8, "rad": 3e-5, "1": 2e-6, "s2/m": 30.0}
"""Of exact truth, without noise, in three orbits; ten do better."""


def prepared(directory: Path, draws: int, more: str = "") -> CampaignFile:
    directory.mkdir(exist_ok=True)
    rig = (CAMPAIGNS / "microscope-rig.toml").read_text().replace("seed = 1707", QUICK)
    (directory / "rig.toml").write_text(rig)
    (directory / "campaign.toml").write_text(SMALL.replace("DRAWS", str(draws)) + more)
    return read_campaign(directory / "campaign.toml")


def studied(directory: Path, draws: int, more: str = "") -> Path:
    campaign, path = prepared(directory, draws, more), directory / "x.rig.sqlite"
    runner.start(campaign, read_rig(campaign.rig_path), path, runner.Options(unattended=True))
    return path


@pytest.fixture(scope="module")
def noted_study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A study of two batches on one worker, and in which order its sessions were taken and its draws scored."""
    done: list[str] = []

    def noted(patch: pytest.MonkeyPatch, name: str, what: str) -> None:
        doing = getattr(monte_carlo, name)

        def both(*arguments: Any, **more: Any) -> Any:
            done.append(what)
            return doing(*arguments, **more)

        patch.setattr(monte_carlo, name, both)

    with pytest.MonkeyPatch.context() as patch:
        noted(patch, "reduce_unit", "session")
        noted(patch, "estimated", "score")
        return studied(tmp_path_factory.mktemp("alone"), 18), done


@pytest.fixture(scope="module")
def alone(noted_study: tuple[Path, list[str]]) -> Path:
    return noted_study[0]


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two draws on one worker, with the samples of another."""
    return studied(tmp_path_factory.mktemp("few"), 2, "kept_draw = 17\n")


def scored(path: Path) -> list[dict[str, Any]]:
    with Store.open(path, readonly=True) as store:
        return [document.data for document in store.documents(DRAW)]


def unseen(draw: dict[str, Any], name: str) -> float:
    """What no session sees of the star tracker's bias s and of the coupling eta: -s_z - eta_z and s_y - eta_y / 2."""
    nature = SatelliteSettings(kind="drag-free-satellite", seed=1707)
    instrument = drawn(nature, draw["draw"])
    _, y, z = instrument.tracker_bias_rad
    _, eta_y, eta_z = instrument.eta_rad.mean(axis=0)
    return float({"ac12_rad": -z - eta_z, "ac13_rad": y - 0.5 * eta_y}.get(name, 0.0))


def test_every_draw_is_scored_once_against_both_truths(alone: Path) -> None:
    draws = scored(alone)
    assert [draw["draw"] for draw in draws] == list(range(18))
    found = results.of(alone)
    assert found["draws"] == 18
    assert list(found["table2"]) == list(NAMES)
    for name, row in found["table2"].items():
        off = np.array(
            [d["estimates"]["joint"][name] - d["truths"]["exact_truth"][name] - unseen(d, name) for d in draws]
        )
        assert np.abs(off).max() < WITHIN[row["unit"]], name
        errors = [abs(d["estimates"]["paper"][name] - d["truths"]["paper_truth"][name]) for d in draws]
        assert row["paper"]["paper_truth"]["worst"] == pytest.approx(max(errors), rel=1e-6, abs=0.0)
        assert row["paper"]["paper_truth"]["mean"] == pytest.approx(np.mean(errors), rel=1e-6, abs=0.0)
    # What the paper's formulas leave out is what its truth is off by.
    k2c = found["table2"]["k2c_s2_m"]["paper"]
    assert k2c["paper_truth"]["mean"] > 3.0 * k2c["exact_truth"]["mean"]


def test_the_status_counts_the_sessions_of_all_draws(alone: Path) -> None:
    status = status_of(alone)
    assert (status["state"], status["runs_done"], status["runs_planned"]) == ("done", 198, 198)


def test_nature_s_secrets_stay_beside_the_store_and_only_scores_are_in_it(alone: Path) -> None:
    assert "seed = 1707" in truth_path(alone).read_text()
    with Store.open(alone, readonly=True) as store:
        assert "seed = 1707" not in str(store.header)
        assert not store.runs()


@pytest.fixture(params=["processes", "dask"])
def place(request: pytest.FixtureRequest) -> Iterator[tuple[Workers, Callable[[], int]]]:
    """Two workers, and the process of one of them."""
    if request.param == "processes":
        yield Workers(2), lambda: int(multiprocessing.active_children()[0].pid or 0)
        return
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        yield Workers(scheduler=cluster.scheduler_address), lambda: int(next(iter(cluster.workers.values())).pid)


def test_two_workers_one_of_them_killed_find_what_one_finds(
    few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: tuple[Workers, Callable[[], int]]
) -> None:
    workers, one_of_them = place
    keep, killed = Store.keep_reductions, []

    def keep_and_kill(store: Store, *arguments: Any) -> None:
        keep(store, *arguments)
        if len(store.reduced_names(str(monte_carlo.RECIPE))) == 4:
            killed.append(one_of_them())
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(Store, "keep_reductions", keep_and_kill)
    campaign, path = prepared(tmp_path / "two", 2), tmp_path / "two" / "x.rig.sqlite"
    options = runner.Options(unattended=True, workers=workers)
    runner.start(campaign, read_rig(campaign.rig_path), path, options)
    assert len(killed) == 1
    assert json.dumps(scored(path)) == json.dumps(scored(few))


def test_killed_at_any_unit_a_study_goes_on_to_the_same_scores(few: Path, tmp_path: Path) -> None:
    campaign, path = prepared(tmp_path / "killed", 2), tmp_path / "killed" / "x.rig.sqlite"
    child = os.fork()
    if not child:
        keep = Store.keep_reductions

        def keep_five(store: Store, *arguments: Any) -> None:
            keep(store, *arguments)
            if len(store.reduced_names(str(monte_carlo.RECIPE))) == 5:
                os.kill(os.getpid(), signal.SIGKILL)

        try:
            Store.keep_reductions = keep_five  # type: ignore[method-assign]
            runner.start(campaign, read_rig(campaign.rig_path), path, runner.Options(unattended=True))
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert status_of(path)["state"] == "interrupted"
    with Store.open(path) as store:
        before = store.reduced_names(str(monte_carlo.RECIPE))
    assert len(before) == 5
    runner.resume(path, runner.Options(unattended=True))
    assert json.dumps(scored(path)) == json.dumps(scored(few))


def test_the_chosen_draw_keeps_its_samples(few: Path) -> None:
    simulation = Rig(read_rig(few.parent / "rig.toml")).simulation
    assert simulation is not None
    ensemble, asked = simulation.world.ensemble(), MonteCarlo(name="monte-carlo")
    with Store.open(few, readonly=True) as store:
        runs = store.runs()
        assert [run.conditions["session"] for run in runs] == list(asked.sessions)
        for number in (1, 6):
            session = asked.session(asked.sessions[number - 1], 5950.0)
            stimulus = replace(session.stimulus, frequency_hz=runs[5].conditions["calibration_frequency_hz"])
            flown = replace(session, stimulus=stimulus if number == 6 else session.stimulus)
            telemetry = next(ensemble.telemetry((3, 17), number, flown, 500))[:, :, 1]
            kept = store.samples(runs[number - 1].run_id)
            # Gravity is kept of sessions of the test alone, which a calibration has none of.
            assert set(ensemble.columns) - set(kept) == {"g_x", "g_y", "g_z"}
            for place, name in enumerate(ensemble.columns):
                assert name not in kept or np.array_equal(kept[name][:500], telemetry[:, place]), name


def test_missions_find_the_violation_that_is_hidden_with_what_was_calibrated(tmp_path: Path) -> None:
    sessions = json.dumps([*MonteCarlo(name="monte-carlo").sessions, "ep_inertial", "ep_spin"])
    study = prepared(tmp_path, 3, f"sessions = {sessions}\norbits_ep = 8.0\n")
    with (tmp_path / "rig.toml").open("a") as rig:
        rig.write("\neotvos = 1e-12\n")
    path = tmp_path / "x.rig.sqlite"
    runner.start(study, read_rig(study.rig_path), path, runner.Options(unattended=True))
    found = results.of(path)
    assert found["draws"] == 3
    assert set(found["test"]) == {"ep_inertial", "ep_spin"}
    for session in found["test"].values():
        # 1e-16 is left of a_c12's and a_c13's unseen part, a thousandth of delta of a_c11.
        assert session["error"]["rms"] < 3e-15
    # Uncorrected, Dx alone makes up to 1e-14.
    assert found["test"]["ep_inertial"]["uncorrected"]["rms"] > 3e-15
    row = found["test"]["ep_inertial"]["rows"]["ac11_dx_m"]
    assert row["at_bound_m_s2"] == pytest.approx(row["printed_before_m_s2"], rel=0.05, abs=0.0)


@pytest.mark.parametrize(
    ("more", "world", "error", "says"),
    [
        ('sessions = ["dx", "dz"]\n', "", ConfigError, "a study scores all ten parameters; add sessions dy, ac12"),
        ("", "[world.missing]\nfraction = 0.1\n", ConfigError, "a study reduces samples as they come, without gaps"),
        ("draws = 0\n", "", ConfigError, "procedure.draws"),
    ],
)
def test_a_study_that_cannot_be_is_refused(
    tmp_path: Path, more: str, world: str, error: type[Exception], says: str
) -> None:
    prepared(tmp_path, 18)
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(
        text.replace("draws = 18\n", "") + more if "draws" in more else text + more
    )
    with (tmp_path / "rig.toml").open("a") as rig:
        rig.write(f"\n{world}")
    with pytest.raises(error) as refused:
        runner.dry_run(read_campaign(tmp_path / "campaign.toml"), read_rig(tmp_path / "rig.toml"))
    assert says in str(refused.value)


def test_errors_are_seen_before_the_study_is_over(noted_study: tuple[Path, list[str]]) -> None:
    """The first sixteen draws are scored before a session of the two others is taken."""
    path, done = noted_study
    sessions = ["session"] * (done.index("score"))
    assert done == [*sessions, *["score"] * 16, *sessions, *["score"] * 2]
    with Store.open(path, readonly=True) as store:
        (largest,) = inflight_report.progress(store)
    published, joint = largest.lines
    assert list(published.x) == list(joint.x) == list(range(18))
    table2 = results.of(path)["table2"]
    worst = max(row["joint"]["paper_truth"]["worst"] / row["objective"] for row in table2.values())
    assert joint.y.max() == pytest.approx(worst)


def test_a_scheduler_that_is_not_there_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.core.workers.ANSWERS_S", 0.5)
    with pytest.raises(LinkError) as refused:
        studied(tmp_path / "nowhere", 2, 'scheduler = "tcp://127.0.0.1:9"\n')
    assert "no scheduler answers at tcp://127.0.0.1:9" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_ensemble_travels_to_another_process() -> None:
    simulation = Rig(read_rig(CAMPAIGNS / "microscope-rig.toml")).simulation
    assert simulation is not None
    ensemble = simulation.world.ensemble()
    travelled = pickle.loads(pickle.dumps(ensemble))
    assert travelled.truths(3) == ensemble.truths(3)
    session = MonteCarlo(name="monte-carlo").session("dx", 5950.0)
    here, there = (next(one.telemetry((3,), 1, session, 10)) for one in (ensemble, travelled))
    assert np.array_equal(here, there)


class Slow:
    """An ensemble that sends down sample by sample."""

    at_once, columns, sample_period_s, complete = 1, COLUMNS, 1.0, True

    def telemetry(self, draws: Any, run: int, session: Any, chunk: int) -> Iterator[Any]:
        for _ in range(round(session.duration_s)):
            yield np.zeros((1, len(self.columns), len(draws)))


def test_who_aborts_a_study_does_not_wait_for_what_is_under_way() -> None:
    asked = 0

    def going_on() -> None:
        nonlocal asked
        asked += 1
        if asked == 3:
            raise Aborted("enough")

    unit = Unit(Slow(), MonteCarlo(name="monte-carlo", orbits=3.0), 5950.0, "dx", 1, (0,))  # type: ignore[arg-type]
    with pytest.raises(Aborted):
        monte_carlo.reduce_unit(unit, going_on)
    assert asked == 3


def test_workers_are_for_studies_and_stand_in_one_place(desk: Any) -> None:
    both = "--workers counts processes of this machine, --scheduler names another's: leave one out"
    desk.run("--workers", 2, "--scheduler", "tcp://127.0.0.1:9").refused(2, both)
    desk.run("--workers", 2).refused(2, "instruments do the work of this campaign; leave out --workers")
    assert desk.left == set()
