"""A recording of sessions on the workbench: adequate when nothing is hidden, named when something is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from rigctl.analysis.least_squares import least_squares
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import effect
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.model import residual_samples
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.model.residual_samples import steadiness
from rigctl.experiments.inflight.observe.detection import density_of
from rigctl.experiments.inflight.observe.grid import Grid
from rigctl.experiments.inflight.result.budget import calibration_budget, refitted
from rigctl.experiments.inflight.result.result import calibration, systematic
from rigctl.experiments.inflight.result.unseen import unseen_covariance
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit, parameters_of
from rigctl.workbench.verdict.misfit import of_misfit
from rigctl.workbench.verdict.significance import p_of_shape

WARM_K = 1e-3
LINES_STEP_S = 7.0
"""Whole in an orbit, as lines and their noise are judged at; pulses need that of a flight."""
FEW = ("dx", "dz", "dy", "ad11", "ad12", "k2d")
"""Sessions that tell every kind of channel, where all eleven are not needed."""


def recording(
    flight,
    *,
    seed=1,
    sky=None,
    sessions=None,
    spoil=None,
    columns=None,
    instrument=None,
    step_s=LINES_STEP_S,
):
    instrument = instrument or flight.drawn(seed, eta=0.0)
    records, samples = [], {}
    for name in sessions or flight.SESSIONS:
        sky = sky or flight.Sky(noise=1.2e-12, seed=seed)
        own, conditions = flight.recorded(name, instrument, sky, step_s=step_s)
        own |= columns(own["t_s"]) if columns else {}
        own, conditions = spoil(name, own, conditions) if spoil else (own, conditions)
        records.append(RunRecord(name, name, "test", conditions))
        samples[name] = own
    header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S, "eccentricity": 5e-3})
    return Recording(header, records, samples, ImportReport(len(records)))


def exact(flight, seed=1):
    known = flight.small_signal(flight.drawn(seed, eta=0.0))
    return np.array([known[name] for name in NAMES])


def pulls(estimates, truth):
    return np.array(
        [(estimates[name].value - each) / estimates[name].sigma for name, each in zip(NAMES, truth, strict=True)]
    )


def temperature(t_s):
    warm = WARM_K * np.cos(2 * np.pi * t_s / 5950.0 + 0.7)
    return {"temperature_1_k": 290.0 + warm, "temperature_2_k": 290.0 + warm}


def one_temperature(t_s):
    return {"temperature_c": temperature(t_s)["temperature_1_k"] - 273.15}


@pytest.fixture(scope="module")
def plain(flight):
    return InflightStudy(recording(flight))


def test_with_nothing_hidden_the_baseline_is_adequate(flight, plain):
    account = account_of(plain, [()])
    found = fit(plain, (), account)
    assert np.all(np.abs(pulls(found.parameters, exact(flight))) < 4.0)
    assert 0.85 < found.error_fit < 1.15
    assert 0.85 < found.error_held_out < 1.15
    said = diagnose(plain, (), account=account).as_json()
    assert (said["verdict"], said["suggested"], said["unexplained"]) == ("adequate", [], None)
    pairs = {(each["effect"], each["from"]) for each in said["inseparable"]}
    assert {("tracker-bias", f"baseline:{name}") for name in ("ac12_rad", "ac13_rad")} <= pairs
    assert {("orbit-dating", f"baseline:{name}") for name in ("ac13_rad", "ac11_dx_m", "ac11_dz_m")} <= pairs
    assert "thrust-quantisation" in said["not_testable"]
    assert "no temperature is recorded" in said["not_testable"]["thermal-bias"]


@pytest.fixture(scope="module")
def attempt(plain):
    return Attempt(plain, ())


def test_the_result_has_both_estimates_and_what_no_session_sees(flight, plain, attempt):
    beyond = systematic(attempt.result.values, attempt.uncertainty.covariance, {})
    found = calibration(plain, parameters_of(plain, ()), beyond)
    assert list(found["parameters"]) == list(NAMES)
    assert found["remarks"] == []
    assert 2 <= found["sweeps"] <= 5
    for truth, each in zip(exact(flight), found["parameters"].values(), strict=True):
        assert abs(each["paper"]["value"] - truth) < 4.0 * each["paper"]["sigma"]
        assert each["joint"]["sigma"] < 1.05 * each["paper"]["sigma"]
        assert (each["value"], each["sigma"]) == (each["joint"]["value"], each["joint"]["sigma"])
    dx, dy, dz = (found["parameters"][f"ac11_{axis}_m"]["value"] for axis in ("dx", "dy", "dz"))
    s_rad, eta_rad = 1e-4, 1e-4 / np.sqrt(3.0)
    for name, parts in {
        "ac12_rad": (s_rad, eta_rad),
        "ac13_rad": (s_rad, 0.5 * eta_rad),
        "ac11_dx_m": (s_rad * dz, s_rad * dy, 0.5 * eta_rad * dz),
        "ac11_dy_m": (0.95 * s_rad * dx, 0.95 * eta_rad * dx),
        "ac11_dz_m": (s_rad * dx, 0.5 * eta_rad * dx),
    }.items():
        told = found["parameters"][name]
        # A hundredth of sigma: sessions help each other a little.
        assert told["systematic"] == pytest.approx(np.linalg.norm(parts), rel=0.02, abs=1e-2 * told["sigma"]), name


def test_the_budget_tells_each_sessions_noise_apart_and_adds_up_to_the_fit(flight, plain, attempt):
    budget = calibration_budget(plain, attempt)
    assert all(budget.check.validated), budget.check.reason
    fitted = attempt.uncertainty.covariance[:10, :10]
    beyond = unseen_covariance(attempt.result.values[:10], fitted, {})
    size = np.sqrt(np.diag(fitted + beyond))
    np.testing.assert_allclose((budget.covariance - fitted - beyond) / np.outer(size, size), 0.0, atol=1e-6)
    rows = {group.name: u for group, u in budget.rows().items()}
    assert {f"noise of {name}" for name in flight.SESSIONS} < set(rows)
    for session, name in (("dy", "ac11_dy_m"), ("ac12", "ac12_rad"), ("ad12", "ad12_rad"), ("ad13", "ad13_rad")):
        assert rows[f"noise of {session}"][NAMES.index(name)] > 0.9 * np.sqrt(fitted.diagonal()[NAMES.index(name)])
    assert budget.as_json()["contributions"][0]["type"] == "A"
    assert budget.first.expanded == pytest.approx(1.96 * budget.first.standard_uncertainty, rel=1e-3)


def test_a_monte_carlo_of_the_calibration_is_the_fit_of_each_draw(flight, plain, attempt):
    """Data drawn anew and fitted as the recording is, against the step that the budget's Monte Carlo takes."""
    model, rng = attempt.model, np.random.default_rng(5)
    gain = attempt.uncertainty.covariance @ attempt.jacobian.T
    data = len(attempt.result.residuals)
    for _ in range(3):
        drawn = np.concatenate([rng.standard_normal(data), np.zeros(gain.shape[1] - data)])
        fitted = attempt.result.values[:, None]
        stepped = refitted(model, attempt, gain, drawn[:, None])[:, 0]

        def whitened(values, drawn=drawn):
            return (model.observations.value - model.predict(values)) / attempt.noise.sigma + drawn[:data]

        exact = least_squares(
            whitened,
            [replace(each, start=float(at)) for each, at in zip(model.parameters, fitted[:, 0], strict=True)],
            jacobian=lambda values: model.jacobian(values) / attempt.noise.sigma[:, None],
            rcond=1e-12,
        )
        sigma = np.sqrt(np.diag(exact.covariance))[:10]
        np.testing.assert_allclose((stepped - exact.values)[:10] / sigma, 0.0, atol=0.02)


