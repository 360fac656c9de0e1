"""Every effect that shows, done to an instrument without noise: the data move as its derivative says."""

from dataclasses import replace

import numpy as np
import pytest

from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.effects.catalogue import catalogue
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.experiments.inflight.study_data import usual_temperatures_k
from rigctl.report.verdicts import named

ORBIT_S, STEP_S = 5950.0, 7.0
N = 2 * np.pi / ORBIT_S
SESSIONS = ("dx", "ac12", "ad11", "k2c_1")


WARMER_K = {"dx": 3e-3, "ac12": -1e-3, "ad11": -4e-3, "k2c_1": 2e-3, "dy": -3e-3}
"""Mean temperatures of sessions; both sets of sessions have a mean of zero."""


def warm(session, t_s):
    return WARMER_K[session] + 1e-3 * np.cos(N * t_s + 0.4)


def along_x(first, second, out):
    made = np.zeros_like(out)
    made[0, 0], made[1, 0] = first, second
    return made


def moved(session, t_s):
    f_hz, shares, axis = {
        "ac12": (183 / 59500, (-0.5, 0.5), 1),
        "k2c_1": (535 / 59500, (1.0, 0.0), 0),
    }.get(session, (1e-3, (0.0, 0.0), 0))
    wave = 9e-6 * np.cos(2 * np.pi * f_hz * t_s)
    speed = -2 * np.pi * f_hz * 9e-6 * np.sin(2 * np.pi * f_hz * t_s)
    return 2 * np.pi * f_hz, axis, shares, wave, speed


def stiff(session, t_s, out):
    w, axis, shares, wave, speed = moved(session, t_s)
    made = np.zeros_like(out)
    for mass, (spring, loss) in enumerate(((2e-4, 3e-6), (1e-4, 2e-6))):
        made[mass, axis] = shares[mass] * (spring * wave + loss / w * speed)
    return made


def cubic_spring(session, t_s, out):
    _, axis, shares, wave, _ = moved(session, t_s)
    made = np.zeros_like(out)
    for mass, size in enumerate((4e5, 2e5)):
        made[mass, axis] = size * (shares[mass] * wave) ** 3
    return made


def skewed(session, t_s, out):
    rate = np.gradient(out.mean(axis=0), t_s, axis=1)
    return np.stack([0.5 * 2e-3 * rate, -0.5 * 2e-3 * rate])


def cubed(session, t_s, out):
    # About where each sensor works while control holds the mean of both at zero; in k2c_1 it holds the second there.
    held = out[:, 0].mean(axis=1)
    away = out[:, 0] - (held - held.mean())[:, None]
    return along_x(3e9 * away[0] ** 3, -1e9 * away[1] ** 3, out)


def hotter(session, t_s, out):
    varying = out[:, 0]
    return along_x(
        *(sign * 0.02 * warm(session, t_s) * each for sign, each in zip((1, -1), varying, strict=True)), out
    )


DONE = {
    "thermal-bias": (lambda s, t, out: along_x(3e-10 * warm(s, t), -3e-10 * warm(s, t), out), {"lambda_d": 3e-10}),
    "thermal-bias (of each sensor)": (
        lambda s, t, out: along_x(5e-10 * warm(s, t), -1e-10 * warm(s, t), out),
        {"lambda_d": 3e-10, "lambda_c": 2e-10},
    ),
    "cross-quadratic (of each mass)": (
        lambda s, t, out: along_x(9e3 * out[0, 0] * out[0, 1], -1e3 * out[1, 0] * out[1, 1], out),
        {"k_xy_d": 5e3, "k_xy_c": 4e3},
    ),
    "bias-drift": (
        lambda s, t, out: along_x(2e-17 * t - 3e-22 * t**2, -2e-17 * t + 3e-22 * t**2, out),
        {"rate_d": 2e-17, "curvature_d": -3e-22},
    ),
    "charge": (lambda s, t, out: along_x(2e-17 * t, -2e-17 * t, out), {"charging_d": 2e-17}),
    "magnetic": (
        lambda s, t, out: along_x(4e-13 * np.sin(N * t), -4e-13 * np.sin(N * t), out),
        {"once_sin_d": 4e-13},
    ),
    "sensor-skew": (skewed, {"delay": 2e-3}),
    "cubic-electrode": (cubed, {"k3_1": 3e9, "k3_2": -1e9}),
    "thermal-gain": (hotter, {"kappa_d": 0.02}),
    "wire-stiffness": (stiff, {"stiffness_1": 2e-4, "stiffness_2": 1e-4, "loss_1": 3e-6, "loss_2": 2e-6}),
    "cubic-stiffness": (cubic_spring, {"cubic_1": 4e5, "cubic_2": 2e5}),
}


