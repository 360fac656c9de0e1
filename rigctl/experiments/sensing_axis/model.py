"""Baseline plus effects: what a recording's runs should read, and how that depends on the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.chain import (
    ComplexArray,
    FloatArray,
    Runs,
    harmonics,
    periodic_motion,
    referred,
)
from rigctl.experiments.sensing_axis.geometry import beam, head_scale, lab_from_cube_mount
from rigctl.experiments.sensing_axis.observables import HARMONICS, RunObservables, heads_of
from rigctl.experiments.sensing_axis.package import HeadSettings, Package, SensorSettings, unit_vector
from rigctl.fitting.least_squares import Parameter, Prior

LEVEL_PRIOR_RAD = 15e-3
"""delta_x enters only times theta: runs near the null leave it to the operator's level reading."""


@dataclass(frozen=True)
class Family:
    """Parameters of one kind, of which every run uses one: all are varied at once for a derivative.

    `accel` and `lasers` tell which channels depend on them.
    """

    base: str
    first: int
    index: tuple[int, ...]
    accel: bool
    lasers: bool

    @property
    def count(self) -> int:
        """How many parameters the family has."""
        return max(self.index) + 1


@dataclass(frozen=True)
class Prediction:
    """Amplitudes like those of `RunObservables`: accel_v (runs, H+1), lasers_m (runs, heads, H+1)."""

    accel_v: ComplexArray
    lasers_m: ComplexArray


def by_mounting(run: RunObservables) -> str:
    """Label of a run's mounting."""
    return f"{run.axis},{run.configuration},{run.mounting}"


def by_configuration(run: RunObservables) -> str:
    """Label of a run's axis in its configuration."""
    return f"{run.axis},{run.configuration}"


_LABELS: dict[str, Callable[[RunObservables], str]] = {
    "recording": lambda _: "",
    "axis": lambda run: run.axis,
    "axis-configuration": by_configuration,
    "mounting": by_mounting,
}


