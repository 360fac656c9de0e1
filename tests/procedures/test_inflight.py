"""The ten sessions on the simulated satellite: what is recorded, resumed, refused, and found to be wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from procedures.inflight.bench import Flight, flight_of
from procedures.inflight.calibration import calibrate, check
from procedures.inflight.tables import TEN, Calibration
from procedures.inflight.telemetry import on_grid
from rigctl import runner
from rigctl.campaign.bundle.bundle import read_bundle, write_bundle
from rigctl.campaign.recording import Header
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, ConfigError, ImplausibleSample, LimitError, LinkLost
from rigctl.core.satellites import DragFreeSatellite, FlightSession, Stimulus
from rigctl.files.campaign_file import parse_campaign, read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig
from rigctl.serving import Served

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
SHORT = Calibration(
    sessions=("dx", "ad11"), orbits=0.3, common_hz=5.0 / (0.3 * 5950.0), displacement_hz=5.5e-3, quadratic_hz=9e-3
)


@dataclass
class InOrbit:
    rig: Rig
    flight: Flight
    store: Store
    control: Control

    def session(self) -> Session:
        operator = Operator(self.rig.operator_link)
        return Session(self.store, self.rig.clock, operator, self.control, Progress(self.store))


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Callable[..., InOrbit]]:
    with ExitStack() as stack:

        def make(name: str = "one", faults: Any = None, **world: Any) -> InOrbit:
            file = read_rig(CAMPAIGNS / "microscope-rig.toml")
            assert file.world is not None
            satellite = file.instruments["satellite"].model_copy(update={"faults": faults or {}})
            file = file.model_copy(update={"instruments": {"satellite": satellite}})
            nature = {**file.world, "settle_s": 500.0, **world}
            rig = stack.enter_context(Rig(file.model_copy(update={"world": nature})))
            path = tmp_path / f"{name}.rig.sqlite"
            header = Header("inflight-calibration")
            store = stack.enter_context(Store.open(path) if path.exists() else Store.create(path, header))
            return InOrbit(rig, flight_of(rig), store, Control(rig.stop, lambda: None))

        yield make


def recorded(store: Store) -> dict[str, dict[str, np.ndarray]]:
    return {run.key: store.samples(run.run_id) for run in store.runs()}


def test_the_satellite_meets_its_interface(launch: Callable[..., InOrbit]) -> None:
    assert isinstance(launch().flight.satellite, DragFreeSatellite)


def test_a_calibration_takes_140_orbits_and_each_session_injects_its_own() -> None:
    calibration = Calibration()
    assert sum(calibration.orbits_of(name) for name in TEN) == 140.0
    for name in TEN:
        told, stimulus = calibration.conditions(name, 0.25), calibration.stimulus(name)
        if name in {"dx", "dz"}:
            assert "amplitude" not in told
            continue
        cycles = stimulus.frequency_hz * calibration.orbits_of(name) * 5950.0
        assert cycles == pytest.approx(round(cycles), abs=1e-9)
        assert round(cycles / calibration.orbits_of(name) * 10.0) % 10, "no multiple of the orbit's frequency"
        assert told["amplitude"] == stimulus.amplitude > 0.0


def test_one_run_per_session_with_what_was_injected(launch: Callable[..., InOrbit]) -> None:
    orbit = launch()
    calibrate(orbit.session(), orbit.flight, SHORT)
    dx, ad11 = orbit.store.runs()
    assert dx.conditions == {"session": "dx", "orbits": 0.3, "sample_period_s": 0.25, "start_s": 5950.0}
    assert ad11.conditions["amplitude_unit"] == "m/s2"
    assert ad11.conditions["calibration_frequency_hz"] == SHORT.common_hz
    samples = orbit.store.samples(ad11.run_id)
    t_s = samples["t_s"]
    assert np.array_equal(t_s, 0.25 * np.arange(7140))
    common = 0.5 * (samples["m1_x"] + samples["m2_x"])
    injected = 2.0 * np.mean(common * np.exp(-2j * np.pi * SHORT.common_hz * t_s))
    assert injected == pytest.approx(5e-8, rel=0.03)


def test_a_session_begins_at_a_perigee_after_the_loops_have_settled(launch: Callable[..., InOrbit]) -> None:
    orbit = launch(settle_s=6000.0)
    calibrate(orbit.session(), orbit.flight, SHORT)
    starts = [run.conditions["start_s"] / 5950.0 for run in orbit.store.runs()]
    assert starts == [2.0, 4.0]


def test_an_aborted_calibration_goes_on_to_the_same_samples(launch: Callable[..., InOrbit]) -> None:
    whole = launch("whole")
    calibrate(whole.session(), whole.flight, SHORT)
    begun = launch("begun")

    class Impatient(Session):
        def checkpoint(self) -> None:
            if len(self.store.runs()) == 1:
                raise Aborted("enough")

    operator = Operator(begun.rig.operator_link)
    impatient = Impatient(begun.store, begun.rig.clock, operator, begun.control, Progress(begun.store))
    with pytest.raises(Aborted):
        calibrate(impatient, begun.flight, SHORT)
    again = launch("begun")
    calibrate(again.session(), again.flight, SHORT)
    for key, columns in recorded(whole.store).items():
        for name, column in columns.items():
            assert np.array_equal(column, recorded(again.store)[key][name]), (key, name)


def test_lost_telemetry_is_nan_and_the_run_is_valid(launch: Callable[..., InOrbit]) -> None:
    orbit = launch(missing={"fraction": 0.05, "burst_s": 20.0})
    calibrate(orbit.session(), orbit.flight, SHORT)
    run = orbit.store.runs()[0]
    samples = orbit.store.samples(run.run_id)
    lost = np.isnan(samples["m1_x"])
    assert run.valid
    assert 0.05 <= lost.mean() < 0.08
    assert np.array_equal(lost, np.isnan(samples["att_y"]))
    assert np.isfinite(samples["t_s"]).all()


@pytest.mark.parametrize(
    ("loops", "says"),
    [
        ({"drag_free_rad_s": 100.0}, "m1_x leaves its range of 1e-06 m/s2 at t_s "),
        ({"attitude_damping": -1.0}, "nothing comes down from t_s 0 on: telemetry is lost, or the satellite tumbles"),
    ],
)
def test_a_loop_that_does_not_hold_is_said_and_the_other_sessions_follow(
    launch: Callable[..., InOrbit], loops: dict[str, float], says: str
) -> None:
    orbit = launch(loops=loops, settle_s=6000.0)
    calibrate(orbit.session(), orbit.flight, SHORT)
    runs = orbit.store.runs()
    assert [run.valid for run in runs] == [False, False]
    assert says in runs[0].reason


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (
            {"common_m_s2": 1e-6},
            LimitError,
            "session ad11: satellite: a common acceleration of 1e-06 m/s2 is refused",
        ),
        ({"common_hz": 0.5}, LimitError, "session ad11: satellite: a common acceleration at 0.5 Hz is refused"),
        ({"common_hz": 3.0 / 5950.0, "orbits": 10.0}, ConfigError, "is a line of the orbit (3 f_orb)"),
        ({"common_hz": 1e-4, "orbits": 0.3}, ConfigError, "is less than one period of its stimulus; record longer"),
    ],
)
def test_what_the_satellite_or_the_analysis_cannot_do_is_refused(
    launch: Callable[..., InOrbit], change: dict[str, Any], error: type[Exception], says: str
) -> None:
    orbit = launch()
    with pytest.raises(error) as refused:
        check(orbit.flight, SHORT.model_copy(update=change))
    assert says in str(refused.value)
    assert not orbit.store.runs()


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (
            "orbits = 3",
            "procedure.orbits: 3 orbits of session dx are too few to tell its lines apart; take at least 6",
        ),
        ("orbits_ac12 = 5.9", "procedure.orbits_ac12: 5.9 orbits of session ac12 are too few"),
        ('sessions = ["ep_spin"]\norbits_ep = 7.0', "procedure.orbits_ep: 7 orbits of session ep_spin are too few"),
    ],
)
def test_sessions_that_no_result_could_use_are_refused(asked: str, says: str) -> None:
    campaign = parse_campaign(f"{(CAMPAIGNS / 'microscope.toml').read_text()}{asked}\n", Path("c.toml"))
    with pytest.raises(ConfigError) as refused:
        runner.dry_run(campaign, read_rig(CAMPAIGNS / "microscope-rig.toml"))
    assert str(refused.value).startswith(f"c.toml: {says}")
    assert len(str(refused.value).splitlines()) == 1


def test_a_stimulus_without_a_whole_number_of_periods_is_remarked_on(launch: Callable[..., InOrbit]) -> None:
    orbit = launch()
    (remark,) = check(orbit.flight, SHORT.model_copy(update={"common_hz": 3.1e-3}))
    assert remark.startswith("session ad11: 5.534 periods of the stimulus are no whole number")
    assert check(orbit.flight, SHORT) == []


def test_a_satellite_is_not_served_and_says_who_it_is(launch: Callable[..., InOrbit]) -> None:
    with pytest.raises(ConfigError, match="a drag-free-satellite has no wire that could be served"):
        Served(read_rig(CAMPAIGNS / "microscope-rig.toml"))
    orbit = launch()
    orbit.rig.open()
    assert orbit.rig.identities()["satellite"].model == "drag-free satellite"
    orbit.rig.close()
    with pytest.raises(LinkLost, match="not open"):
        orbit.flight.satellite.fetch()


def test_turn_and_displacement_have_limits_of_their_own(launch: Callable[..., InOrbit]) -> None:
    satellite = launch().flight.satellite
    for stimulus, says in (
        (Stimulus("attitude", "z", 0.1, 1e-3), "a turn of 0.1 rad is refused; the linear range ends at 0.02 rad"),
        (Stimulus("masses", "y", 1e-3, 1e-3), "a displacement of masses of 0.001 m is refused"),
    ):
        with pytest.raises(LimitError) as refused:
            satellite.begin(FlightSession(100.0, stimulus))
        assert says in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('address = "sim:"', 'address = "tcp://127.0.0.1:5000"', "no way to a satellite but 'sim:' is known"),
        ("[constants.eccentricity]\nvalue = 5e-3", "", "[constants.eccentricity] is missing"),
        ('kind = "drag-free-satellite"', 'kind = "sensing-axis"', "world"),
        ("seed = 1707", 'seed = 1707\neffects = { "charm" = { a = 1.0 } }', "unknown effect 'charm'"),
    ],
)
def test_a_rig_file_that_has_no_satellite_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    text = (CAMPAIGNS / "microscope-rig.toml").read_text()
    assert old in text
    file = tmp_path / "rig.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as refused:
        runner.dry_run(read_campaign(CAMPAIGNS / "microscope.toml"), read_rig(file))
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_calibration_is_exported_as_a_bundle_that_reads_without_a_remark(tmp_path: Path) -> None:
    text = (CAMPAIGNS / "microscope.toml").read_text() + (
        'sessions = ["dx", "dy", "ac12", "k2c_2"]\norbits = 6.0\norbits_ac12 = 6.0\nturn_hz = 5.6e-3\n'
    )
    (tmp_path / "campaign.toml").write_text(text)
    rig = (CAMPAIGNS / "microscope-rig.toml").read_text()
    (tmp_path / "microscope-rig.toml").write_text(rig.replace("seed = 1707", "seed = 1707\nsettle_s = 500.0"))
    campaign = read_campaign(tmp_path / "campaign.toml")
    path = tmp_path / "x.rig.sqlite"
    runner.start(campaign, read_rig(campaign.rig_path), path, runner.Options(unattended=True))
    with Store.open(path) as store:
        write_bundle(store, tmp_path / "bundle")
        here = {run.run_id: (run.conditions["session"], store.samples(run.run_id)) for run in store.runs()}
    recording = read_bundle(tmp_path / "bundle")
    assert recording.report.warnings == ()
    assert recording.report.invalid == ()
    assert recording.header.constants == {"orbit_period_s": 5950.0, "eccentricity": 5e-3}
    assert recording.header.channels["m1_x"].unit == "m/s2"
    for run in recording.runs():
        session, samples = here[run.run_id]
        assert run.conditions["session"] == session
        for name, column in samples.items():
            assert np.array_equal(recording.samples(run.run_id)[name], column)


def test_what_is_held_is_never_what_moves() -> None:
    for moved, held in (("k2c_1", "mass-2"), ("k2c_2", "mass-1"), ("ad11", "both")):
        session = Calibration().session(moved, 5950.0)
        assert session.hold == held
        assert session == replace(session)


def stamped(*numbers: float) -> np.ndarray[Any, Any]:
    """Rows whose second column is ten times the number of the sample, every 0.25 s."""
    return np.array([[0.25 * number, 10.0 * number] for number in numbers]).reshape(-1, 2)


def test_packets_are_put_where_their_time_stamps_say() -> None:
    assert np.array_equal(on_grid("sat", stamped(4, 5, 6), 4, 100, 0.25).all, stamped(4, 5, 6))
    again = on_grid("sat", stamped(2, 3, 4, 5, 4, 5), 4, 100, 0.25)
    assert np.array_equal(again.all, stamped(4, 5)), "what comes twice, or again, counts once"
    lost = on_grid("sat", stamped(6, 7), 4, 100, 0.25)
    assert lost.all[:, 0].tolist() == [1.0, 1.25, 1.5, 1.75]
    assert np.isnan(lost.all[:2, 1]).all()
    assert np.array_equal(lost.came, stamped(6, 7))
    assert on_grid("sat", stamped(), 4, 100, 0.25).all.shape == (0, 2)


@pytest.mark.parametrize("wrong", [4.4, np.nan, np.inf, -3.0, 1e12])
def test_a_time_stamp_of_no_sample_is_named(wrong: float) -> None:
    with pytest.raises(ImplausibleSample, match=r"sat: t_s, sample 6: a time stamp of .* is no sample time") as told:
        on_grid("sat", stamped(4, 5, wrong), 4, 100, 0.25)
    assert (told.value.channel, told.value.sample) == ("t_s", 6)


def test_rows_that_come_twice_with_other_values_are_in_doubt() -> None:
    rows = stamped(4, 5, 5)
    rows[2, 1] = 7.0
    with pytest.raises(ImplausibleSample, match="twice"):
        on_grid("sat", rows, 4, 100, 0.25)


@pytest.mark.parametrize(
    ("faults", "lost", "attempts"),
    [
        ({"duplicated": {"nth": [2, 4]}}, 0, 0),
        ({"silent": {"nth": [2]}}, 3570, 0),
        ({"late": {"nth": [1], "delay_s": 1700.0}}, 0, 0),
        ({"disconnect": {"nth": [2]}}, 0, 1),
    ],
)
def test_telemetry_that_fails_on_the_way_leaves_right_samples(
    launch: Callable[..., InOrbit], faults: dict[str, Any], lost: int, attempts: int
) -> None:
    short = SHORT.model_copy(update={"sessions": ("dx",)})
    stores = []
    for name, spoilt in (("whole", None), ("spoilt", faults)):
        orbit = launch(name, spoilt)
        orbit.flight = replace(orbit.flight, orbit_period_s=0.15 * 5950.0)
        calibrate(orbit.session(), orbit.flight, short.model_copy(update={"orbits": 2.0}))
        stores.append(orbit.store)
    (whole,), (run,) = (list(recorded(store).values()) for store in stores)
    known = np.isfinite(run["m1_x"])
    assert (~known).sum() == lost
    for column, values in run.items():
        np.testing.assert_array_equal(values[known], whole[column][known])
    assert np.array_equal(run["t_s"], whole["t_s"])
    assert [run.valid for run in stores[1].interrupted_runs()] == [False] * attempts
    assert len(stores[1].events("fault")) == attempts
