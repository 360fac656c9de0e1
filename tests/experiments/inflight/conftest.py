"""An instrument in free fall, from Newton's law and the sensor's equation, for tests of the analysis.

It is independent of the simulated worlds: the drag-free loop is perfect (the controlled acceleration is given), found
sample by sample, and the attitude is given. Matrices are not expanded.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

ORBIT_S, ECCENTRICITY = 5950.0, 5e-3
N = 2.0 * np.pi / ORBIT_S
STEP_S = 2.0
F_LINEAR, F_MASS, F_QUADRATIC = 73 / (10 * ORBIT_S), 183 / (10 * ORBIT_S), 535 / (10 * ORBIT_S)
HELD_M_S2 = 1e-21
"""What the loop may leave: rounding, a millionth of what an off-centring of 1e-9 m does."""
STIMULI = {
    "dx": (0.0, 0.0),
    "dz": (0.0, 0.0),
    "dx+dz": (0.0, 0.0),
    "dy": (F_LINEAR, 1e-2),
    "ac12": (F_MASS, 9e-6),
    "ac13": (F_MASS, 9e-6),
    **dict.fromkeys(("ad11", "ad12", "ad13", "k2d"), (F_LINEAR, 5e-8)),
    **dict.fromkeys(("k2c_1", "k2c_2"), (F_QUADRATIC, 9e-6)),
}
ORBITS = {"ac12": 40}


def rotation(tx, ty, tz):
    return np.array([[0.0, tz, -ty], [-tz, 0.0, tx], [ty, -tx, 0.0]])


def coupling(ex, ey, ez):
    return np.array([[0.0, ez, ey], [ez, 0.0, ex], [ey, ex, 0.0]])


@dataclass(frozen=True)
class Instrument:
    """Per mass (1, 2): scale factors (2, 3), rotations (2, 3), couplings (2, 3), quadratic factors (2, 3), biases."""

    off_centring: np.ndarray
    scale: np.ndarray
    rotation: np.ndarray
    coupling: np.ndarray
    quadratic: np.ndarray
    parasitic: np.ndarray
    bias: np.ndarray

    @property
    def matrices(self):
        return np.array(
            [
                (np.diag(self.scale[k]) + coupling(*self.coupling[k])) @ (np.eye(3) + rotation(*self.rotation[k]))
                for k in (0, 1)
            ]
        )


def pair(common, half_difference):
    return np.array([common + half_difference, common - half_difference])


def drawn(seed, eta=1.0):
    rng = np.random.default_rng(seed)

    def uniform(size):
        return rng.uniform(-size, size, 3)

    return Instrument(
        off_centring=uniform(2e-5),
        scale=pair(1.0 + uniform(1e-2), uniform(1e-2)),
        rotation=pair(uniform(2.5e-3), uniform(1.5e-3)),
        coupling=eta * pair(uniform(1e-4), uniform(1e-4)),
        quadratic=pair(uniform(14000.0), uniform(14000.0)),
        parasitic=pair(uniform(1e-8), uniform(1.4e-8)),
        bias=pair(uniform(2e-8), uniform(1e-8)),
    )


def small_signal(instrument):
    """Exact values at the operating point, where the loop holds mean(m_c) = 0; by the fixed names."""
    at = operating_point(instrument) + instrument.parasitic
    slope = instrument.matrices + 2.0 * np.array([np.diag(instrument.quadratic[k] * at[k]) for k in (0, 1)])
    j_c, j_d = 0.5 * (slope[0] + slope[1]), 0.5 * (slope[0] - slope[1])
    a_d = (j_d @ np.linalg.inv(j_c))[0]
    a_c = j_c - j_d @ np.linalg.inv(j_c) @ j_d
    k2 = instrument.quadratic[:, 0]
    k2_c, k2_d = 0.5 * (k2[0] + k2[1]), 0.5 * (k2[0] - k2[1])
    k = k2 / slope[:, 0, 0] ** 2
    dx, dy, dz = a_c[0, 0] * instrument.off_centring
    return {
        "ac11_dx_m": dx,
        "ac11_dy_m": dy,
        "ac11_dz_m": dz,
        "ac12_rad": a_c[0, 1],
        "ac13_rad": a_c[0, 2],
        "ad11": a_d[0],
        "ad12_rad": a_d[1],
        "ad13_rad": a_d[2],
        "k2d_s2_m": (k2_d - a_d[0] * k2_c) / j_c[0, 0] ** 2,
        "k2c_s2_m": 0.5 * (k[0] + k[1]),
    }


def operating_point(instrument):
    """The satellite's acceleration at which the mean of both outputs is nil."""
    common = np.zeros(3)
    for _ in range(60):
        out = np.mean([output(instrument, k, common[:, None])[:, 0] for k in (0, 1)], axis=0)
        common = common - out
    return common


def output(instrument, k, held):
    """Measured acceleration of a mass for what holds it against all but the parasitic force, (3, samples)."""
    matrix = instrument.matrices[k]
    free = instrument.parasitic[k][:, None]
    applied = held + free
    whole = np.diag(instrument.scale[k]) + coupling(*instrument.coupling[k])
    return (
        instrument.bias[k][:, None]
        + matrix @ (applied - free)
        + whole @ free
        + instrument.quadratic[k][:, None] * applied**2
    )


