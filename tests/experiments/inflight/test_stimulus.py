"""The stimulus that a row of runs.csv states against the one that the run's own channels show."""

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle, write_bundle
from rigctl.campaign.layout import UnitFindings
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.columns import COLUMNS
from rigctl.experiments.inflight.observe.reduction import reduce_run
from rigctl.experiments.inflight.observe.stimulus import AMPLITUDE_UNITS

STEP_S, NOISE = 8.0, 1.2e-12
MASSES = ("ac12", "ac13", "k2c_1", "k2c_2")


@pytest.fixture(scope="module")
def flown(flight):
    instrument = flight.drawn(4)
    return {
        name: flight.recorded(name, instrument, flight.Sky(noise=NOISE, seed=4), orbits=10, step_s=STEP_S)
        for name in AMPLITUDE_UNITS
    }


def found(flight, columns, conditions):
    constants = {"orbit_period_s": flight.ORBIT_S, "eccentricity": 5e-3}
    return COLUMNS.units_of(conditions, columns, constants)


@pytest.mark.parametrize("session", AMPLITUDE_UNITS)
def test_every_session_shows_its_own_stimulus(flight, flown, session):
    columns, conditions = flown[session]
    assert found(flight, columns, conditions) == UnitFindings()
    assert found(flight, columns, {**conditions, "amplitude": -conditions["amplitude"]}) == UnitFindings()
    # What nobody says cannot be compared, and too short a run cannot tell the stimulus from lines of the orbit.
    assert found(flight, columns, {**conditions, "amplitude": np.nan}) == UnitFindings()
    short = {name: column[:2000] for name, column in columns.items()}
    assert found(flight, short, {**conditions, "orbits": np.nan, "amplitude": 1.0}) == UnitFindings()


@pytest.mark.parametrize(("name", "factor"), [("t_xx", 1.004), ("t_zz", 0.999), ("t_yy", -1.0), ("t_xx", 1e3)])
def test_a_gradient_with_a_trace_is_said_and_which_element_makes_it(flight, flown, name, factor):
    columns, conditions = flown["ad11"]
    spoilt = {**columns, name: factor * columns[name]}
    # Samples that are missing are no gradient either.
    spoilt["t_xx"] = np.where(np.arange(len(spoilt["t_xx"])) % 100 == 7, np.nan, spoilt["t_xx"])
    [said] = found(flight, spoilt, conditions).remarks
    assert f"{name} would have to be {1 / factor:.5g} times as large" in said
    reduced = reduce_run("1", conditions, spoilt, flight.ORBIT_S)
    assert any(f"{name} would have to be {1 / factor:.5g} times" in each for each in reduced.remarks)


def test_a_gradient_less_turning_is_no_gradient(flight, flown):
    columns, conditions = flown["ad11"]
    # T - In of a satellite that turns about Y.
    turned = {**columns, **{name: columns[name] + 1e-6 for name in ("t_xx", "t_zz")}}
    [said] = found(flight, turned, conditions).remarks
    assert said.startswith("t_xx + t_yy + t_zz is 2e-06 1/s2 (rms), and zero for any gravity: write the gradient")


@pytest.mark.parametrize("session", AMPLITUDE_UNITS)
@pytest.mark.parametrize("factor", [1e6, 1e3, 1e-3])
def test_an_amplitude_in_another_unit_is_named(flight, flown, session, factor):
    columns, conditions = flown[session]
    said = found(flight, columns, {**conditions, "amplitude": factor * conditions["amplitude"]}).slip
    unit = AMPLITUDE_UNITS[session]
    assert f"amplitude is {factor * conditions['amplitude']:g}: one of them is off by {1 / factor:.0e}" in said
    assert said.endswith(f"write it in {unit}")