def warm(_, t_s, out):
    made = np.zeros_like(out)
    made[0, 0] = 2e-10 * WARM_K * np.cos(2 * np.pi * t_s / 5950.0 + 0.7)
    return made


def test_one_temperature_stands_for_that_of_both_sensors(flight):
    predicted = []
    for columns in (temperature, one_temperature):
        study = InflightStudy(recording(flight, sessions=("dx",), columns=columns))
        model = study.model(())
        candidates, _ = study.candidates(model, np.array([each.start for each in model.parameters]))
        predicted.append({each.term.effect: each.derivative for each in candidates}["thermal-bias"])
    assert predicted[0] == pytest.approx(predicted[1], rel=1e-6, abs=1e-12)
    assert np.abs(predicted[0]).max() > 1e-4


def test_a_bias_that_goes_with_the_temperature_is_named_sized_and_explained(flight):
    sky = flight.Sky(noise=1.2e-12, seed=1, added=warm)
    study = InflightStudy(recording(flight, sky=sky, columns=temperature))
    account = account_of(study, [()])
    said = diagnose(study, (), account=account).as_json()
    assert (said["verdict"], said["suggested"]) == ("effect", ["thermal-bias"])
    found = said["ranking"][0]["parameters"]["lambda_d"]
    assert found["value"] == pytest.approx(1e-10, abs=4.0 * found["sigma"])
    assert said["ranking"][0]["held_out_error_ratio"] < 0.5
    before, after = (fit(study, terms, account) for terms in ((), (Term("thermal-bias"),)))
    assert before.error_fit > 1.5
    assert after.error_fit < 1.15
    assert np.all(np.abs(pulls(after.parameters, exact(flight))) < 4.0)


