"""The test of the equivalence principle, on simulated satellites that share nothing with the analysis."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from rigctl.campaign.layout import UnitFindings
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import DataError
from rigctl.core.satellites import FlightSession
from rigctl.core.units import ABSOLUTE_ZERO_C
from rigctl.effects.catalogue import catalogue
from rigctl.experiments.inflight.columns import COLUMNS
from rigctl.experiments.inflight.effects_in_test import corrected
from rigctl.experiments.inflight.model.parameters import NAMES, SHARED
from rigctl.experiments.inflight.observe.equivalence import reduce_test
from rigctl.experiments.inflight.observe.pulses import FALSE_PER_DAY
from rigctl.experiments.inflight.observe.series import INDEX
from rigctl.experiments.inflight.observe.sessions import Session
from rigctl.experiments.inflight.result.equivalence import Calibrated, calibrated_of, doubts, equivalence
from rigctl.experiments.inflight.result.missions import reduced_tests, run_of
from rigctl.experiments.inflight.result.published import published
from simulators.worlds.satellite.ensemble import Ensemble
from simulators.worlds.satellite.instrument import drawn, exact_truth, operating_point
from simulators.worlds.satellite.settings import SatelliteSettings

ORBIT_S, ECCENTRICITY, STEP_S = 5950.0, 5e-3, 1.0
MEASURED_STEP_S = 0.25
"""That of the satellite, which noise and pulses are judged at; lines are the same at a sample a second."""
SPIN_HZ = 17.5 / ORBIT_S
EARTH_M3_S2 = 3.986004418e14
PULL_M_S2 = (EARTH_M3_S2 * (2.0 * np.pi / ORBIT_S) ** 4) ** (1.0 / 3.0)
SESSIONS = {"ep_inertial": 0.0, "ep_spin": SPIN_HZ}


def nature(**more):
    fixed = {"kind": "drag-free-satellite", "seed": 17, "sample_period_s": STEP_S}
    return SatelliteSettings.model_validate({**fixed, **more})


def flown(settings, session, draws=(0,), orbits=8):
    """Samples of some draws as a store has them."""
    ensemble = Ensemble(settings)
    asked = FlightSession(orbits * ORBIT_S, spin_hz=SESSIONS[session])
    told = np.concatenate([part.copy() for part in ensemble.telemetry(draws, 1, asked, 4096)])
    t_s = settings.sample_period_s * np.arange(len(told))
    return [{"t_s": t_s, **dict(zip(ensemble.columns, told[:, :, k].T, strict=True))} for k in range(len(draws))]


@pytest.fixture(scope="module")
def first():
    """Samples of the first satellite: a session is flown once for all tests, and each has a dict of its own."""
    kept = {}

    def samples(settings, session):
        asked = settings.model_dump_json(), session
        if asked not in kept:
            [kept[asked]] = flown(settings, session)
            for column in kept[asked].values():
                column.flags.writeable = False
        return dict(kept[asked])

    return samples


def known(settings, draw=0):
    """What a perfect calibration would find, and the level of m_dx while it was flown."""
    instrument = drawn(settings, draw)
    exact, a0 = exact_truth(instrument, settings), operating_point(instrument, settings)
    one, two = instrument.matrices
    ratio = (one - two) @ np.linalg.inv(one + two)
    values = np.zeros(SHARED)
    values[: len(NAMES)] = [exact[name] for name in NAMES]
    values[len(NAMES)] = (0.5 * (one + two) - 0.5 * ratio @ (one - two))[0, 0]
    measured = [
        instrument.bias_m_s2[k]
        + instrument.matrices[k] @ (a0[k] - instrument.parasitic_m_s2[k])
        + instrument.couplings[k] @ instrument.parasitic_m_s2[k]
        + instrument.quadratic_s2_m[k] * a0[k] ** 2
        for k in (0, 1)
    ]
    return Calibrated(values, np.zeros((SHARED, SHARED)), np.zeros(SHARED)), 0.5 * (measured[0] - measured[1])[0]


def outcome(samples, session, calibrated, level):
    conditions = {"session": session, "spin_frequency_hz": SESSIONS[session]}
    return equivalence([reduce_test("1", conditions, samples, ORBIT_S).about(level)], calibrated)["1"]


STILL = nature(noise_on=False, bounds={"tracker_bias_rad": 0.0})
VIOLATED = STILL.model_copy(update={"eotvos": -3e-14})


@pytest.mark.parametrize("session", SESSIONS)
def test_a_violation_is_found_to_the_last_digit_without_noise(first, session):
    hidden = VIOLATED.eotvos
    calibrated, level = known(VIOLATED)
    found = outcome(first(VIOLATED, session), session, calibrated, level)
    # Along Z a_c13 delta acts; the rest of a thousandth is a_c1 of the same size against the exact small signals.
    assert found["delta"]["value"] == pytest.approx(hidden, rel=1e-3, abs=0.0)
    assert abs(found["quadrature"]["value"]) < 1e-3 * abs(hidden)


@pytest.mark.parametrize("session", SESSIONS)
def test_uncorrected_the_off_centring_is_a_violation_where_pointing_is_inertial(first, session):
    nothing = dict.fromkeys(
        ("scale", "theta_c_rad", "theta_d_rad", "eta_rad", "quadratic_s2_m", "tracker_bias_rad", "thruster"), 0.0
    )
    settings = nature(noise_on=False, bounds=nothing)
    calibrated, level = known(settings)
    found = outcome(first(settings, session), session, calibrated, level)
    dx, _, dz = drawn(settings, 0).delta_m
    # Hardy et al., table 1: T_xx and T_xz have 3/4 e n^2 at the orbit's frequency, cosine and minus sine, the pull
    # is against r.
    expected = -0.75 * ECCENTRICITY * (2.0 * np.pi / ORBIT_S) ** 2 * dx / PULL_M_S2
    inertial = session == "ep_inertial"
    assert found["uncorrected"]["value"] == pytest.approx(expected if inertial else 0.0, rel=0.02, abs=2e-17)
    assert found["rows"]["ac11_dx_m"]["before_m_s2"] == pytest.approx(
        abs(expected) * PULL_M_S2 if inertial else 0.0, rel=0.02, abs=2e-16
    )
    assert abs(dz) > 1e-6
    assert abs(found["delta"]["value"]) < 1e-19


def without_pulses(settings, session, draws):
    conditions = {"session": session, "spin_frequency_hz": SESSIONS[session]}
    runs = []
    for draw, samples in zip(draws, flown(settings, session, draws), strict=True):
        calibrated, level = known(settings, draw)
        run = reduce_test("1", conditions, samples, ORBIT_S).about(level)
        runs.append((run, equivalence([run], calibrated)["1"]))
    return runs


NOISY = nature(eotvos=1e-14, sample_period_s=MEASURED_STEP_S)


@pytest.fixture(scope="module", params=SESSIONS)
def quiet(request):
    """A session of the test, and each of twelve satellites' run of it, without a pulse, with what it tells."""
    return request.param, without_pulses(NOISY, request.param, range(12))


