"""A session of the test itself reduced: how much of each series goes with gravity, in one pass over its samples.

All series are fitted by gravity along X and along Z, which is in quadrature, by lines that orbit and turning make,
and by what is slow, with weights that go smoothly to nothing at gaps and ends. The fit is linear in the series, so
that whatever an equation makes of them is found afterwards, for any parameters. Frequencies beside that of the test,
where nothing is to be expected, tell the noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.grid import grid_of
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, covered, raw_series
from rigctl.experiments.inflight.observe.sessions import Session, fewest_orbits, session_of
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.observe.weights import FEWEST_SAMPLES, taper

GRAVITY = ("g_x", "g_z")
BESIDE_ORBITAL = 0.45
"""Half the width, in frequencies of the orbit, of the band beside the test's line in which noise is looked at."""

_BESIDE = 20
_CHUNK = 1 << 14
_WAVES = 3
_SINGULAR = 1e-10


@dataclass(frozen=True)
class Acting:
    """What each unit of an effect's parameter does to `TestRun.amplitudes` and `TestRun.beside`."""

    amplitudes: FloatArray
    beside: FloatArray


@dataclass(frozen=True)
class TestRun:
    """A reduced session: `amplitudes` (2, series) of each series on g_x and g_z [per m/s2], `spread` (2,) the
    standard uncertainty of one in noise of unit density, `beside` (2 lines, series) cosines and sines near the test's
    frequency, scaled so that their variance is the density. `missing` is a fraction, and counts what is masked
    about pulses, which begin at `pulses_s`."""

    __test__ = False

    run_id: str
    session: Session
    orbits: float
    missing: float
    amplitudes: FloatArray
    beside: FloatArray
    spread: FloatArray
    pulses_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    acting: tuple[Acting, ...] = ()
    """What effects of a model do, one for each of their parameters; `amplitudes` and `beside` have all of it."""

    @property
    def pulses(self) -> int:
        """How many were found."""
        return len(self.pulses_s)

    @property
    def dof(self) -> int:
        """Amplitudes that tell the noise."""
        return len(self.beside)

    def about(self, level_m_s2: float) -> TestRun:
        """With powers of x counted from the level of m_dx while the calibration was flown, like quadratic factors."""
        return replace(
            self, amplitudes=_counted(self.amplitudes, level_m_s2), beside=_counted(self.beside, level_m_s2)
        )

    @property
    def beside_hz(self) -> list[float]:
        """The frequencies of `beside`, two rows each."""
        return frequencies_beside(self.session, self.orbits * self.session.orbit_period_s)

    @property
    def test_hz(self) -> float:
        """The frequency at which the satellite sees the Earth go round."""
        return self.session.orbital_hz + self.session.spin_hz


def reduce_test(
    run_id: str,
    conditions: Mapping[str, object],
    samples: Mapping[str, FloatArray],
    orbit_period_s: float,
) -> TestRun:
    """Reduce a session without the pulses that it shows; `DataError` when it is too short, too patchy, or has no
    gravity in its telemetry."""
    absent = [name for name in GRAVITY if name not in samples]
    if absent:
        raise DataError(f"run {run_id}: column {absent[0]} is missing; add gravity as orbit and attitude give it")
    grid = grid_of(run_id, samples)
    session = session_of(run_id, conditions, orbit_period_s, grid.step_s)
    orbits = grid.duration_s / orbit_period_s
    if orbits < (least := fewest_orbits(session.name)):
        raise DataError(f"run {run_id}: {orbits:.3g} orbits are too short; record at least {least:g}")
    present = grid.present & np.all([np.isfinite(grid.columns[name]) for name in GRAVITY], axis=0)
    if np.count_nonzero(taper(present, grid.step_s)) < FEWEST_SAMPLES * len(present):
        raise DataError(f"run {run_id}: {100.0 * np.mean(present):.0f} % of the samples are there, too few")
    from rigctl.experiments.inflight.observe.pulses import pulses_of  # scipy.signal, which no calibration needs

    pulses_s = pulses_of(grid, [session.orbital_hz + session.spin_hz, *known_lines(session, grid.duration_s)])
    present &= ~covered(grid.t_s, pulses_s)
    sums = TestSums(session, grid.t_s, taper(present, grid.step_s), 1, grid.duration_s)
    for start in range(0, len(grid.t_s), _CHUNK):
        # A sample more on either side: rates are differences.
        here = slice(max(start - 1, 0), start + _CHUNK + 1)
        inner = slice(start - here.start, start - here.start + min(_CHUNK, len(grid.t_s) - start))
        sums.add(start, inner, [{name: column[here] for name, column in grid.columns.items()}])
    return replace(sums.runs([run_id])[0], missing=1.0 - float(np.mean(present)), pulses_s=np.array(pulses_s))