@pytest.mark.parametrize(
    ("first", "second", "choice", "sizes"),
    [
        (1e-10, 1e-10, {}, {"lambda_d": 1e-10}),
        (2e-10, 0.5e-10, {"of": "each sensor"}, {"lambda_d": 1.25e-10, "lambda_c": 0.75e-10}),
    ],
)
def test_each_sensor_has_a_coefficient_of_its_own_where_the_data_ask_for_it(flight, first, second, choice, sizes):
    def sensors(t_s):
        waves = [WARM_K * np.sin(2 * np.pi * harmonic * t_s / 5950.0) for harmonic in (3, 4)]
        return {f"temperature_{mass}_k": 290.0 + wave for mass, wave in zip((1, 2), waves, strict=True)}

    def biased(_, t_s, out):
        made, temperatures = np.zeros_like(out), sensors(t_s)
        made[0, 0] = first * (temperatures["temperature_1_k"] - 290.0)
        made[1, 0] = -second * (temperatures["temperature_2_k"] - 290.0)
        return made

    sky = flight.Sky(noise=1.2e-12, seed=1, added=biased)
    study = InflightStudy(
        recording(flight, step_s=flight.STEP_S, sky=sky, columns=sensors, sessions=("dx", "dz", "ad11"))
    )
    scored = Attempt(study, ()).scored_effect("thermal-bias")
    assert scored.candidate.term == Term("thermal-bias", choice)
    fitted = parameters_of(study, (scored.candidate.term,))
    for name, size in sizes.items():
        assert fitted[name].value == pytest.approx(size, abs=4.0 * fitted[name].sigma)
        assert fitted[name].sigma < 0.2 * size


def test_without_the_thermometer_what_remains_is_unknown_and_nothing_is_suggested_beside_it(flight):
    """The temperature's wave differs from session to session: a steady force explains a part of what it does."""

    def warm_otherwise(session, t_s, out):
        phase = 2.0 * len(session) + ord(session[-1])
        return (1.0 + 0.5 * np.sin(phase)) * warm(session, t_s + 950.0 * phase, out)

    sky = flight.Sky(noise=1.2e-12, seed=1, added=warm_otherwise)
    said = diagnose(InflightStudy(recording(flight, sky=sky, sessions=FEW)), ()).as_json()
    assert (said["verdict"], said["suggested"]) == ("unknown", [])
    assert "with session" in said["unexplained"]["description"]
    assert "or one temperature_c" in said["not_testable"]["thermal-bias"]
    assert [each["dropped"] for each in said["steps"]] == [[], [], ["magnetic"]]


def test_a_line_that_no_effect_makes_is_said_to_be_unknown(flight):
    def odd(session, t_s, out):
        made = np.zeros_like(out)
        if session == "ad12":
            made[0, 0] = 4e-13 * np.sin(2 * np.pi * (2 * 73 + 10) / 59500.0 * t_s)
        return made

    sky = flight.Sky(noise=1.2e-12, seed=1, added=odd)
    said = diagnose(InflightStudy(recording(flight, sky=sky, sessions=FEW)), ()).as_json()
    assert said["verdict"] == "unknown"
    assert said["unexplained"]["channel"] == "2 m_dx"
    assert "ad12 2 f + f_orb sine" in said["unexplained"]["description"]