def test_errors_are_as_large_as_stated(quiet):
    p_values = []
    for _, found in quiet[1]:
        pull = (found["delta"]["value"] - NOISY.eotvos) / found["delta"]["sigma_noise"]
        # Amplitudes beside the line tell the noise, and they are few in so short a session.
        p_values.append(stats.t.cdf(pull, found["noise_dof"]))
    pulls = stats.norm.ppf(p_values)
    assert abs(np.mean(pulls)) < 3.3 / np.sqrt(len(pulls))
    assert 1e-3 < stats.chi2.cdf(np.sum(np.square(pulls)), len(pulls)) < 1.0 - 1e-3


def test_where_no_pulses_are_as_many_are_found_as_is_stated(quiet):
    expected = FALSE_PER_DAY * len(quiet[1]) * 8 * ORBIT_S / 86400.0
    assert sum(run.pulses for run, _ in quiet[1]) <= stats.poisson.isf(1e-3, expected)


@pytest.mark.parametrize("session", SESSIONS)
def test_gaps_shift_nothing_and_cost_what_is_missing(first, session):
    gappy = VIOLATED.model_copy(update={"missing": VIOLATED.missing.model_copy(update={"fraction": 0.05})})
    calibrated, level = known(VIOLATED)
    conditions = {"session": session, "spin_frequency_hz": SESSIONS[session]}
    whole, patchy = (
        reduce_test("1", conditions, first(each, session), ORBIT_S).about(level) for each in (VIOLATED, gappy)
    )
    assert patchy.missing == pytest.approx(0.05, abs=2e-3)
    assert whole.spread[0] < patchy.spread[0] < 1.1 * whole.spread[0]
    found = [equivalence([each], calibrated)["1"]["delta"]["value"] for each in (whole, patchy)]
    assert found[1] == pytest.approx(found[0], abs=1e-18)


