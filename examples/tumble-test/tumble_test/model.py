"""Baseline and effects: what each sensor puts out at each position, by the model equation of IEEE Std 1293, in SI.

E = K1 (K0 + a_i + K2 a_i^2 + K3 a_i^3 + delta_o a_p - delta_p a_o + K_ip a_i a_p + K_io a_i a_o)          (4)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.placed import Placed
from rigctl.workbench.study import NoisePool, Observations, Series
from tumble_test.observables import Reduced
from tumble_test.positions import AXES, TumbleRun, case_axes

OF_A_SENSOR = ("K1", "K0", "delta_o", "delta_p", "K2", "K3", "K_ip", "K_io")
"""Where positions are too few to tell them all, the later ones are held."""

UNITS = ("V s2/m", "m/s2", "rad", "rad", "s2/m", "s4/m2", "s2/m", "s2/m")
STEPS = (1e-4, 1e-3, 1e-4, 1e-4, 1e-5, 1e-6, 1e-5, 1e-5)
SEAT_STEP_RAD = 1e-4
_OWN_PART = 1e-6
"""A parameter is held of whose derivative less than this part is no other parameter's."""


class Bench(NamedTuple):
    """Gravity, and as standard uncertainties how well a case is seated and how the head's stops scatter."""

    g_m_s2: float = 9.80665
    seat_rad: float = 1e-4
    angle_scatter_rad: float = 0.0


@dataclass(frozen=True)
class Recorded:
    """All positions: the data, the head as it reads, and of each datum its sensor's and its mounting's place.

    Runs beyond the first `measured` are imagined. `gains` are V s2/m by sensor, from a straight line through all.
    """

    runs: tuple[Reduced, ...]
    bench: Bench
    measured: int
    observations: Observations
    run: TumbleRun
    sensors: tuple[str, ...]
    seats: tuple[tuple[str, float, int], ...]
    place: IntArray
    seat_of: IntArray
    gains: FloatArray


def recorded(runs: Sequence[Reduced], bench: Bench, some: int | None = None) -> Recorded:
    """The positions of runs, of which all, or the first so many, were measured and the others are imagined."""
    measured = len(runs) if some is None else some
    sensors = tuple(name for name in AXES if any(name in run.mean_v for run in runs))
    rows = [(i, place) for i, run in enumerate(runs) for place, name in enumerate(sensors) if name in run.mean_v]
    of_run, place = np.array(rows, dtype=np.intp).T
    seats = tuple(dict.fromkeys(run.seat for run in runs))
    seat_of = np.array([seats.index(run.seat) for run in runs], dtype=np.intp)[of_run]
    value = np.array([runs[i].mean_v[sensors[j]] for i, j in rows])
    names = dict.fromkeys(name for run in runs for name in run.conditions if name != "angle_asked_deg")
    known = {name: np.array([run.number(name) for run in runs]) for name in (*names, "approach")}
    t = known.get("start_s", np.nan) + np.array([0.5 * run.duration_s for run in runs])
    warm = known.get("temperature_c", np.full(len(runs), np.nan))
    head = TumbleRun(
        theta=np.deg2rad(known["angle_deg"])[of_run],
        approach=known["approach"][of_run],
        temperature=warm[of_run],
        t=t[of_run],
        sensor=np.array([AXES.index(name) for name in sensors])[place],
        axes=np.array([case_axes(out, np.deg2rad(clocking)) for out, clocking, _ in seats])[seat_of],
        g=bench.g_m_s2,
        temperature_0=float(np.mean(warm[:measured])),
        t_0=float(np.mean(t[:measured])),
        columns={name: column[of_run] for name, column in known.items()},
    )
    nothing = np.zeros(len(value))
    run = head.standing(nothing, nothing, np.zeros((len(value), 3)))
    line = np.stack([run.a_i, run.a_p, run.a_o, np.ones(len(value))], axis=1)
    own = [(place == j) & (of_run < measured) for j in range(len(sensors))]
    gains = np.array([np.linalg.lstsq(line[each], value[each], rcond=1e-9)[0][0] for each in own])
    sigma, factors = _noise(runs, sensors, (of_run, place), gains[place] * run.slope_i * bench.angle_scatter_rad)
    passes = [(run.seat, run.number("sweep") if "sweep" in run.conditions else 0.0) for run in runs]
    order = "start_s" if np.isfinite(t).all() else None
    observations = Observations(
        run_ids=tuple(run.run_id for run in runs),
        series=tuple(Series(f"{name}_v", "mean", "V") for name in sensors),
        pools=tuple(NoisePool(f"{name}_v", 0.0, order) for name in sensors),
        value=value,
        sigma=sigma,
        series_of=place,
        run_of=of_run,
        pool_of=place,
        group_of=place,
        block_of=np.array([list(dict.fromkeys(passes)).index(each) for each in passes], dtype=np.intp),
        covariates={name: column for name, column in known.items() if np.ptp(column) > 0.0},
        angle="angle_deg",
        factors=factors,
    )
    return Recorded(tuple(runs), bench, measured, observations, run, sensors, seats, place, seat_of, gains)


