"""A run as effects see it: time, what is recorded, what was moved; and what effects do to a run's amplitudes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.effects.trial import AnyColumns
from rigctl.experiments.inflight.observe.grid import Grid
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.series import GRADIENTS, INDEX, SERIES, temperatures
from rigctl.experiments.inflight.observe.sessions import DRIFT, Session, moved_axis, moved_shares
from rigctl.experiments.inflight.observe.weights import amplitudes, drift_weights, weights

MEASURED_POINT, FORCE_POINT, GRADIENT_POINT, PLACE_POINT = (
    "measured_m_s2",
    "mass_force_m_s2",
    "gradient_1_s2",
    "off_centring_m",
)

_MADE_UP = 240


@dataclass(frozen=True)
class FlightRun:
    """One run, thinned to some seconds a sample: what an effect's function is given.

    SI, axes before samples: `measured` (2, 3, n) of masses 1 and 2 along x, y, z; `gradient` (3, 3, n) from orbit and
    attitude telemetry; `attitude`, `angular_acceleration` (3, n); `moved` and `moved_speed` (2, 3, n), how far the
    session displaces each mass. `t` counts from perigee, `orbital` and `stimulus` are angular frequencies (stimulus 0
    without one), `temperature` (2, n) is what the sensors' thermometers say, `warmer` (2, n) how far that is
    from its mean over the recording, K, NaN without. `signal` is the value so far at the point where the effect acts:
    the recorded one. Samples that are missing, not `present` (n,), are zero.
    """

    session: str
    t: FloatArray
    orbital: float
    stimulus: float
    amplitude: float
    measured: FloatArray
    gradient: FloatArray
    attitude: FloatArray
    angular_acceleration: FloatArray
    moved: FloatArray
    moved_speed: FloatArray
    temperature: FloatArray
    warmer: FloatArray
    present: BoolArray
    columns: Mapping[str, FloatArray]
    signal: FloatArray

    @property
    def common(self) -> FloatArray:
        """Mean of both masses, (3, n)."""
        return np.asarray(self.measured.mean(axis=0))

    @cached_property
    def along_x_about_levels(self) -> FloatArray:
        """What both masses measure along x, about its means, (2, n); zero where samples are missing."""
        along = self.measured[:, 0]
        return np.asarray(np.where(self.present, along - along[:, self.present].mean(axis=1, keepdims=True), 0.0))

    def column(self, name: str) -> FloatArray:
        """A column of the run, or of runs.csv, shape (n,)."""
        if name not in self.columns:
            raise DataError(f"there is no column {name} in these runs; they have {', '.join(self.columns)}")
        return self.columns[name]

    def along_x(self, mass_1: FloatArray, mass_2: FloatArray) -> FloatArray:
        """Two series as something that acts along x, (2, 3, n)."""
        made = np.zeros((2, 3, len(self.t)))
        made[0, 0], made[1, 0] = mass_1, mass_2
        return made


def flight_run(
    session: Session, grid: Grid, conditions: Mapping[str, object], point: str, usual_k: FloatArray
) -> FlightRun:
    """The thinned samples of a session for effects at a point; `usual_k` (2,) are the sensors' mean temperatures over
    the recording."""
    known = {
        name: np.full(len(grid.t_s), float(value))
        for name, value in conditions.items()
        if isinstance(value, int | float)
    }
    return _flight(
        session,
        grid.t_s,
        grid.columns,
        {**known, **grid.columns},
        point,
        usual_k,
        grid.present,
    )


def trial_run(point: str) -> FlightRun:
    """A run of moved masses, every column filled, to try effects out on."""
    rng = np.random.default_rng(1)
    session = Session("k2c_1", 5950.0, 4.0, 9e-3, 9e-6)
    t_s = np.linspace(0.0, 50.0 * _MADE_UP, _MADE_UP)
    angle = 2.0 * np.pi * session.orbital_hz * t_s
    u = dict(zip("xyz", (np.cos(angle), np.zeros_like(angle), np.sin(angle)), strict=True))
    sizes = {"m1_": 1e-8, "m2_": 1e-8, "att_": 1e-5, "dw_": 1e-8}
    columns = {
        # GM / r^3 is n^2, 1.1e-6 1/s2 for this orbit.
        **{f"t_{i}{j}": 1.1e-6 * (3.0 * u[i] * u[j] - (i == j)) for i, j in ("xx", "xy", "xz", "yy", "yz", "zz")},
        **{f"{name}{axis}": size * rng.standard_normal(_MADE_UP) for name, size in sizes.items() for axis in "xyz"},
        **{f"temperature_{mass}_k": 1e-3 * rng.standard_normal(_MADE_UP) for mass in (1, 2)},
    }
    return _flight(
        session,
        t_s,
        columns,
        AnyColumns((_MADE_UP,)),
        point,
        np.zeros(2),
        np.ones(_MADE_UP, dtype=bool),
        both_moved=True,
    )


def _flight(
    session: Session,
    t_s: FloatArray,
    c: Mapping[str, FloatArray],
    columns: Mapping[str, FloatArray],
    point: str,
    usual_k: FloatArray,
    present: BoolArray,
    *,
    both_moved: bool = False,
) -> FlightRun:
    """A session with samples `c`; an effect may ask for any of `columns`."""
    measured = np.array([[c[f"m{mass}_{axis}"] for axis in "xyz"] for mass in (1, 2)])
    gradient = np.array([[c[f"t_{''.join(sorted(i + j))}"] for j in "xyz"] for i in "xyz"])
    # On trial both masses move, so that an effect of either is seen to do something.
    moved, speed = (each + 0.5 * both_moved * each[::-1] for each in _moved(session, t_s))
    missing = np.full(len(t_s), np.nan)
    temperature = np.array(temperatures(c) or (missing, missing))
    return FlightRun(
        session=session.name,
        t=t_s,
        orbital=2.0 * np.pi * session.orbital_hz,
        stimulus=2.0 * np.pi * session.frequency_hz,
        amplitude=session.amplitude,
        measured=measured,
        gradient=gradient,
        attitude=np.array([c.get(f"att_{axis}", missing) for axis in "xyz"]),
        angular_acceleration=np.array([c[f"dw_{axis}"] for axis in "xyz"]),
        moved=moved,
        moved_speed=speed,
        temperature=temperature,
        warmer=temperature - usual_k[:, None],
        present=present,
        columns=columns,
        signal={
            MEASURED_POINT: measured,
            # A force shows as the measured acceleration but for the gain, which is 1 to a hundredth.
            FORCE_POINT: measured,
            GRADIENT_POINT: gradient,
            PLACE_POINT: moved[1] - moved[0],
        }[point],
    )


def _moved(session: Session, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    moved, speed = np.zeros((2, 2, 3, len(t_s)))
    if session.moves_masses:
        w = 2.0 * np.pi * session.frequency_hz
        quarter = replace(session, phase_rad=session.phase_rad + 0.5 * np.pi)
        for mass, share in enumerate(moved_shares(session)):
            moved[mass, moved_axis(session)] = share * session.injected(t_s)
            speed[mass, moved_axis(session)] = share * w * quarter.injected(t_s)
    return moved, speed


def added_to_series(
    run_id: str, flight: FlightRun, effect: Effect, parameters: Mapping[str, float]
) -> dict[int, FloatArray]:
    """What an effect adds to the samples of those `SERIES` that it changes, by their place.

    `DataError` when it is no number somewhere.
    """
    added = np.asarray(effect(flight, **parameters), dtype=np.float64)
    try:
        added = np.broadcast_to(added, flight.signal.shape)
    except ValueError:
        raise DataError(
            f"effect '{effect.id}' returns shape {added.shape}, which does not fit run.signal's {flight.signal.shape}"
        ) from None
    if not (np.isfinite(added) | ~flight.present).all():
        raise DataError(f"effect '{effect.id}' is no number in run {run_id}")
    series = _IN_SERIES[effect.on](flight, np.where(flight.present, added, 0.0))
    # Most effects act along one axis.
    return {INDEX[name]: values for name, values in series.items() if values.any()}


class Reducer:
    """What an effect adds, through the reduction of the measurement: one run's halves."""

    def __init__(self, run: ReducedRun, usual_k: FloatArray) -> None:
        self._run, self._usual_k = run, usual_k
        self._flights: dict[str, FlightRun] = {}

    def changes(self, effect: Effect, parameters: Mapping[str, float]) -> list[ComplexArray]:
        """What an effect does to the amplitudes of all series, (lines, series) per half.

        `DataError` when it is no number somewhere.
        """
        if effect.on not in self._flights:
            run = self._run
            self._flights[effect.on] = flight_run(run.session, run.coarse, run.conditions, effect.on, self._usual_k)
        changed = added_to_series(self._run.run_id, self._flights[effect.on], effect, parameters)
        together = np.array(list(changed.values())).reshape(len(changed), len(self._run.coarse.present))
        changes = []
        for where, rows in self._rows:
            table = np.zeros((len(rows) // 2, len(SERIES)), dtype=np.complex128)
            table[:, list(changed)] = amplitudes(rows, together[:, where].T)
            changes.append(table)
        return changes

    @cached_property
    def _rows(self) -> list[tuple[slice, FloatArray]]:
        """Samples and weights of each half of the thinned run."""
        run, stretches = self._run, []
        for half in run.halves:
            inside = (run.coarse.t_s >= half.start_s) & (run.coarse.t_s < half.stop_s)
            where = slice(int(np.argmax(inside)), int(len(inside) - np.argmax(inside[::-1])))
            part = run.coarse.part(where)
            frequencies = [run.session.frequency_of(line) for line in half.lines if line != DRIFT]
            rows = weights(part.t_s, frequencies, part.present)
            if DRIFT in half.lines:
                rows = np.vstack([rows, drift_weights(part.t_s, frequencies, part.present)])
            stretches.append((where, rows))
        return stretches


def _in_measured(run: FlightRun, added: FloatArray) -> dict[str, FloatArray]:
    common, apart = added.mean(axis=0), added[0] - added[1]
    made = {"m1": added[0, 0], "m2": added[1, 0], "y": common[1], "z": common[2]}
    level = added[:, 0, run.present].mean(axis=1)
    # The loop takes the level of what it holds away: without what is added the masses would work that much higher.
    higher = {"k2c_1": level[1], "k2c_2": level[0]}.get(run.session, level.mean())
    made["m1^2"], made["m2^2"] = 2.0 * higher * run.along_x_about_levels
    return made | {f"own {axis}": apart[i] for i, axis in enumerate("xyz")}


def _in_force(_: FlightRun, added: FloatArray) -> dict[str, FloatArray]:
    # What pushes both alike is one more common acceleration, which the baseline has.
    apart = added[0] - added[1]
    return {f"force {axis}": -apart[i] for i, axis in enumerate("xyz")}


def _in_gradient(run: FlightRun, added: FloatArray) -> dict[str, FloatArray]:
    # The true gradient is the recorded one and what is added: what is recorded lacks it.
    made = {name: -added["xyz".index(name[2]), "xyz".index(name[3])] for name in GRADIENTS}
    wave = (run.moved[1] - run.moved[0]).sum(axis=0)
    # There mass 1 moves: the injected signal is minus p_2 - p_1.
    wave = -wave if run.session == "k2c_1" else wave
    return made | {f"moved g_{name}": wave * made[f"t_{name}"] for name in ("xx", "xy", "xz", "yy", "zz")}


def _in_place(run: FlightRun, added: FloatArray) -> dict[str, FloatArray]:
    # T - In, less what is of second order in the rate: in a turning session dw tells more than T.
    force = np.einsum("ijn,jn->in", run.gradient, added) - np.cross(run.angular_acceleration, added, axis=0)
    return {f"force {axis}": -force[i] for i, axis in enumerate("xyz")}


_IN_SERIES: Mapping[str, Callable[[FlightRun, FloatArray], dict[str, FloatArray]]] = {
    MEASURED_POINT: _in_measured,
    FORCE_POINT: _in_force,
    GRADIENT_POINT: _in_gradient,
    PLACE_POINT: _in_place,
}