def crackling(settings, session):
    """Gaps, and five pulses an orbit, always at the same places of it; a tenth of each is left in the difference."""
    amplitude_m_s2 = {"ep_inertial": 1e-8, "ep_spin": 1e-7}[session]
    glitches = {"glitches": {"amplitude": amplitude_m_s2, "per_orbit": 5.0, "phased": 1.0, "ratio": 0.1}}
    gaps = settings.missing.model_copy(update={"fraction": 0.05})
    return settings.model_copy(update={"effects": glitches, "missing": gaps, "range_m_s2": 1e-4})


@pytest.fixture(scope="module")
def loud(quiet):
    """The runs of four of the satellites among gaps and pulses."""
    return without_pulses(crackling(NOISY, quiet[0]), quiet[0], range(4))


def test_among_gaps_and_pulses_of_all_sizes_sigma_grows_by_less_than_a_tenth_and_nothing_shifts(quiet, loud):
    quiet = quiet[1][: len(loud)]
    # Of forty a few are within gaps, or too small to matter.
    assert all(25 <= run.pulses <= 60 for run, _ in loud)
    cost = np.array(
        [with_them.spread[0] / alone.spread[0] for (alone, _), (with_them, _) in zip(quiet, loud, strict=True)]
    )
    assert cost.max() < 1.1
    # The same noise, but for what is masked: of its level as much is new, over so many amplitudes beside the line.
    levels = np.array(
        [[each["delta"]["sigma_noise"] / run.spread[0] for run, each in these] for these in (quiet, loud)]
    )
    new = np.mean(1.0 - cost**-2.0)
    growth = np.mean(levels[1] ** 2) / np.mean(levels[0] ** 2)
    assert growth < 1.0 + 3.3 * np.sqrt(2.0 * 2.0 * new / (len(loud) * quiet[0][0].dof))
    shifts = np.array([b["delta"]["value"] - a["delta"]["value"] for (_, a), (_, b) in zip(quiet, loud, strict=True)])
    expected = np.array([each["delta"]["sigma_noise"] for _, each in quiet]) * np.sqrt(cost**2 - 1.0)
    # Sigma itself is known to some sixth.
    assert 1e-3 < stats.chi2.cdf(np.mean(shifts**2) / np.mean(expected**2) * len(loud), len(loud)) < 0.999


@pytest.mark.parametrize("quiet", ["ep_spin"], indirect=True)
def test_a_mask_does_not_know_the_violation(quiet, loud):
    violated = crackling(NOISY.model_copy(update={"eotvos": 1e-12}), quiet[0])
    [(run, _)] = without_pulses(violated, quiet[0], (0,))
    assert run.pulses == loud[0][0].pulses
    assert run.spread == pytest.approx(loud[0][0].spread, rel=1e-12, abs=0.0)