class RecordingModel:
    """The model of a set of runs; parameters in SI and radians, runs in the order given."""

    def __init__(
        self,
        runs: Sequence[RunObservables],
        package: Package,
        heads: Mapping[str, HeadSettings],
        g_m_s2: float,
        effects: Sequence[Effect] = (),
    ) -> None:
        self.runs = tuple(runs)
        self.package = package
        self.effects = tuple(effects)
        self.head_settings = dict(heads)
        self.g_m_s2 = g_m_s2
        self.heads = tuple(name for name in heads_of(runs) if name in heads)
        self.parameters: list[Parameter] = []
        self.units: list[str] = []
        self.families: list[Family] = []
        self._declare_baseline()
        for item in self.effects:
            self._declare_effect(item)
        self._steps = np.array([parameter.step for parameter in self.parameters], dtype=np.float64)
        self._conditions = self._collect_conditions(g_m_s2)
        # One face and one beam per run, shape (runs, 1, 3): a head sees other faces in other configurations.
        positions = {name: [self._position(name, run) for run in self.runs] for name in self.heads}
        self._faces = {name: np.array(found)[:, None, :] for name, found in positions.items()}
        self._beams = {
            name: np.array([beam(each, heads[name].tilt_rad) for each in found])[:, None, :]
            for name, found in positions.items()
        }

    def index(self, name: str) -> int:
        """Position of a parameter by name."""
        return [parameter.name for parameter in self.parameters].index(name)

    def with_heads(self, heads: Mapping[str, HeadSettings]) -> RecordingModel:
        """The same model with heads that stand or look otherwise."""
        return RecordingModel(self.runs, self.package, heads, self.g_m_s2, self.effects)

    def with_runs(self, runs: Sequence[RunObservables]) -> RecordingModel:
        """The same model of other data."""
        return RecordingModel(runs, self.package, self.head_settings, self.g_m_s2, self.effects)

    def predict(self, values: FloatArray, *, accel: bool = True, lasers: bool = True) -> Prediction:
        """Amplitudes of every channel of every run for parameter values of shape (parameters,).

        Channels that are not wanted are left zero.
        """
        given = {family.base: values[family.first + np.array(family.index)][:, None] for family in self.families}
        run = replace(self._conditions, theta0=given["theta0"])
        run = replace(run, theta=run.theta + self._added("angle_rad", run, given, np.zeros_like(run.theta)))
        accel_v = self._accel(run, given) if accel else np.zeros((len(self.runs), HARMONICS + 1), np.complex128)
        if not (lasers and self.heads):
            nothing = np.zeros((len(self.runs), len(self.heads), HARMONICS + 1), np.complex128)
            return Prediction(accel_v, nothing)
        return Prediction(accel_v, self._lasers(run, given))

    def _accel(self, run: Runs, given: Mapping[str, FloatArray]) -> ComplexArray:
        force = -np.sin(run.theta - run.theta0) * run.a
        force = force + self._added("specific_force_m_s2", run, given, force)
        volts = given["gain"] * force + given["dc"]
        volts = volts + self._added("sensor_output_v", run, given, volts)
        return referred(harmonics(volts, HARMONICS))

    def jacobian(self, values: FloatArray, observe: Callable[[Prediction], FloatArray]) -> FloatArray:
        """Derivatives of `observe(prediction)`, which has one row per run; shape (rows * columns, parameters).

        One pair of predictions per family: the parameters of a family touch different runs.
        """
        width = observe(self.predict(values)).shape[1]
        jacobian = np.zeros((len(self.runs), width, len(self.parameters)))
        rows = np.arange(len(self.runs))
        for family in self.families:
            members = slice(family.first, family.first + family.count)
            step = np.zeros(len(values))
            step[members] = self._steps[members]
            upper, lower = (
                observe(self.predict(values + moved, accel=family.accel, lasers=family.lasers))
                for moved in (step, -step)
            )
            columns = family.first + np.array(family.index)
            jacobian[rows, :, columns] = (upper - lower) / (2.0 * step[columns][:, None])
        return jacobian.reshape(-1, len(self.parameters))

    def _lasers(self, run: Runs, given: Mapping[str, FloatArray]) -> ComplexArray:
        delta = np.concatenate([given["delta_x"], given["delta_y"], given["delta_z"]], axis=1)
        # One rotation per run, or per grid point where an effect moves the angle within the period.
        rotation = lab_from_cube_mount(run.theta, delta[:, None, :])
        readings = []
        for name in self.heads:
            scale = 1.0 + given.get(_scale_of(name), np.zeros(1))
            reading = run.x * scale * head_scale(rotation, self._faces[name], self._beams[name])
            readings.append(reading + self._added("laser_m", replace(run, head=name), given, reading))
        return referred(harmonics(np.stack(readings, axis=1), HARMONICS))

    def _added(self, point: str, run: Runs, given: Mapping[str, FloatArray], signal: FloatArray) -> FloatArray:
        added = np.zeros_like(signal)
        for item in self.effects:
            if item.on == point:
                own = {name: given[f"{item.id}.{name}"] for name in item.parameters}
                added = added + item.function(replace(run, signal=signal + added), **own)
        return added

    def _collect_conditions(self, g_m_s2: float) -> Runs:
        def column(values: list[float]) -> FloatArray:
            return np.array(values, dtype=np.float64)[:, None]

        omega = column([2.0 * np.pi * run.frequency_hz for run in self.runs])
        t, x, v, a = periodic_motion(np.array([run.motion_m for run in self.runs]), omega)
        theta = column([run.theta_rad for run in self.runs])
        return Runs(
            t=t,
            x=x,
            v=v,
            a=a,
            theta=theta,
            theta0=theta,
            omega=omega,
            amplitude=column([run.amplitude_m for run in self.runs]),
            g=g_m_s2,
            temperature=column([run.temperature_c for run in self.runs]),
            approach=column([run.approach for run in self.runs]),
            start=column([run.start_s for run in self.runs]),
        )

    def _position(self, head: str, run: RunObservables) -> FloatArray:
        """Where the head stands in the lab: before the face it looks at, whose nominal normal is M n_C."""
        if head not in run.faces:
            return unit_vector(self.head_settings[head].position)
        return self.package.turntable_from_cube(run.axis, run.configuration) @ unit_vector(run.faces[head])

    def _sensor(self, run: RunObservables) -> SensorSettings:
        return self.package.axes[run.axis].sensor[run.configuration]

    def _declare_baseline(self) -> None:
        def gain(name: str, run: RunObservables) -> Parameter:
            sensor = self._sensor(run)
            value = sensor.gain_v_per_m_s2
            return Parameter(name, value, 1e-3 * value, prior=Prior(value, sensor.u_gain * value))

        def mean(name: str, run: RunObservables) -> Parameter:
            return Parameter(name, run.accel_v.value[0].real, 1e-3)

        def angle(name: str, _: RunObservables) -> Parameter:
            prior = Prior(0.0, LEVEL_PRIOR_RAD) if name.startswith("delta_x") else None
            return Parameter(name, 0.0, 1e-5, prior=prior)

        self._declare("theta0", "mounting", "rad", angle, accel=True)
        self._declare("gain", "axis-configuration", "V/(m/s2)", gain, accel=True)
        self._declare("dc", "mounting", "V", mean, accel=True)
        if self.heads:
            for base in ("delta_x", "delta_y", "delta_z"):
                self._declare(base, "mounting", "rad", angle, lasers=True)
        for head in self.heads:
            u_scale = self.head_settings[head].u_scale
            if u_scale > 0.0:
                # Noise is far below what a certificate guarantees: without this freedom a head's scale would
                # pass for a mounting rotation.
                self._declare(_scale_of(head), "recording", "1", partial(_certified, u_scale), lasers=True)

    def _declare_effect(self, item: Effect) -> None:
        for parameter, unit in item.parameters.items():
            make = (
                partial(self._resonance, parameter)
                if item.id == "resonance"
                else partial(_absent, item.typical[parameter])
            )
            self._declare(
                f"{item.id}.{parameter}",
                item.scope,
                unit,
                make,
                shown=parameter,
                accel=item.on != "laser_m",
                lasers=item.on not in {"specific_force_m_s2", "sensor_output_v"},
            )

    def _resonance(self, parameter: str, name: str, run: RunObservables) -> Parameter:
        """The package's data sheet knows the resonance roughly; a null search close to the null does not."""
        sensor = self._sensor(run)
        value: float = getattr(sensor, parameter)
        relative = 2.0 * sensor.u_frequency if parameter == "inv_w0_squared" else sensor.u_q
        return Parameter(name, value, 1e-2 * value, prior=Prior(value, relative * value))

    def _declare(
        self,
        base: str,
        scope: str,
        unit: str,
        make: Callable[[str, RunObservables], Parameter],
        *,
        shown: str | None = None,
        accel: bool = False,
        lasers: bool = False,
    ) -> None:
        label = _LABELS[scope]
        first = len(self.parameters)
        seen: dict[str, int] = {}
        for run in self.runs:
            key = label(run)
            if key not in seen:
                seen[key] = len(seen)
                name = shown or base
                self.parameters.append(make(f"{name}[{key}]" if key else name, run))
                self.units.append(unit)
        index = tuple(seen[label(run)] for run in self.runs)
        self.families.append(Family(base, first, index, accel, lasers))


def _scale_of(head: str) -> str:
    """Name of the parameter for a head's relative scale error."""
    return f"scale[{head}]"


def _certified(u_scale: float, name: str, _: RunObservables) -> Parameter:
    """A quantity that a certificate says is zero within its standard uncertainty."""
    return Parameter(name, 0.0, 0.1 * u_scale, prior=Prior(0.0, u_scale))


def _absent(typical: float, name: str, _: RunObservables) -> Parameter:
    """A parameter of which only the plausible size is known: it starts from zero."""
    return Parameter(name, 0.0, 1e-2 * typical)