def test_an_effect_of_ones_own_is_tested_like_the_others(flight):
    @effect("flat-y", on="measured_m_s2", parameters={"s": "1"}, typical={"s": 1e-3})
    def flat(run, s):
        """The square of the Y acceleration leaks into X."""
        return run.along_x(s * run.column("gauge"), 0.0 * run.t)

    def leak(_, t_s, out):
        made = np.zeros_like(out)
        made[0, 0] = 0.5 * gauge(t_s)["gauge"]
        return made

    def gauge(t_s):
        return {"gauge": 4e-13 * np.cos(2 * np.pi * 3 / 5950.0 * t_s)}

    plugin = Plugin(None, "", {"flat-y": flat})
    sky = flight.Sky(noise=1.2e-12, seed=1, added=leak)
    study = InflightStudy(recording(flight, sky=sky, columns=gauge, sessions=FEW), [plugin])
    said = diagnose(study, ()).as_json()
    assert said["suggested"] == ["flat-y"]
    found = said["ranking"][0]["parameters"]["s"]
    assert found["value"] == pytest.approx(0.5, abs=4.0 * found["sigma"])


@pytest.mark.parametrize("share", [0.001, 0.4])
def test_missing_samples_cost_precision_and_nothing_else(flight, attempt, share):
    rng = np.random.default_rng(7)

    def lost(_, columns, conditions):
        missing = np.zeros(len(columns["t_s"]), dtype=bool)
        while np.mean(missing) < share:
            at = rng.integers(len(missing))
            missing[at : at + rng.integers(1, 50)] = True
        columns = {name: np.where(missing & (name != "t_s"), np.nan, each) for name, each in columns.items()}
        return columns, conditions

    study = InflightStudy(recording(flight, step_s=flight.STEP_S, spoil=lost))
    found = Attempt(study, ())
    assert np.all(np.abs(pulls(found.estimates(), exact(flight))) < 4.0)
    assert found.error() < 1.25
    remarks = study.data.reduced.runs[0].remarks
    assert remarks[0].endswith("of its samples are missing: lines are fitted on those there are")
    ratio = found.estimates()["ac11_dx_m"].sigma / attempt.estimates()["ac11_dx_m"].sigma
    assert 0.9 < ratio < 2.2


def test_times_that_jump_are_a_gap(flight):
    def cut(_, columns, conditions):
        kept = (columns["t_s"] < 20000.0) | (columns["t_s"] > 20100.0)
        return {name: column[kept] for name, column in columns.items()}, conditions

    study = InflightStudy(recording(flight, step_s=flight.STEP_S, spoil=cut, sessions=("dx", "dz")))
    assert [run.remarks[0][:6] for run in study.data.reduced.runs] == ["0.17 %", "0.17 %"]


def test_short_and_broken_sessions_are_left_out_with_a_reason(flight):
    def short(name, columns, conditions):
        if name == "dz":
            return {key: column[:10000] for key, column in columns.items()}, conditions
        if name == "dy":
            return {key: column for key, column in columns.items() if key != "t_xy"}, conditions
        return columns, conditions

    study = InflightStudy(recording(flight, step_s=flight.STEP_S, spoil=short, sessions=("dx", "dz", "dy", "ad11")))
    study.data.reduced  # noqa: B018
    assert study.left_out["dz"].startswith("run dz: 3.36 orbits are too short to tell its lines apart")
    assert study.left_out["dy"] == "run dy: column t_xy is missing; add it"
    found = calibration(study, parameters_of(study, ()), {})
    assert found["parameters"]["ac11_dz_m"]["paper"] is None
    assert found["parameters"]["ac11_dx_m"]["paper"] is not None
    assert any(remark.startswith("no run for ac11_dy_m, ac11_dz_m") for remark in found["remarks"])


def test_a_model_that_does_not_describe_the_data_says_so(flight, attempt):
    def mistaken(name, columns, conditions):
        return columns, {**conditions, "amplitude": 1e6 * conditions["amplitude"]} if name == "ac12" else conditions

    assert of_misfit(attempt, 1) == []
    [said] = of_misfit(Attempt(InflightStudy(recording(flight, spoil=mistaken)), ()), 3)
    assert said.startswith("the model, version 3, does not describe these data, and no sigma holds: chi2/dof is ")
    assert "run ac12" in said
    assert "own channel, ac12 f in-phase is -" in said