def study(flight, instrument, added=None, unseen=(0.0, 0.0, 0.0), sessions=SESSIONS):
    records, samples = [], {}
    for name in sessions:
        sky = flight.Sky(added=added, unseen_attitude=np.array(unseen))
        own, conditions = flight.recorded(name, instrument, sky, orbits=10, step_s=STEP_S)
        own |= {f"temperature_{mass}_k": 290.0 + warm(name, own["t_s"]) for mass in (1, 2)}
        records.append(RunRecord(name, name, "test", conditions))
        samples[name] = own
    header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S})
    return InflightStudy(Recording(header, records, samples, ImportReport(len(records))))


@pytest.fixture(scope="module")
def instrument(flight):
    return flight.drawn(9, eta=0.0)


@pytest.fixture(scope="module")
def plain(flight, instrument):
    return study(flight, instrument)


@pytest.mark.parametrize("name", DONE)
def test_data_move_as_the_derivative_says(flight, instrument, plain, name):
    added, sizes = DONE[name]
    moves_as_predicted(flight, instrument, plain, study(flight, instrument, added), name, sizes)


def moves_as_predicted(flight, instrument, plain, spoilt, name, sizes, least=1e-14):
    changed = spoilt.data.observations.value - plain.data.observations.value
    model = plain.model(())
    start = np.array([each.start for each in model.parameters])
    start[: len(NAMES)] = [flight.small_signal(instrument)[each] for each in NAMES]
    candidates, _ = plain.candidates(model, start)
    (candidate,) = [each for each in candidates if named(each.term.effect, each.term.choice) == name]
    predicted = candidate.derivative @ [sizes.get(parameter, 0.0) for parameter in candidate.names]
    assert np.abs(predicted).max() > least
    assert changed == pytest.approx(predicted, abs=0.03 * np.abs(predicted).max())


def test_a_cubic_part_bends_otherwise_where_control_holds_one_mass(flight, instrument, plain):
    """The quadratic factors of sessions k2c are those elsewhere on the curve: a line at twice the stimulus."""
    spoilt = study(flight, instrument, cubed)
    given = plain.data.observations
    at_twice = np.array([each.component.startswith("k2c_1 2 f") for each in given.series])[given.series_of]
    changed = (spoilt.data.observations.value - given.value)[at_twice]
    assert np.abs(changed).max() > 5.0 * given.sigma[at_twice].max()
    moves_as_predicted(flight, instrument, plain, spoilt, "cubic-electrode", {"k3_1": 3e9, "k3_2": -1e9})


@pytest.mark.parametrize(
    ("name", "beta"),
    [
        ("thermal-off-centring", {"beta": 2e-4}),
        ("thermal-off-centring (of each axis)", {"beta": 1e-4, "beta_y": 2e-4, "beta_z": -1e-4}),
    ],
)
def test_a_place_that_goes_with_the_temperature_meets_the_gradient_and_the_turning(flight, instrument, name, beta):
    def parted(session, t_s, out):
        w, turn = 2.0 * np.pi * flight.STIMULI["dy"][0], np.zeros((3, len(t_s)))
        turn[2] = (session == "dy") * 1e-2 * np.cos(w * t_s)
        tensor = flight.gradient(t_s, turn)
        # T - In: Euler's acceleration dw x Delta.
        tensor[0, 1] -= w**2 * turn[2]
        tensor[1, 0] += w**2 * turn[2]
        growth = [beta.get(axis, 0.0) * warm(session, t_s) for axis in ("beta", "beta_y", "beta_z")]
        force = np.einsum("ijn,jn->in", tensor, growth)
        return 0.5 * np.stack([force, -force])

    plain, spoilt = (study(flight, instrument, added, sessions=("dx", "dy")) for added in (None, parted))
    moves_as_predicted(flight, instrument, plain, spoilt, name, beta)