class TestSums:
    """Sums over the samples of a session that lasts `duration_s`, of several satellites flown alike: what all of them
    share is made once."""

    __test__ = False

    def __init__(
        self, session: Session, t_s: FloatArray, weight: FloatArray, satellites: int, duration_s: float
    ) -> None:
        self._session, self._t_s, self._weight, self._duration_s = session, t_s, weight, duration_s
        waves = [wave / self._duration_s for wave in range(1, _WAVES + 1)]
        known_hz = known_lines(session, self._duration_s)
        self._lines_hz = [*waves, *known_hz, *frequencies_beside(session, self._duration_s)]
        self._fitted = len(GRAVITY) + _SLOW + 2 * (len(waves) + len(known_hz))
        count = _SLOW + 2 * len(self._lines_hz)
        self._shared = np.zeros((2, count, count))
        self._own = np.zeros((satellites, 2, len(GRAVITY), len(GRAVITY) + count))
        self._series = np.zeros((satellites, len(GRAVITY) + count, len(SERIES)))

    def add(self, start: int, inner: slice, satellites: Sequence[Mapping[str, FloatArray]]) -> None:
        """Samples from number `start` on: the `inner` ones of columns, by satellite."""
        gravity = (np.stack([columns[name][inner] for name in GRAVITY]) for columns in satellites)
        series = (_series(self._session, columns)[inner] for columns in satellites)
        self.add_series(start, inner.stop - inner.start, zip(gravity, series, strict=True))

    def add_series(self, start: int, count: int, satellites: Iterable[tuple[FloatArray, FloatArray]]) -> None:
        """`count` samples from number `start` on: gravity (2, count) and `SERIES` (count, series), by satellite."""
        at = slice(start, start + count)
        t_s, w = self._t_s[at], self._weight[at]
        x = 2.0 * (t_s - self._t_s[0]) / self._duration_s - 1.0
        rows = np.vstack([np.ones_like(x), x, x**2, templates(t_s, self._lines_hz)])
        weighted = rows * w
        self._shared += weighted @ rows.T, weighted @ weighted.T
        for place, (gravity, series) in enumerate(satellites):
            pulled = gravity * w
            self._own[place, 0] += pulled @ np.vstack([gravity, rows]).T
            self._own[place, 1] += pulled @ np.vstack([pulled, weighted]).T
            self._series[place] += np.vstack([pulled, weighted]) @ series

    def runs(self, run_ids: Sequence[str]) -> list[TestRun]:
        """What the sums come to, by satellite; `DataError` where gravity cannot be told from lines beside it."""
        return [self._run(run_id, place) for place, run_id in enumerate(run_ids)]

    def _run(self, run_id: str, place: int) -> TestRun:
        k, step_s, own = self._fitted, self._session.sample_period_s, self._own[place]
        two = len(GRAVITY)
        products, squares = (np.block([[own[n]], [own[n][:, two:].T, self._shared[n]]]) for n in (0, 1))
        inverse = _inverse(run_id, products[:k, :k])
        fitted = inverse @ self._series[place, :k]
        # What lines and levels do at the frequencies beside is taken out of what is found there.
        takes = products[k:, :k]
        beside = self._series[place, k:] - takes @ fitted
        rows = np.hstack([-takes @ inverse, np.eye(len(takes))])
        unit = np.sqrt(np.einsum("ri,ij,rj->r", rows, squares, rows) / (2.0 * step_s))
        spread = np.sqrt(np.diag(inverse @ squares[:k, :k] @ inverse.T)[:2] / (2.0 * step_s))
        orbits = self._duration_s / self._session.orbit_period_s
        return TestRun(run_id, self._session, orbits, 0.0, fitted[:2], beside / unit[:, None], spread)