def test_a_parameter_that_a_few_lines_pull_off_is_warned_of(flight, attempt):
    # An output with a cube shows at three times the stimulus, and is taken for gain at the stimulus.
    def cubic(_, columns, conditions):
        return {**columns, "m1_x": columns["m1_x"] + 3e9 * columns["m1_x"] ** 3}, conditions

    spoilt = Attempt(InflightStudy(recording(flight, spoil=cubic)), ())
    place = NAMES.index("ad11")
    off = spoilt.result.values[place] - attempt.result.values[place]
    assert abs(off) > 20.0 * np.sqrt(spoilt.uncertainty.covariance[place, place])
    assert spoilt.result.chi2 < 4.0 * spoilt.result.dof
    [said] = of_misfit(spoilt, 1)
    assert "2 m_dx, ad11 3 f " in said or "2 m_dx, k2d 3 f " in said


def test_runs_that_the_published_estimate_leaves_out_are_named(flight):
    once = recording(flight, spoil=lambda _, columns, conditions: (columns, {**conditions, "start_s": 0.0}))
    [first] = [run for run in once.records if run.conditions["session"] == "ad11"]
    later = replace(first, run_id="later", key="later", conditions={**first.conditions, "start_s": 1e7})
    again = replace(once, records=[*once.records, later], columns={**once.columns, "later": once.columns["ad11"]})
    study = InflightStudy(again)
    [said] = calibration(study, parameters_of(study, ()), {})["remarks"]
    assert said == (
        "the published estimate takes one run of each session, the last: without ad11, which the joint one uses"
    )


def test_sessions_of_the_test_alone_calibrate_nothing(flight):
    one = recording(flight, sessions=("dx",))
    test = [replace(run, conditions={**run.conditions, "session": "ep_inertial"}) for run in one.records]
    with pytest.raises(DataError, match=r"it has sessions of the test only, .*; add some of dx, dz, dx\+dz, dy"):
        InflightStudy(replace(one, records=test)).data  # noqa: B018


def test_only_what_no_session_tells_is_said_to_have_no_run(flight):
    def relabelled(name, columns, conditions):
        return columns, {**conditions, "session": "ad12"} if name == "ad13" else conditions

    flown = [name for name in flight.SESSIONS if name != "ad12"]
    study = InflightStudy(recording(flight, spoil=relabelled, sessions=flown))
    beside, unsettled = calibration(study, parameters_of(study, ()), {})["remarks"]
    assert beside.startswith("no run for ad13_rad: without it")
    assert unsettled.startswith("the published estimate has not settled in 8 sweeps, do not use it: ")


def test_nothing_that_can_be_used_is_one_line(flight):
    def short(_, columns, conditions):
        return {key: column[:100] for key, column in columns.items()}, conditions

    with pytest.raises(
        DataError, match=r"no run of this recording can be used: run dx: 0\.0336 orbits are too short"
    ):
        parameters_of(InflightStudy(recording(flight, step_s=flight.STEP_S, spoil=short, sessions=("dx",))), ())


def test_a_stimulus_of_no_whole_number_of_periods_is_said(flight):
    def cut(_, columns, conditions):
        return {key: column[:-300] for key, column in columns.items()}, conditions

    study = InflightStudy(recording(flight, step_s=flight.STEP_S, spoil=cut, sessions=("ad11",)))
    assert any(
        "72.264 periods in the run, no whole number" in remark for remark in study.data.reduced.runs[0].remarks
    )
    ad11 = parameters_of(study, ())["ad11"]
    assert ad11.value == pytest.approx(exact(flight)[5], abs=5.0 * ad11.sigma + 1e-6)


def test_a_tracker_askew_does_what_the_effect_says(flight):
    """Without noise, what the effect predicts for a known tilt is what the tilt does."""
    tilt = np.array([3e-4, -5e-4, 4e-4])
    sessions = ("dx", "dy", "ac13")
    straight, askew = (
        InflightStudy(recording(flight, sky=sky, sessions=sessions))
        for sky in (flight.Sky(), flight.Sky(unseen_attitude=-tilt))
    )
    moved = askew.data.observations.value - straight.data.observations.value
    model = straight.model(())
    start = np.array([each.start for each in model.parameters])
    start[: len(NAMES)] = exact(flight)
    (candidate,) = [each for each in straight.candidates(model, start)[0] if each.term.effect == "tracker-bias"]
    predicted = candidate.derivative @ tilt
    assert moved == pytest.approx(predicted, abs=0.02 * np.abs(predicted).max())