def gradient(t, attitude):
    """Gravity gradient (3, 3, samples) in a frame turned by small angles (3, samples) against the inertial one."""
    mean = N * t
    nu, cube = mean + 2.0 * ECCENTRICITY * np.sin(mean), 1.0 + 3.0 * ECCENTRICITY * np.cos(mean)
    rho = np.array([np.cos(nu), np.zeros_like(nu), np.sin(nu)])
    a, b, c = attitude
    rho = rho + np.array([c * rho[1] - b * rho[2], -c * rho[0] + a * rho[2], b * rho[0] - a * rho[1]])
    return N**2 * cube * (3.0 * rho[:, None] * rho[None] - np.eye(3)[:, :, None])


@dataclass(frozen=True)
class Sky:
    """What surrounds the instrument: attitude unknown to the tracker, residual accelerations, noise of X outputs."""

    unseen_attitude: np.ndarray = field(default_factory=lambda: np.zeros(3))
    residual: float = 1e-12
    noise: float = 0.0
    blue: float = 0.0
    seed: int = 0
    added: object = None


def recorded(session, instrument, sky=Sky(), orbits=None, step_s=STEP_S):
    """Columns of a run of a session, and its conditions."""
    orbits = orbits or ORBITS.get(session, 10)
    f, amplitude, phase = (*STIMULI[session], 0.0)[:3]
    count = round(orbits * ORBIT_S / step_s)
    t = np.arange(count) * step_s
    w, wave, zero = 2.0 * np.pi * f, amplitude * np.cos(2.0 * np.pi * f * t + phase), np.zeros(count)
    seen, spin_up = np.zeros((3, count)), np.zeros((3, count))
    if session == "dy":
        seen[2], spin_up[2] = wave, -(w**2) * wave
    t_true = gradient(t, seen + sky.unseen_attitude[:, None])
    d = spin_up
    inertia = np.array([[zero, -d[2], d[1]], [d[2], zero, -d[0]], [-d[1], d[0], zero]])
    position, acceleration = np.zeros((2, 3, count)), np.zeros((2, 3, count))
    position[0], position[1] = -0.5 * instrument.off_centring[:, None], 0.5 * instrument.off_centring[:, None]
    own = [(np.eye(3) + rotation(*instrument.rotation[k])).T for k in (0, 1)]
    moves = {
        "ac12": [(0, 1, -0.5), (1, 1, 0.5)],
        "ac13": [(0, 2, -0.5), (1, 2, 0.5)],
        "k2c_1": [(0, 0, 1.0)],
        "k2c_2": [(1, 0, 1.0)],
    }
    for k, axis, share in moves.get(session, []):
        position[k] += share * own[k][:, axis][:, None] * wave
        acceleration[k] -= w**2 * share * own[k][:, axis][:, None] * wave
    apart = np.array([-np.einsum("ijn,jn->in", t_true - inertia, position[k]) + acceleration[k] for k in (0, 1)])
    wanted = sky.residual * np.array([np.cos(N * t), np.sin(N * t), np.cos(2 * N * t + 1.0)])
    if session in ("ad11", "k2d"):
        wanted[0] += wave
    elif session in ("ad12", "ad13"):
        wanted[1 if session == "ad12" else 2] += wave
    share = {"k2c_1": (0.0, 1.0), "k2c_2": (1.0, 0.0)}.get(session, (0.5, 0.5))
    common = np.zeros((3, count)) + operating_point(instrument)[:, None]
    for _ in range(30):
        out = np.array([output(instrument, k, common + apart[k]) for k in (0, 1)])
        missed = share[0] * out[0] + share[1] * out[1] - wanted
        if np.abs(missed).max() < HELD_M_S2:
            break
        common -= missed
    else:
        raise AssertionError("the loop does not hold")
    if sky.added is not None:
        out = out + sky.added(session, t, out)
    rng = np.random.default_rng([sky.seed, sorted(STIMULI).index(session)])
    if sky.noise or sky.blue:
        out[:, 0] += sky.noise / np.sqrt(2.0 * step_s) * rng.standard_normal((2, count))
        white = rng.standard_normal((2, count + 2))
        out[:, 0] += sky.blue * np.diff(white, 2, axis=1)
    t_seen = gradient(t, seen)
    columns = {"t_s": t}
    columns |= {f"m{k + 1}_{axis}": out[k, i] for k in (0, 1) for i, axis in enumerate("xyz")}
    columns |= {f"t_{p}": t_seen["xyz".index(p[0]), "xyz".index(p[1])] for p in ("xx", "xz", "yy", "zz", "xy", "yz")}
    columns |= {f"dw_{axis}": spin_up[i] for i, axis in enumerate("xyz")}
    columns |= {f"att_{axis}": seen[i] for i, axis in enumerate("xyz")}
    columns |= {f"command_{axis}": zero for axis in "xyz"}
    conditions = {"session": session, "orbits": float(orbits), "sample_period_s": step_s, "phase_rad": phase}
    if f:
        unit = {"dy": "rad"}.get(session, "m" if session in moves else "m/s2")
        conditions |= {"calibration_frequency_hz": f, "amplitude": amplitude, "amplitude_unit": unit}
    return columns, conditions


class Flight:
    """The generator as tests use it."""

    Instrument, Sky, STIMULI = Instrument, Sky, STIMULI
    drawn, small_signal, recorded, replace = (
        staticmethod(drawn),
        staticmethod(small_signal),
        staticmethod(recorded),
        staticmethod(replace),
    )
    ORBIT_S, STEP_S, SESSIONS = ORBIT_S, STEP_S, tuple(name for name in STIMULI if name != "dx+dz")
    pair = staticmethod(pair)
    gradient = staticmethod(gradient)


@pytest.fixture(scope="session")
def flight():
    return Flight
