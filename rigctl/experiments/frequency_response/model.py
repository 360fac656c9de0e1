"""Baseline and effects: a flat response, and what bends it.

Data are ln |S| and the phase of S: what comes late is linear in them however late it is, and factors are sums.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.frequency_response.chain import ShakenRuns, fundamental, periodic, shaken
from rigctl.experiments.frequency_response.columns import ACCEL
from rigctl.experiments.frequency_response.observables import Sensitivity
from rigctl.workbench.placed import Placed, fit_parameter
from rigctl.workbench.study import NoisePool, Observations, Series, Term

BLOCKS = 5
_STEP = 1e-3
"""Of a parameter's typical size, or of the gain, in differences: what is left is 1e-6 of the derivative."""

PARTS = (("ln magnitude", "1"), ("phase", "rad"))
_COVARIATES = ("direction", "mounting", "temperature_c", "start_s")


@dataclass(frozen=True)
class Bench:
    """What is known beforehand: gravity, standard uncertainties, beam tilts by head.

    `delay_u_s` is that of the time between the recorders of output and displacement; relative are `gain_u` of the
    voltmeter, `heads_u` of each head's displacement, `frequency_u` of the clock. `pitch_u_rad_m` is the guide's.
    """

    g_m_s2: float = 9.80665
    delay_u_s: float = 0.0
    gain_u: float = 0.0
    frequency_u: float = 0.0
    pitch_u_rad_m: float = 0.0
    heads_u: Mapping[str, float] = field(default_factory=dict)
    tilts_rad: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Recorded:
    """All runs as data, magnitude and phase of S after each other, and as effects see them."""

    runs: tuple[Sensitivity, ...]
    bench: Bench
    observations: Observations
    shaken: ShakenRuns


def recorded(runs: Sequence[Sensitivity], bench: Bench) -> Recorded:
    """The data of these runs."""
    value = _parts(np.array([run.value for run in runs]))
    count = len(runs)
    part = np.tile(np.arange(2, dtype=np.intp), count)
    names = [name for name in _COVARIATES if any(name in run.conditions for run in runs)]
    extra = [name for run in runs for name in run.conditions if math.isfinite(run.number(name))]
    known = dict.fromkeys([*names, *extra, "frequency_hz"])
    covariates = {name: np.array([run.number(name) for run in runs]) for name in known}
    covariates["frequency_hz"] = np.array([run.nominal_hz for run in runs])
    covariates["acceleration_m_s2"] = np.array([run.acceleration_m_s2 for run in runs])
    covariates = {name: column for name, column in covariates.items() if np.ptp(column) != 0.0}
    observations = Observations(
        run_ids=tuple(run.run_id for run in runs),
        series=tuple(Series(ACCEL, name, unit) for name, unit in PARTS),
        pools=tuple(NoisePool(f"{ACCEL} {name}", float(np.mean([run.dof for run in runs]))) for name, _ in PARTS),
        value=value,
        sigma=np.repeat([run.sigma / abs(run.value) for run in runs], 2),
        series_of=part,
        run_of=np.repeat(np.arange(count, dtype=np.intp), 2),
        pool_of=part,
        group_of=np.zeros(2 * count, dtype=np.intp),
        # Neighbours in time held out together: what drifts is then predicted, not interpolated.
        block_of=np.arange(count, dtype=np.intp) * min(BLOCKS, count) // count,
        covariates=covariates,
        # At one frequency nothing goes as a power of it.
        frequency="frequency_hz" if "frequency_hz" in covariates else None,
    )
    return Recorded(tuple(runs), bench, observations, shaken(runs, bench.g_m_s2))


def _parts(values: ComplexArray) -> FloatArray:
    """ln |S| and the phase of each, one run after the other."""
    return np.stack([np.log(np.abs(values)), np.angle(values)], axis=1).ravel()


class ResponseModel:
    """A `rigctl.workbench.study.Model`: a flat response, S = gain, and effects."""

    def __init__(self, data: Recorded, effects: Sequence[Placed] = ()) -> None:
        self.data, self.placed = data, tuple(effects)
        self.terms: tuple[Term, ...] = tuple(each.term for each in effects)
        self.observations = data.observations
        added = [one for each in effects for one in each.parameters]
        gain = float(np.median(np.abs([run.value for run in data.runs])))
        self.parameters: Sequence[Parameter] = (Parameter("gain", gain), *map(fit_parameter, added))
        self.units: Sequence[str] = ("V s2/m", *(one.unit for one in added))
        self.owners: Sequence[str] = ("", *(each.effect.id for each in effects for _ in each.parameters))
        self.local: Sequence[bool] = (False,) * len(self.parameters)
        self._steps = np.array([_STEP * abs(gain), *(_STEP * abs(one.typical) for one in added)])

    @property
    def never_negative(self) -> frozenset[str]:
        """Names of parameters that nature has with one sign only."""
        return frozenset(
            one.name for each in self.placed for one in each.parameters if one.argument in each.effect.never_negative
        )

    def response(self, values: FloatArray) -> ComplexArray:
        """S of every run [V s2/m]."""
        return self._response(self.data.shaken, values)

    def curve(self, frequency_hz: FloatArray, values: FloatArray) -> ComplexArray:
        """S at frequencies, the mean of both directions, at the recording's median amplitude and mean conditions."""
        here, shape = self.data.shaken, (len(frequency_hz), 1)
        known = {name: column[np.isfinite(column)] for name, column in here.columns.items()}
        usual = {name: np.full(shape, column.mean() if column.size else np.nan) for name, column in known.items()}

        def towards(direction: float) -> ComplexArray:
            runs = periodic(
                2.0 * np.pi * frequency_hz[:, None],
                np.full(shape, np.median(here.acceleration)),
                np.full(shape, direction),
                np.full(shape, here.temperature_0),
                np.full(shape, here.start_0),
                here.g,
                usual,
            )
            return self._response(runs, values)

        return np.asarray(0.5 * (towards(1.0) + towards(-1.0)))

    def _response(self, runs: ShakenRuns, values: FloatArray) -> ComplexArray:
        at = 1
        own = []
        for each in self.placed:
            count = len(each.parameters)
            own.append(dict(zip(each.effect.parameters, values[at : at + count], strict=True)))
            at += count
        force = self._added("shaken_force_m_s2", runs, own)
        output = self._added("shaken_output_v", replace(runs, signal=values[0] * force), own)
        return fundamental(runs, output)

    def _added(self, point: str, runs: ShakenRuns, own: Sequence[Mapping[str, float]]) -> FloatArray:
        for each, sizes in zip(self.placed, own, strict=True):
            if each.effect.on == point:
                arguments = {name: np.asarray(size) for name, size in sizes.items()}
                runs = replace(runs, signal=runs.signal + each.effect(runs, **arguments))
        return runs.signal

    def predict(self, values: FloatArray) -> FloatArray:
        """Logarithms of magnitudes, and phases within half a turn of those measured [rad]; shape (n,)."""
        found = _parts(self.response(np.asarray(values, dtype=np.float64)))
        measured = self.observations.value[1::2]
        found[1::2] = measured + np.remainder(found[1::2] - measured + np.pi, 2.0 * np.pi) - np.pi
        return found

    def jacobian(self, values: FloatArray, first: int = 0) -> FloatArray:
        """d predict / d values by differences, shape (n, m), from parameter number `first` on."""
        values = np.asarray(values, dtype=np.float64)
        moves = np.diag(self._steps)[first:]
        columns = [(self.predict(values + move) - self.predict(values - move)) / (2.0 * move.sum()) for move in moves]
        return np.stack(columns, axis=1)