@pytest.mark.parametrize(
    ("session", "spoilt"),
    [
        *((name, {"calibration_frequency_hz": 1.02}) for name in AMPLITUDE_UNITS),
        *((name, {"amplitude": factor}) for name in AMPLITUDE_UNITS if name not in MASSES for factor in (3.0, 0.3)),
        # More than the stiffest spring does.
        *((name, {"amplitude": 5e-3}) for name in MASSES),
    ],
)
def test_another_stimulus_than_was_flown_is_a_contradiction(flight, flown, session, spoilt):
    columns, conditions = flown[session]
    row = {**conditions, **{name: factor * conditions[name] for name, factor in spoilt.items()}}
    said = found(flight, columns, row)
    assert said.slip is None
    assert said.contradiction.startswith(f"session {session} with amplitude {row['amplitude']:g} ")
    assert said.contradiction.endswith("write the session, calibration_frequency_hz and amplitude that were flown")


@pytest.mark.parametrize("session", MASSES)
@pytest.mark.parametrize("stiffness_s2", [2.5e-3, 2e-2])
def test_a_mass_that_a_spring_holds_is_no_contradiction(flight, flown, session, stiffness_s2):
    columns, conditions = flown[session]
    # What stiffness adds to the acceleration of a displaced mass, with the sign of the displacement.
    way = conditions["amplitude"] * np.cos(
        2.0 * np.pi * conditions["calibration_frequency_hz"] * columns["t_s"] + conditions["phase_rad"]
    )
    shares = {
        "ac12": {"m1_y": -0.5, "m2_y": 0.5},
        "ac13": {"m1_z": -0.5, "m2_z": 0.5},
        "k2c_1": {"m1_x": 1.0},
        "k2c_2": {"m2_x": 1.0},
    }[session]
    held = {name: columns[name] + stiffness_s2 * share * way for name, share in shares.items()}
    told = found(flight, {**columns, **held}, conditions)
    assert (told.slip, told.contradiction) == (None, None)
    [said] = told.remarks
    assert "a spring that holds the mass does that (effect wire-stiffness)" in said
    assert said.endswith("if none does, write the amplitude that was flown")


def test_lost_samples_hide_no_contradiction(flight, flown):
    columns, conditions = flown["ac12"]
    lost = {name: np.where((np.arange(len(c)) % 7 < 2) & (name != "t_s"), np.nan, c) for name, c in columns.items()}
    assert found(flight, lost, conditions) == UnitFindings()
    assert found(flight, lost, {**conditions, "amplitude": 9.0}).slip


@pytest.mark.parametrize(
    ("named", "was", "sessions"),
    [
        ("ad12", "ad13", "ad13"),
        ("ad13", "ad11", "ad11 or k2d"),
        ("k2c_1", "k2c_2", "k2c_2"),
        ("ac13", "ac12", "ac12"),
    ],
)
def test_a_session_whose_stimulus_is_on_another_axis_is_kept_as_invalid(
    flight, flown, tmp_path, named, was, sessions
):
    columns, conditions = flown[was]
    header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S, "eccentricity": 5e-3})
    runs = [
        RunRecord("good", "good", "test", conditions),
        RunRecord("s06", "s06", "test", {**conditions, "session": named}),
    ]
    recording = Recording(header, runs, dict.fromkeys(("good", "s06"), columns), ImportReport(2))
    write_bundle(recording, tmp_path / "bundle")
    import_bundle(tmp_path / "bundle", tmp_path / "x.rig.sqlite")
    with Store.open(tmp_path / "x.rig.sqlite") as store:
        good, bad = store.runs()
    assert (good.valid, bad.valid) == (True, False)
    assert bad.reason.startswith(f"session {named} with amplitude {conditions['amplitude']:g} ")
    assert bad.reason.endswith(f"write session {sessions}")
    assert "\n" not in bad.reason


def test_an_amplitude_in_another_unit_refuses_the_bundle(flight, flown, tmp_path):
    columns, conditions = flown["ac12"]
    header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S, "eccentricity": 5e-3})
    runs = [RunRecord("s02", "s02", "test", {**conditions, "amplitude": 9.0})]
    write_bundle(Recording(header, runs, {"s02": columns}, ImportReport(1)), tmp_path / "bundle")
    with pytest.raises(DataError, match=r"s02.*: m1_y - m2_y shows a stimulus of 9e-06 m .*write it in m$"):
        import_bundle(tmp_path / "bundle", tmp_path / "x.rig.sqlite")