def test_an_attitude_that_the_hybrid_filter_misses_does_not_move_dy(flight):
    def hybrid(name, columns, conditions):
        if name != "dy":
            return columns, conditions
        seen = np.zeros((3, len(columns["t_s"])))
        seen[2] = 0.99 * columns["att_z"]
        t_seen = flight.gradient(columns["t_s"], seen)
        missed = {
            f"t_{a}{b}": t_seen["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "xz", "yy", "zz", "xy", "yz")
        }
        return {**columns, **missed, "att_z": seen[2]}, conditions

    study = InflightStudy(recording(flight, sky=flight.Sky(), spoil=hybrid))
    found = calibration(study, parameters_of(study, ()), {})["parameters"]["ac11_dy_m"]
    assert found["value"] == pytest.approx(exact(flight)[1], abs=1.5e-9)
    assert found["paper"]["value"] == pytest.approx(exact(flight)[1], abs=4e-9)


def test_pulses_are_found_masked_and_no_longer_there(flight):
    rng = np.random.default_rng(3)

    def crackling(_, t_s, out):
        made = np.zeros_like(out)
        for begin_s in rng.uniform(2000.0, t_s[-1] - 2000.0, 12):
            since_s = np.maximum(t_s - begin_s, 0.0)
            made[0, 0] += 3e-11 * (np.exp(-since_s / 3.0) - np.exp(-since_s / 1.0))
        return made

    study = InflightStudy(
        recording(
            flight,
            step_s=flight.STEP_S,
            sky=flight.Sky(noise=1.2e-12, seed=1, added=crackling),
            sessions=("dx", "dz", "ad11"),
        )
    )
    (found,) = [line for line in study.lines(study.model(())) if line.term.effect == "glitches"]
    assert found.p_value < 1e-6
    assert found.parameters["number"]["value"] == pytest.approx(36, abs=6)
    masked = study.model((found.term,))
    imagined = study.extended(study.options()[:2])
    for terms in ((found.term,), (found.term, Term("noise-level"))):
        # A run that was never flown has no samples to look through.
        assert len(imagined.model(terms).observations.value) > len(masked.observations.value)
        assert imagined.lines(imagined.model(terms)) == study.lines(study.model(terms))
    assert not [line for line in study.lines(masked) if line.term.effect == "glitches"]
    assert len(masked.observations.value) == len(study.data.observations.value)
    assert masked.data.reduced.runs[0].coarse.present.mean() < 0.999


@pytest.mark.parametrize("off", [0.0, 0.2, 0.45])
def test_a_steady_line_has_its_own_frequency_and_not_that_of_the_spectrum_next_to_it(flight, off):
    """Read off the spectrum its amplitude was 15 % too small, and its frequency half a step off, without a sigma."""
    frequency_hz, size = (25 + off) / 59500.0, 3e-12

    def hum(_, columns, conditions):
        wave = size * np.sin(2 * np.pi * frequency_hz * columns["t_s"] + 1.0)
        return columns | {"m2_x": columns["m2_x"] + wave}, conditions

    study = InflightStudy(recording(flight, sessions=("dx", "ad11"), spoil=hum))
    (line,) = [each for each in study.lines(study.model(())) if each.term.effect == "steady-line"]
    frequency, amplitude = line.parameters["frequency"], line.parameters["amplitude"]
    assert 0.0 < frequency["sigma"] < 0.1 / 59500.0
    assert frequency["value"] == pytest.approx(frequency_hz, abs=4.0 * frequency["sigma"])
    assert amplitude["value"] == pytest.approx(size, abs=4.0 * amplitude["sigma"])


def test_a_run_that_is_louder_than_others_is_not_unsteady():
    """Each run's noise is measured in it; what counts is that a level changes while it lasts."""
    rng = np.random.default_rng(4)
    steady = [scale * rng.chisquare(20, 150) / 20 for scale in (1.0, 1.0, 1.0, 1.5, 1.5, 1.0, 1.0, 1.0)]
    assert steadiness(steady).p_value > 0.01
    swell = 1.0 + 0.5 * np.sin(2.0 * np.pi * np.arange(150) / 75.0)
    assert steadiness([each * swell for each in steady]).p_value < 1e-6
    assert steadiness([each[:2] for each in steady]) is None


def test_noise_makes_as_many_large_pulses_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scatter about each place is known to a tenth, by the median of ten minutes: noise goes beyond 4.5 of it six
    times as often as beyond 4.5 of its own sigma."""
    monkeypatch.setattr(residual_samples, "THRESHOLD_SIGMA", 4.5)
    rng, step_s, found, expected, normal = np.random.default_rng(6), 0.25, 0, 0.0, 0.0
    t_s = step_s * np.arange(345_600)
    grid = Grid(t_s, {}, np.ones(len(t_s), dtype=bool))
    for _ in range(16):
        noise = rng.standard_normal(len(t_s))
        clear, density = residual_samples._Clear.of(grid), density_of(noise, grid.present, step_s)
        pulses = residual_samples._pulses(noise, grid, clear, *density)
        found += len(pulses.at_s)
        expected += pulses.by_chance(4.5)
        normal += float(np.sum(2.0 * norm.sf(4.5) * pulses.trials))
    assert abs(found - expected) < 3.0 * np.sqrt(expected)
    assert found - normal > 5.0 * np.sqrt(normal)


@pytest.mark.parametrize("later_s", [12.0, 25.0])
@pytest.mark.parametrize("sizes", [(3e-10, 1e-10), (1e-10, 3e-10), (1e-10, 1e-10)])
def test_of_pulses_that_follow_each_other_each_is_left_out(flight, later_s, sizes):
    """The weaker of two within half a minute was taken for the other: its tail, or all of it, stayed in the data."""
    begins_s = np.arange(3000.0, 57000.0, 1500.0)

    def crackling(_, t_s, out):
        made = np.zeros_like(out)
        for size, begin_s in [(sizes[0], at) for at in begins_s] + [(sizes[1], at + later_s) for at in begins_s]:
            since_s = np.maximum(t_s - begin_s, 0.0)
            made[0, 0] += size * (np.exp(-since_s / 3.0) - np.exp(-since_s / 1.0))
        return made

    sky = flight.Sky(noise=1.2e-12, seed=1, added=crackling)
    study = InflightStudy(recording(flight, step_s=flight.STEP_S, sky=sky, sessions=("dx", "ad11")))
    (found,) = [line for line in study.lines(study.model(())) if line.term.effect == "glitches"]
    assert found.parameters["number"]["value"] == 2 * 2 * len(begins_s)


def test_pulses_that_both_sensors_show_alike_along_x_are_found_across_it(flight):
    """In 2 m_dx nothing is left of what hits masses whose gains differ as the pulses do; along Y other gains hold."""
    rng = np.random.default_rng(5)
    instrument = flight.drawn(1, eta=0.0)

    def crackling(_, t_s, out):
        made = np.zeros_like(out)
        made[:, 1] += instrument.scale[:, 1, None] * 3e-9 * rng.standard_normal(len(t_s))
        made[:, 1:] += 2.5e-12 * rng.standard_normal((2, 2, len(t_s)))
        for begin_s in rng.uniform(2000.0, t_s[-1] - 2000.0, 12):
            since_s = np.maximum(t_s - begin_s, 0.0)
            made[0, 1] += 1e-10 * (np.exp(-since_s / 3.0) - np.exp(-since_s / 1.0))
        return made

    sky = flight.Sky(noise=1.2e-12, seed=1, added=crackling)
    study = InflightStudy(recording(flight, step_s=flight.STEP_S, sky=sky, sessions=("dx", "dz", "ad11")))
    (found,) = [line for line in study.lines(study.model(())) if line.term.effect == "glitches"]
    assert found.p_value < 1e-6
    assert found.parameters["number"]["value"] == pytest.approx(36, abs=6)


@pytest.mark.parametrize("setting", ["amplitude", "calibration_frequency_hz", "phase_rad"])
def test_another_stimulus_is_among_what_can_be_flown_and_tells_what_it_would(flight, plain, setting):
    """As the same session recorded with that stimulus does, to some hundredths of what it tells of its parameter."""
    for name in ("ad11", "k2d", "ac13", "k2c_1"):
        offered = [each for each in plain.options() if each.settings["session"] == name]
        usual = offered[0].settings
        chosen = next(each for each in offered[1:] if each.settings[setting] != usual[setting])
        imagined = plain.extended([chosen]).data.baseline
        wanted = (chosen.settings[key] for key in ("calibration_frequency_hz", "amplitude", "phase_rad"))
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(flight.STIMULI, name, tuple(wanted))
            flown = InflightStudy(recording(flight, sessions=(name,))).data.baseline
        assert [each.run_id for each in imagined.stretches[-2:]] == ["next 1"] * 2
        told, true = (
            each.jacobian(np.array([parameter.start for parameter in each.parameters]))[:, : len(NAMES)]
            for each in (imagined, flown)
        )
        for place, parameter in enumerate(NAMES):
            size = np.abs(true[:, place]).max()
            assert told[-len(true) :, place] == pytest.approx(true[:, place], abs=0.03 * size), (name, parameter)


def test_a_bias_that_drifts_is_seen_where_samples_are_lost_too(flight):
    """Lines are fitted beside a slope there, and have nothing of it."""
    rate = 1e-16

    def drifting(_, own, conditions):
        t_s = own["t_s"]
        lost = np.zeros(len(t_s), dtype=bool)
        for begin_s in np.arange(2500.0, t_s[-1], 7000.0):
            lost |= (t_s > begin_s) & (t_s < begin_s + 60.0)
        moved = {"m1_x": own["m1_x"] + rate * (t_s - t_s.mean())}
        return {name: np.where(lost & (name != "t_s"), np.nan, column) for name, column in (own | moved).items()}, (
            conditions
        )

    study = InflightStudy(recording(flight, spoil=drifting, sessions=("dx", "dz", "ad11")))
    scored = Attempt(study, ()).scored_effect("bias-drift").score
    assert 2.0 * scored.estimate[0] == pytest.approx(rate, abs=4.0 * 2.0 * scored.sigma[0])
    assert scored.sigma[0] < 0.05 * rate


def test_a_spring_that_loses_a_hundred_thousandth_of_the_motion_is_seen(flight):
    """What a moved mass's channel has in quadrature is as well known as its noise is, not as its gain."""
    f_hz, moved_m = flight.STIMULI["k2c_1"]
    loss_1_s2 = 1e-5 * (2 * np.pi * f_hz) ** 2

    def losing(name, own, conditions):
        speed_m_s = -2 * np.pi * f_hz * moved_m * np.sin(2 * np.pi * f_hz * own["t_s"])
        if name == "k2c_1":
            own = own | {"m1_x": own["m1_x"] + loss_1_s2 / (2 * np.pi * f_hz) * speed_m_s}
        return own, conditions

    study = InflightStudy(recording(flight, spoil=losing, sessions=("dx", "dz", "ad11", "k2c_1", "k2c_2")))
    scored = Attempt(study, ()).scored_effect("wire-stiffness")
    place = scored.candidate.names.index("loss_1")
    assert scored.score.estimate[place] == pytest.approx(loss_1_s2, abs=4.0 * scored.score.sigma[place])
    assert scored.score.sigma[place] < 0.2 * loss_1_s2


@pytest.mark.parametrize(("of_signal", "told"), [(False, "since_s"), (True, "signal*since_s")], ids=["bias", "gain"])
def test_what_follows_a_column_of_ones_own_is_told_by_it(flight, of_signal, told):
    """At each line it is little; no catalogue has it."""

    def since(t_s):
        return {"since_s": np.mod(t_s + 1300.0, 9100.0)}

    def following(_, own, conditions):
        shape = (own["since_s"] - 4550.0) / 2600.0
        return own | {"m1_x": own["m1_x"] + shape * (1e-5 * own["m1_x"] if of_signal else 4e-13)}, conditions

    study = InflightStudy(
        recording(flight, step_s=flight.STEP_S, spoil=following, columns=since, sessions=("dx", "dz", "ad11", "k2d"))
    )
    attempt = Attempt(study, ())
    assert attempt.best_shape.shape.covariate == told
    assert p_of_shape(attempt) < 1e-6
    plain = InflightStudy(
        recording(flight, step_s=flight.STEP_S, columns=since, sessions=("dx", "dz", "ad11", "k2d"))
    )
    assert p_of_shape(Attempt(plain, ())) > 1e-3