@pytest.mark.parametrize("sensors", [(1.0, 0.0), (0.5, 0.5)])
def test_a_bias_in_the_loop_moves_the_point_at_which_the_masses_work(flight, instrument, sensors):
    """The loop takes the mean of both biases away; where the outputs are curved, the gains' difference follows."""
    warmer_k = {"ad11": 3e-1, "dx": -3e-1}

    def warmed(size):
        records, samples = [], {}
        for name, warm_k in warmer_k.items():
            bias = instrument.bias + size * warm_k * np.outer(sensors, [1.0, 0.0, 0.0])
            own, conditions = flight.recorded(name, replace(instrument, bias=bias), orbits=10, step_s=STEP_S)
            own |= {f"temperature_{mass}_k": 290.0 + warm_k + 0.0 * own["t_s"] for mass in (1, 2)}
            records.append(RunRecord(name, name, "test", conditions))
            samples[name] = own
        header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S})
        return InflightStudy(Recording(header, records, samples, ImportReport(len(records))))

    first, second = (4e-9 * each for each in sensors)
    sizes = {"lambda_d": (first - second) / 2.0, "lambda_c": (first + second) / 2.0}
    moves_as_predicted(
        flight, instrument, warmed(0.0), warmed(4e-9), "thermal-bias (of each sensor)", sizes, least=1e-15
    )


def test_what_is_missing_has_no_temperature(plain):
    """Columns are zero where samples miss."""
    runs = list(plain.data.reduced.runs)
    whole = usual_temperatures_k(runs)
    assert whole == pytest.approx([290.0, 290.0], abs=1e-4)
    grid = runs[0].coarse
    there = np.arange(len(grid.t_s)) % 10 != 0
    columns = {name: np.where(there, column, 0.0) for name, column in grid.columns.items()}
    runs[0] = replace(runs[0], coarse=replace(grid, columns=columns, present=there))
    assert usual_temperatures_k(runs) == pytest.approx(whole, abs=1e-3)


def test_the_oblateness_of_the_earth_is_a_harmonic_field():
    """Its part of the gradient has no trace, and is symmetric, for any direction of the pole."""
    from rigctl.experiments.inflight.model.flight import trial_run

    run = trial_run("gradient_1_s2")
    pole = np.array([0.3, -0.2, 0.9])
    pole /= np.linalg.norm(pole)
    products = 1e-3 * np.outer(pole, pole)
    added = catalogue("inflight-calibration")["gravity-j2"](
        run,
        j_xx=products[0, 0],
        j_zz=products[2, 2],
        j_yy=products[1, 1],
        j_xz=products[0, 2],
        j_xy=products[0, 1],
        j_yz=products[1, 2],
    )
    assert np.abs(np.trace(added)).max() < 1e-12 * np.abs(added).max()
    assert added == pytest.approx(np.swapaxes(added, 0, 1), abs=1e-24)
    axis_m = (3.986004418e14 / run.orbital**2) ** (1 / 3)
    step_m = 1.0

    def potential(place_m):
        r = np.linalg.norm(place_m)
        latitude = pole @ place_m / r
        return -3.986004418e14 * 1e-3 * 6378137.0**2 / r**3 * 0.5 * (3 * latitude**2 - 1)

    place_m = axis_m * np.array([np.cos(run.orbital * run.t[70]), 0.0, np.sin(run.orbital * run.t[70])])
    steps = 2e3 * step_m * np.eye(3)
    hessian = [
        [
            sum(s * q * potential(place_m + s * a + q * b) for s in (1, -1) for q in (1, -1))
            / (4 * (2e3 * step_m) ** 2)
            for b in steps
        ]
        for a in steps
    ]
    assert added[:, :, 70] == pytest.approx(np.array(hessian), abs=2e-3 * np.abs(added).max())
