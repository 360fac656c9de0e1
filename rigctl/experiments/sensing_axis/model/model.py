"""Baseline plus effects: what a recording's runs should read, and how that depends on the parameters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Origins, Runs, harmonics, periodic_motion, referred
from rigctl.experiments.sensing_axis.model.geometry import X_LAB, components, lab_from_cube_mount, leaning
from rigctl.experiments.sensing_axis.model.parameters import Layout, family_of, scale_of
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, RunObservables, heads_of
from rigctl.files.package import HeadSettings, Package, unit_vector


@dataclass(frozen=True)
class Prediction:
    """Amplitudes like those of `RunObservables`: accel_v (runs, H+1), lasers_m (runs, heads, H+1)."""

    accel_v: ComplexArray
    lasers_m: ComplexArray


@dataclass(frozen=True)
class _Place:
    """Where a head stands in each run and where its beam is tilted to, (runs, 1, 3); one value per run:
    a head sees other faces in other configurations."""

    outward: FloatArray
    leaning: FloatArray
    tilt: float


class RecordingModel:
    """The model of a set of runs; parameters in SI and radians, runs in the order given.

    `effects` act in the order given. Drifts count from `origins`, by default the means of these runs.
    """

    def __init__(
        self,
        runs: Sequence[RunObservables],
        package: Package,
        heads: Mapping[str, HeadSettings],
        g_m_s2: float,
        effects: Sequence[Effect] = (),
        *,
        origins: Origins | None = None,
    ) -> None:
        self.runs = tuple(runs)
        self.package = package
        self.effects = tuple(effects)
        self.head_settings = dict(heads)
        self.g_m_s2 = g_m_s2
        self.origins = origins or origins_of(self.runs)
        self.heads = tuple(name for name in heads_of(runs) if name in heads)
        self._places = {name: self._place(name) for name in self.heads}
        self.conditions = self._collect_conditions()
        self._fitted = {item: self.reach(item) for item in self.effects if not item.scanned}
        self._acting = {
            point: [item for item in self._fitted if item.on == point] for point in {each.on for each in self._fitted}
        }
        layout = Layout(runs, package, {name: heads[name] for name in self.heads}, self._fitted)
        self.parameters = layout.parameters
        self.units = layout.units
        self.owners = layout.owners
        self.families = layout.families
        self._steps = np.array([parameter.step for parameter in self.parameters], dtype=np.float64)

    def index(self, name: str) -> int:
        """Position of a parameter by name."""
        return [parameter.name for parameter in self.parameters].index(name)

    def with_heads(self, heads: Mapping[str, HeadSettings]) -> RecordingModel:
        """The same model with heads that stand or look otherwise."""
        return RecordingModel(self.runs, self.package, heads, self.g_m_s2, self.effects, origins=self.origins)

    def with_runs(self, runs: Sequence[RunObservables]) -> RecordingModel:
        """The same model of other data."""
        return RecordingModel(runs, self.package, self.head_settings, self.g_m_s2, self.effects, origins=self.origins)

    def with_gravity(self, g_m_s2: float) -> RecordingModel:
        """The same model in another gravity."""
        return RecordingModel(self.runs, self.package, self.head_settings, g_m_s2, self.effects, origins=self.origins)

    def with_effects(self, effects: Sequence[Effect]) -> RecordingModel:
        """The same data with other effects."""
        return RecordingModel(self.runs, self.package, self.head_settings, self.g_m_s2, effects, origins=self.origins)

    def reach(self, effect: Effect) -> tuple[str, ...]:
        """The heads an effect acts on; none unless it has a value for each head."""
        if effect.scope != "head":
            return ()
        # Found by trying: what is an error of side heads adds nothing to the main one, whatever its size.
        return effect.heads or tuple(
            head for head in self.heads if np.any(effect(self.at_head(head), **effect.typical))
        )

    def at_head(self, head: str) -> Runs:
        """The runs as an effect on a head's reading finds them, as if the head read the motion itself: a perfectly
        mounted package would hide from the side heads what they see of any other."""
        run = self.conditions
        return self._seen(head, lab_from_cube_mount(run.theta, np.zeros(3)), run).at(signal=run.x)

    def predict(self, values: FloatArray, *, accel: bool = True, lasers: bool = True) -> Prediction:
        """Amplitudes of every channel of every run for parameter values of shape (parameters,).

        Channels that are not wanted are left zero.
        """
        given = {family.base: values[family.first + np.array(family.index)][:, None] for family in self.families}
        run = self.conditions.at(theta0=given["theta0"])
        if "motion_m" in self._acting:
            # As a difference: velocity and acceleration follow what is added to the motion.
            run = run.moved(self._passed("motion_m", run, given, run.x) - run.x)
        run = run.at(theta=self._passed("angle_rad", run, given, run.theta))
        accel_v = self._accel(run, given) if accel else np.zeros((len(self.runs), HARMONICS + 1), np.complex128)
        if not (lasers and self.heads):
            nothing = np.zeros((len(self.runs), len(self.heads), HARMONICS + 1), np.complex128)
            return Prediction(accel_v, nothing)
        return Prediction(accel_v, self._lasers(run, given))

    def jacobian(
        self,
        values: FloatArray,
        observe: Callable[[Prediction], FloatArray],
        *,
        owners: Collection[str] | None = None,
    ) -> FloatArray:
        """Derivatives of `observe(prediction)`, which has one row per run; shape (rows * columns, parameters).

        One pair of predictions per family: the parameters of a family touch different runs. With `owners` only
        the columns of these effects are worked out, the rest is zero.
        """
        width = observe(self.predict(values)).shape[1]
        jacobian = np.zeros((len(self.runs), width, len(self.parameters)))
        rows = np.arange(len(self.runs))
        for family in self.families:
            if owners is not None and family.owner not in owners:
                continue
            members = slice(family.first, family.first + family.count)
            step = np.zeros(len(values))
            step[members] = self._steps[members]
            upper, lower = (
                observe(self.predict(values + moved, accel=family.accel, lasers=family.lasers))
                for moved in (step, -step)
            )
            # Of a run only its own member of the family moved: its row is that member's derivative.
            columns = family.first + np.array(family.index)
            jacobian[rows, :, columns] = (upper - lower) / (2.0 * step[columns][:, None])
        return jacobian.reshape(-1, len(self.parameters))

    def _accel(self, run: Runs, given: Mapping[str, FloatArray]) -> ComplexArray:
        run = run.at(theta0=self._passed("null_rad", run, given, run.theta0))
        # Eq. 5: a = -w^2 x, so that S rises with theta - theta0 (docs/physics.md).
        inertia = -np.sin(run.theta - run.theta0) * run.a
        force = self._passed("specific_force_m_s2", run, given, inertia)
        # The level is static: effects behind this point (gain drifts) act on it too.
        volts = self._passed("sensor_output_v", run, given, given["gain"] * force + given["dc"])
        return referred(harmonics(volts, HARMONICS))

    def _lasers(self, run: Runs, given: Mapping[str, FloatArray]) -> ComplexArray:
        delta = np.concatenate([given["delta_x"], given["delta_y"], given["delta_z"]], axis=1)
        # One rotation per run, or per grid point where an effect moves the angle within the period.
        rotation = lab_from_cube_mount(run.theta, delta[:, None, :])
        readings = []
        for head in self.heads:
            seen = self._seen(head, rotation, run)
            # A head whose scale nobody calls uncertain has no such parameter.
            scale = 1.0 + given.get(scale_of(head), np.zeros(1))
            readings.append(self._passed("laser_m", seen, given, seen.signal * scale))
        return referred(harmonics(np.stack(readings, axis=1), HARMONICS))

    def _seen(self, head: str, rotation: FloatArray, run: Runs) -> Runs:
        """The runs as one head sees them: `signal` is the motion along the face's normal n over c . n."""
        place = self._places[head]
        # A face moved by x meets the beam (n . x) / (c . n) farther along it, n its normal, c the beam's direction.
        along, across, ahead = components(rotation, place.outward, place.outward, place.leaning, X_LAB)
        cosine = np.cos(place.tilt) * along + np.sin(place.tilt) * across
        return run.at(
            head=head,
            along=along,
            across=across,
            tilt=place.tilt,
            # 1 for a head along y, across the motion.
            side=np.abs(place.outward[..., 1]),
            signal=run.x * ahead / cosine,
        )

    def _passed(self, point: str, run: Runs, given: Mapping[str, FloatArray], signal: FloatArray) -> FloatArray:
        """The signal behind a point of the chain, with what the effects add there, one after the other."""
        for item in self._acting.get(point, ()):
            if item.scope == "head" and run.head not in self._fitted[item]:
                continue
            parameters = {name: given[family_of(item, name, run.head)] for name in item.parameters}
            signal = signal + item(run.at(signal=signal), **parameters)
        return signal

    def _collect_conditions(self) -> Runs:
        def column(values: list[float]) -> FloatArray:
            return np.array(values, dtype=np.float64)[:, None]

        omega = column([2.0 * np.pi * run.frequency_hz for run in self.runs])
        t, x, v, a = periodic_motion(np.array([run.motion_m for run in self.runs]), omega)
        theta = column([run.theta_rad for run in self.runs])
        extra = sorted({name for run in self.runs for name in run.extra})
        return Runs(
            t=t,
            x=x,
            v=v,
            a=a,
            theta=theta,
            # A place holder: the parameter of each run's mounting takes it in every prediction.
            theta0=theta,
            omega=omega,
            amplitude=column([run.amplitude_m for run in self.runs]),
            g=self.g_m_s2,
            temperature=column([run.temperature_c for run in self.runs]),
            approach=column([run.approach for run in self.runs]),
            start=column([run.start_s for run in self.runs]),
            middle=column([_middle_s(run) for run in self.runs]),
            axis=np.array([[run.axis] for run in self.runs]),
            configuration=np.array([[run.configuration] for run in self.runs]),
            origins=self.origins,
            columns={name: column([run.extra.get(name, np.nan) for run in self.runs]) for name in extra},
        )

    def _place(self, head: str) -> _Place:
        kinds = [(run.axis, run.configuration, run.faces.get(head)) for run in self.runs]
        known = {kind: self._position(head, *kind) for kind in dict.fromkeys(kinds)}
        positions = [known[kind] for kind in kinds]
        return _Place(
            np.array(positions)[:, None, :],
            np.array([leaning(each) for each in positions])[:, None, :],
            self.head_settings[head].tilt_rad,
        )

    def _position(self, head: str, axis: str, configuration: str, face: str | None) -> FloatArray:
        """Where the head stands in the lab: before the face it looks at, whose nominal normal is M n_C."""
        if face is None:
            return unit_vector(self.head_settings[head].position)
        return self.package.turntable_from_cube(axis, configuration) @ unit_vector(face)


def origins_of(runs: Sequence[RunObservables]) -> Origins:
    """The means of a recording's temperatures and of the times in the middle of its runs, as far as known."""
    return Origins(
        _mean_of_known([run.temperature_c for run in runs]), _mean_of_known([_middle_s(run) for run in runs])
    )


def _middle_s(run: RunObservables) -> float:
    return run.start_s + 0.5 * run.duration_s


def _mean_of_known(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")