def test_of_a_turning_satellite_the_gradient_is_less_what_its_attitude_adds_to_the_turning(first):
    """Rates are those of rotation matrices: turned by -spin about Y, and a little about z at the line of the test."""
    samples, w, wobble_rad = first(nature(), "ep_spin"), 2.0 * np.pi * (SPIN_HZ + 1.0 / ORBIT_S), 1e-3
    conditions = {"session": "ep_spin", "spin_frequency_hz": SPIN_HZ}
    wobbling = {**samples, "att_z": samples["att_z"] + wobble_rad * np.cos(w * samples["t_s"])}
    plain, moved = (reduce_test("1", conditions, each, ORBIT_S).amplitudes for each in (samples, wobbling))

    def body(t_s):
        turned = Rotation.from_euler("y", -2.0 * np.pi * SPIN_HZ * t_s)
        return (turned * Rotation.from_euler("z", wobble_rad * np.cos(w * t_s))).as_matrix()

    def rate_squared(t_s):
        rate = body(t_s).T @ (body(t_s + 0.01) - body(t_s - 0.01)) / 0.02
        return rate @ rate

    # In less the angular acceleration is that square: T - In has minus its line.
    times_s = np.linspace(0.0, 2.0 * np.pi / w, 64, endpoint=False)
    squares = np.array([rate_squared(t_s) for t_s in times_s])
    for name, (i, k) in {"t_xy": (0, 1), "t_yz": (1, 2)}.items():
        expected = -wave(times_s, squares[:, i, k], w)
        # Amplitudes count along gravity as the satellite sees it.
        along, across = (moved - plain)[:, INDEX[name]]
        found = wave(samples["t_s"], along * samples["g_x"] + across * samples["g_z"], w)
        assert found == pytest.approx(expected, abs=0.01 * np.linalg.norm(expected))


def wave(t_s, values, w):
    """The parts along cosine and sine over whole periods."""
    return 2.0 * np.array([np.mean(values * np.cos(w * t_s)), np.mean(values * np.sin(w * t_s))])


def test_the_calibration_s_uncertainty_is_counted_and_shared_by_all_sessions(first):
    settings = nature()
    calibrated, level = known(settings)
    samples = first(settings, "ep_inertial")
    sigma = 1e-7
    covariance = np.zeros((SHARED, SHARED))
    covariance[0, 0] = sigma**2
    again = calibrated_of(calibrated.values, covariance, {})
    run = reduce_test("1", {"session": "ep_inertial"}, samples, ORBIT_S).about(level)
    both = equivalence([run, run], again)
    # Hardy et al., table 1: T_xx at the test's frequency.
    expected = sigma * 0.75 * ECCENTRICITY * (2.0 * np.pi / ORBIT_S) ** 2 / PULL_M_S2
    assert both["1"]["delta"]["sigma_calibration"] == pytest.approx(expected, rel=0.02, abs=0.0)
    one, total = equivalence([run], again)["combined"]["delta"], both["combined"]["delta"]
    assert total["sigma_calibration"] == pytest.approx(one["sigma_calibration"], rel=1e-6, abs=0.0)


def test_the_calibration_s_uncertainty_is_counted_in_quadrature_too(first):
    settings = nature()
    calibrated, level = known(settings)
    run = reduce_test("1", {"session": "ep_inertial"}, first(settings, "ep_inertial"), ORBIT_S).about(level)
    sigma = 1e-7
    covariance = np.zeros((SHARED, SHARED))
    covariance[2, 2] = sigma**2
    alone = equivalence([run], calibrated)["1"]["quadrature"]["sigma"]
    counted = equivalence([run], calibrated_of(calibrated.values, covariance, {}))["1"]["quadrature"]["sigma"]
    # Hardy et al., table 1: T_xz at the test's frequency goes with g_z.
    expected = sigma * 0.75 * ECCENTRICITY * (2.0 * np.pi / ORBIT_S) ** 2 / PULL_M_S2
    assert counted**2 - alone**2 == pytest.approx(expected**2, rel=0.04, abs=0.0)