_SLOW = 3
"""A constant, a slope, a bend; waves of the whole session come besides."""


def known_lines(session: Session, duration_s: float) -> list[float]:
    """What gradient, drag and torque make besides: none within the band that tells the noise."""
    n, spin, test = session.orbital_hz, session.spin_hz, session.orbital_hz + session.spin_hz
    if spin == 0.0:
        return [k * n for k in (2, 3, 4)]
    wanted = [n, 2 * n, spin - n, spin, spin + 2 * n, spin + 3 * n, 2 * test - n, 2 * test, 2 * test + n]
    kept: list[float] = []
    for f_hz in sorted(wanted):
        apart = min(abs(f_hz - other) for other in [0.0, test, *kept])
        if apart * duration_s > _WAVES + 0.9 and f_hz > 0.0:
            kept.append(f_hz)
    return kept


def frequencies_beside(session: Session, duration_s: float) -> list[float]:
    """Where nothing is to be expected but noise: what is found there tells its level."""
    test = session.orbital_hz + session.spin_hz
    widest = int(BESIDE_ORBITAL * session.orbital_hz * duration_s)
    places = np.unique(np.linspace(2, max(widest, 3), _BESIDE // 2).astype(int))
    return [test + sign * place / duration_s for place in places for sign in (-1.0, 1.0)]


def _series(session: Session, columns: Mapping[str, FloatArray]) -> FloatArray:
    """`SERIES` of some samples, (samples, series); T less turning."""
    if session.spin_hz:
        columns = {**columns, **less_inertia(session, session.sample_period_s, columns)}
    # No mass is moved: times do not matter.
    return raw_series(session, np.empty(0), columns)


def _counted(table: FloatArray, level_m_s2: float) -> FloatArray:
    """Binomials; what is constant is in no line."""
    made, at = table.copy(), INDEX
    for name, level in (("m1", level_m_s2), ("m2", -level_m_s2)):
        one, two = table[:, at[name]], table[:, at[f"{name}^2"]]
        made[:, at[f"{name}^2"]] -= 2.0 * level * one
        made[:, at[f"{name}^3"]] += 3.0 * level**2 * one - 3.0 * level * two
    made[:, at["m1 m2"]] += level_m_s2 * (table[:, at["m1"]] - table[:, at["m2"]])
    return made


def less_inertia(session: Session, step_s: float, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """T - In but for the angular acceleration, from the attitude's rates and the turning itself."""
    spin = 2.0 * np.pi * session.spin_hz
    x, y, z = (columns[f"att_{axis}"] for axis in "xyz")
    wx, wy, wz = (np.gradient(angle, step_s) for angle in (x, y, z))
    # Angles count from axes that turn by -spin about Y.
    wx, wy, wz = wx - spin * z, wy - spin, wz + spin * x
    return {
        "t_xx": columns["t_xx"] + wy**2 + wz**2,
        "t_yy": columns["t_yy"] + wx**2 + wz**2,
        "t_zz": columns["t_zz"] + wx**2 + wy**2,
        "t_xy": columns["t_xy"] - wx * wy,
        "t_xz": columns["t_xz"] - wx * wz,
        "t_yz": columns["t_yz"] - wy * wz,
    }


def _inverse(run_id: str, normal: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(normal))
    scaled = normal / np.outer(size, size)
    values = np.linalg.eigvalsh(scaled)
    if not values[0] > _SINGULAR * values[-1]:
        raise DataError(f"run {run_id}: the samples cannot tell gravity from the lines beside it: record longer")
    return np.asarray(np.linalg.inv(scaled) / np.outer(size, size))