def _noise(
    runs: Sequence[Reduced], sensors: Sequence[str], rows: tuple[IntArray, IntArray], by_angle_v: FloatArray
) -> tuple[FloatArray, tuple[tuple[IntArray, FloatArray], ...]]:
    """Sigmas, and of each run the Cholesky factor of its correlation; equation 7.

    A single run's own sigma is too uncertain to weigh by: there is one for each sensor.
    """
    squares = [[run.sigma_v[name] ** 2 for run in runs if name in run.sigma_v] for name in sensors]
    within_v = np.array([np.sqrt(np.mean(each)) or 1e-12 for each in squares])[rows[1]]
    sigma: FloatArray = np.hypot(within_v, by_angle_v)
    factors: list[tuple[IntArray, FloatArray]] = []
    for own in (np.flatnonzero(rows[0] == run) for run in range(len(runs))):
        covariance = np.diag(within_v[own] ** 2) + np.outer(by_angle_v[own], by_angle_v[own])
        correlation = covariance / np.outer(sigma[own], sigma[own])
        factors.append((own, np.asarray(np.linalg.cholesky(correlation), dtype=np.float64)))
    return sigma, tuple(factors)


class TumbleModel:
    """A `rigctl.workbench.study.Model`: coefficients of each sensor, the seat of each mounting, and effects.

    `held` tells which parameters of the baseline keep their start, where that is known already.
    """

    def __init__(self, data: Recorded, effects: Sequence[Placed] = (), held: Sequence[bool] = ()) -> None:
        self.data, self.placed, self.terms = data, tuple(effects), tuple(each.term for each in effects)
        self.observations = data.observations
        count, seats, added = len(data.sensors), len(data.seats), [one for each in effects for one in each.parameters]
        of_sensors = [f"{name}[{sensor}]" for name in OF_A_SENSOR for sensor in data.sensors]
        of_seats = [f"seat_{axis}[{number}]" for axis in (1, 2, 3) for *_, number in data.seats]
        self._shared, self.own = len(of_sensors), len(of_sensors) + len(of_seats)
        typical, units = [0.1 * abs(one.typical) for one in added], [one.unit for one in added]
        self._steps = np.array([*np.repeat(STEPS, count), *[SEAT_STEP_RAD] * 3 * seats, *typical])
        self.units: Sequence[str] = (*np.repeat(UNITS, count).tolist(), *["rad"] * 3 * seats, *units)
        owners = [each.effect.id for each in effects for _ in each.parameters]
        self.owners: Sequence[str] = (*[""] * self.own, *owners)
        self.local: Sequence[bool] = (*[False] * self._shared, *[True] * 3 * seats, *[False] * len(added))
        starts = np.concatenate([data.gains, np.zeros(len(self._steps) - count)])
        self.held = list(held) or self._untold(starts)
        beliefs = [*[None] * self._shared, *[Prior(0.0, data.bench.seat_rad)] * 3 * seats, *[None] * len(added)]
        fixed = [*self.held, *[False] * len(added)]
        named = zip([*of_sensors, *of_seats, *(one.name for one in added)], starts, fixed, beliefs, strict=True)
        self.parameters: Sequence[Parameter] = tuple(
            Parameter(name, float(start), fixed=held, prior=None if held else prior)
            for name, start, held, prior in named
        )

    def predict(self, values: FloatArray) -> FloatArray:
        """Volts, shape (n,)."""
        table = values[: self._shared].reshape(len(OF_A_SENSOR), -1)[:, self.data.place]
        K1, K0, delta_o, delta_p, K2, K3, K_ip, K_io = table
        seat_rad = values[self._shared : self.own].reshape(3, -1)[:, self.data.seat_of].T
        head, nothing = self.data.run, np.zeros(len(K1))
        angle_rad = self._with_effects("tumble_angle_rad", head, nothing, values)
        run = head.standing(angle_rad, self._with_effects("tumble_elevation_rad", head, nothing, values), seat_rad)
        a_i, a_p, a_o = run.a_i, run.a_p, run.a_o
        indicated = K0 + a_i * (1.0 + a_i * (K2 + a_i * K3)) + delta_o * a_p - delta_p * a_o
        indicated = indicated + a_i * (K_ip * a_p + K_io * a_o)
        indicated = self._with_effects("tumble_indicated_m_s2", run, indicated, values)
        return self._with_effects("tumble_output_v", run, K1 * indicated, values)

    def jacobian(self, values: FloatArray, first: int = 0) -> FloatArray:
        """d predict / d values by differences, shape (n, m), from parameter number `first` on."""
        values = np.asarray(values, dtype=np.float64)
        moves = np.diag(self._steps)[first:]
        columns = [(self.predict(values + move) - self.predict(values - move)) / (2.0 * move.sum()) for move in moves]
        return np.stack(columns, axis=1)

    def _with_effects(self, point: str, run: TumbleRun, signal: FloatArray, values: FloatArray) -> FloatArray:
        at = self.own
        for each in self.placed:
            names, count = each.effect.parameters, len(each.parameters)
            own, at = values[at : at + count].reshape(len(names), -1), at + count
            if each.effect.on == point:
                sizes = dict(zip(names, own[:, self.data.place % own.shape[1]], strict=True))
                signal = signal + each.effect(replace(run, signal=signal), **sizes)
        return np.asarray(signal)

    def _untold(self, starts: FloatArray) -> list[bool]:
        """What these positions cannot tell of sensors, and seats that nothing feels."""
        slopes = self.jacobian(starts)[:, : self.own] / self.observations.sigma[:, None]
        size, basis, held = np.linalg.norm(slopes, axis=0), np.zeros((len(slopes), 0)), []
        for column in range(self._shared):
            left = slopes[:, column] - basis @ (basis.T @ slopes[:, column])
            held.append(bool(np.linalg.norm(left) <= _OWN_PART * size[column]))
            basis = basis if held[-1] else np.column_stack([basis, left / np.linalg.norm(left)])
        return [*held, *(size[self._shared :] <= _OWN_PART * size[self._shared :].max()).tolist()]