def test_what_acts_besides_at_the_frequency_of_the_test_is_said(first):
    settings = nature()
    calibrated, level = known(settings)
    turning, inertial = (first(settings, session) for session in ("ep_spin", "ep_inertial"))

    spun = reduce_test("spin", {"session": "ep_spin", "spin_frequency_hz": SPIN_HZ}, turning, ORBIT_S)

    def said(extra_m_s2, effects=()):
        spoilt = {**inertial, "m1_x": inertial["m1_x"] + extra_m_s2}
        still = reduce_test("still", {"session": "ep_inertial"}, spoilt, ORBIT_S)
        return doubts([run.about(level) for run in (spun, still)], calibrated, effects)

    assert said(0.0) == []
    [quadrature] = said(2e-14 * inertial["g_z"])
    assert quadrature.startswith("run still: ")
    assert "is in quadrature with gravity, where no violation is" in quadrature
    [contradiction] = said(2e-14 * inertial["g_x"])
    assert contradiction.startswith("the sessions of the test contradict each other")
    [left] = said(0.0, ["thermal-bias", "magnetic"])
    assert left.startswith("what thermal-bias, magnetic does at the frequency of the test is still in delta")


HEADER = Header("inflight-calibration", constants={"orbit_period_s": ORBIT_S})


@pytest.mark.parametrize("session", SESSIONS)
@pytest.mark.parametrize("effect", ["thermal-bias", "thermal-off-centring"])
def test_what_an_effect_of_the_model_does_in_the_test_is_taken_out_with_its_uncertainty(first, session, effect):
    calibrated, level = known(STILL)
    clean = first(STILL, session)
    f_hz, t_s = 1.0 / ORBIT_S + SESSIONS[session], clean["t_s"]
    warmer = 0.1 * np.cos(2.0 * np.pi * f_hz * t_s + 0.7)
    size = {"thermal-bias": 1e-13, "thermal-off-centring": 1e-8}[effect]
    # By its definition in 2 m_dx; along X the centrifugal gradient is that of turning about Y.
    gradient = clean["t_xx"] + (2.0 * np.pi * SESSIONS[session]) ** 2
    apart = 2.0 * size * warmer if effect == "thermal-bias" else size * warmer * gradient
    spoilt = {
        **clean,
        "m1_x": clean["m1_x"] + 0.5 * apart,
        "m2_x": clean["m2_x"] - 0.5 * apart,
        "temperature_c": 22.0 + warmer,
    }
    conditions = {"session": session, "spin_frequency_hz": SESSIONS[session]}
    source = Recording(HEADER, [RunRecord("1", "1", "test", conditions)], {"1": spoilt}, ImportReport(1))
    before, after = (reduce_test("1", conditions, each, ORBIT_S).about(level) for each in (clean, spoilt))
    asked = catalogue("inflight-calibration")[effect]
    values = np.array([size, *(0.0 for _ in list(asked.parameters)[1:])])
    usual_k = np.full(2, 22.0 - ABSOLUTE_ZERO_C)
    [run], told = corrected([after], source, [(asked, values)], usual_k)
    assert told == [True]
    wider = np.zeros((SHARED + values.size, SHARED + values.size))
    wider[SHARED, SHARED] = (0.1 * size) ** 2
    places = range(SHARED, SHARED + values.size)
    both = calibrated_of(np.concatenate([calibrated.values, values]), wider, {}, places)
    alone, with_it = equivalence([before], calibrated)["1"], equivalence([after], calibrated)["1"]
    found = equivalence([run], both)["1"]
    moved = np.array([with_it[name]["value"] - alone[name]["value"] for name in ("delta", "quadrature")])
    for name in ("delta", "quadrature"):
        left = found[name]["value"] - alone[name]["value"]
        # The gain that multiplies the effect is another one by a hundredth.
        assert abs(left) < 0.03 * np.hypot(*moved)
    assert found["delta"]["sigma_calibration"] == pytest.approx(0.1 * abs(moved[0]), rel=0.05, abs=0.0)
    # As if there were no model, the effect is in it.
    assert found["uncorrected"]["value"] == pytest.approx(with_it["uncorrected"]["value"], rel=1e-6, abs=0.0)


def test_an_effect_with_lines_of_the_orbit_is_left_in_a_session_of_the_test(first):
    samples, conditions = first(STILL, "ep_inertial"), {"session": "ep_inertial"}
    source = Recording(HEADER, [RunRecord("1", "1", "test", conditions)], {"1": samples}, ImportReport(1))
    run = reduce_test("1", conditions, samples, ORBIT_S)
    effects = catalogue("inflight-calibration")
    asked = [(effects[name], np.full(len(effects[name].parameters), 1e-14)) for name in ("magnetic", "thermal-bias")]
    # No thermometer tells what the second one did.
    [made], told = corrected([run], source, asked, np.full(2, np.nan))
    assert told == [False, False]
    assert made.acting == ()
    np.testing.assert_array_equal(made.amplitudes, run.amplitudes)


def test_every_row_of_table_1_comes_out_of_an_inertial_session(first):
    calibrated, level = known(STILL)
    samples = first(STILL, "ep_inertial")
    run = reduce_test("1", {"session": "ep_inertial"}, samples, ORBIT_S).about(level)
    truth = calibrated.values

    def left_by(name):
        """What is left at the test's frequency when all are corrected but one, m/s2, over that one."""
        without = np.where(np.arange(SHARED) == NAMES.index(name), 0.0, truth)
        found = [
            equivalence([run], calibrated_of(values, np.zeros((SHARED, SHARED)), {}))["1"]
            for values in (truth, without)
        ]
        apart = [found[1][key]["value"] - found[0][key]["value"] for key in ("delta", "quadrature")]
        return PULL_M_S2 * np.hypot(*apart) / abs(truth[NAMES.index(name)])

    # To first order in the eccentricity at the orbit's frequency: T_xx, T_xz 3/4 e n^2, T_yy 3 e n^2, T_zz 9/4 e n^2.
    unit = ECCENTRICITY * (2.0 * np.pi / ORBIT_S) ** 2
    dx, dy, dz = truth[:3]
    expected = {
        "ac11_dx_m": 0.75 * unit,
        "ac11_dz_m": 0.75 * unit,
        "ac12_rad": 3.0 * unit * abs(dy),
        # The paper's row is without T_xz Dx.
        "ac13_rad": unit * np.hypot(0.75 * dx, 2.25 * dz),
    }
    for name, driver in expected.items():
        assert left_by(name) == pytest.approx(driver, rel=0.05, abs=0.0), name
    assert 0.75 * unit == pytest.approx(published().rows["ac11_dx_m"].per_unit_m_s2, rel=0.1, abs=0.0)
    assert 3.0 * unit * 20e-6 == pytest.approx(published().rows["ac12_rad"].per_unit_m_s2, rel=0.1, abs=0.0)
    assert 2.25 * unit * 20e-6 == pytest.approx(published().rows["ac13_rad"].per_unit_m_s2, rel=0.1, abs=0.0)
    # What the drag-free loop leaves, by Fourier's integral over whole orbits.
    turn = np.exp(-2j * np.pi * samples["t_s"] / ORBIT_S)
    for name, axis in (("ad11", "x"), ("ad12_rad", "y"), ("ad13_rad", "z")):
        both = samples[f"m1_{axis}"] + samples[f"m2_{axis}"]
        residual = 2.0 * abs(np.mean((both - both.mean()) * turn))
        assert left_by(name) == pytest.approx(residual, rel=0.05, abs=0.0), name
        # The paper's residual is 0.94 to 1e-12 m/s2 of other drag: of that order.
        assert 0.2 < residual / published().rows[name].per_unit_m_s2 < 2.0


def test_reduced_while_it_comes_down_a_session_is_what_it_is_as_a_whole():
    settings, draws = nature(), (1, 3)
    ensemble = Ensemble(settings)
    asked = FlightSession(8 * ORBIT_S, spin_hz=SPIN_HZ)
    session = Session("ep_spin", ORBIT_S, STEP_S, spin_hz=SPIN_HZ)
    telemetry = ensemble.telemetry(draws, 1, asked, 5000)
    unit = reduced_tests(session, asked.duration_s, telemetry, ensemble.columns, draws, lambda: None)
    conditions = {"session": "ep_spin", "spin_frequency_hz": SPIN_HZ}
    for draw, samples in zip(draws, flown(settings, "ep_spin", draws), strict=True):
        calibrated, _ = known(settings, draw)
        streamed, whole = run_of(unit, session, draw), reduce_test("1", conditions, samples, ORBIT_S)
        assert whole.pulses == 0
        assert streamed.spread == pytest.approx(whole.spread, rel=1e-9, abs=0.0)
        found, expected = (equivalence([run], calibrated)["combined"]["delta"] for run in (streamed, whole))
        assert found["value"] == pytest.approx(expected["value"], abs=1e-6 * expected["sigma"])


def test_powers_count_from_the_level_of_the_calibration_as_if_the_samples_did(first):
    samples, level = first(STILL, "ep_spin"), 3e-7
    moved = {**samples, "m1_x": samples["m1_x"] - level, "m2_x": samples["m2_x"] + level}
    conditions = {"session": "ep_spin", "spin_frequency_hz": SPIN_HZ}
    counted, expected = (reduce_test("1", conditions, each, ORBIT_S) for each in (samples, moved))
    counted = counted.about(level)
    for name in ("m1^2", "m2^2", "m1 m2", "m1^3", "m2^3"):
        place = INDEX[name]
        for found, wanted in ((counted.amplitudes, expected.amplitudes), (counted.beside, expected.beside)):
            scale = np.max(np.abs(wanted[:, place]))
            np.testing.assert_allclose(found[:, place], wanted[:, place], atol=1e-6 * scale)


def test_what_cannot_be_a_session_of_the_test_is_refused_in_a_line():
    t_s = STEP_S * np.arange(1000)
    with pytest.raises(DataError, match="column g_x is missing"):
        reduce_test("7", {"session": "ep_inertial"}, {"t_s": t_s}, ORBIT_S)


@pytest.mark.parametrize("session", SESSIONS)
def test_gravity_is_held_to_the_orbit_and_the_turning(first, session):
    samples = first(nature(), session)
    constants = {"orbit_period_s": ORBIT_S, "eccentricity": ECCENTRICITY}

    def found(factor=1.0, **row):
        spoilt = {name: factor * column if name.startswith("g_") else column for name, column in samples.items()}
        return COLUMNS.units_of(
            {"session": session, "orbits": 8.0, "spin_frequency_hz": SESSIONS[session], **row}, spoilt, constants
        )

    assert found() == UnitFindings()
    # As a factor of delta it would pass unseen.
    assert found(1e3).slip.endswith(f"gravity there is {PULL_M_S2:.3g}: off by 1e+03; write it in m/s2")
    assert "with a phase of 0 deg, gravity there is" in found(-1.0).contradiction
    other = {"session": "ep_inertial" if session == "ep_spin" else "ep_spin", "spin_frequency_hz": SPIN_HZ}
    assert found(**other).contradiction.endswith("and g_x, g_y, g_z towards the Earth")
    # A session without gravity is left out where it is reduced.
    del samples["g_x"]
    assert found() == UnitFindings()
