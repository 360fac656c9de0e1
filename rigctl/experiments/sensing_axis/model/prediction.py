"""What every channel of some runs reads for given parameters: the chain from motion to volts and millimetres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import RigError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Runs, harmonics, referred
from rigctl.experiments.sensing_axis.model.geometry import X_LAB, components, lab_from_cube_mount
from rigctl.experiments.sensing_axis.model.parameters import family_of, scale_of
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS


@dataclass(frozen=True)
class Prediction:
    """Amplitudes like those of `RunObservables`: accel_v (runs, H+1), lasers_m (runs, heads, H+1)."""

    accel_v: ComplexArray
    lasers_m: ComplexArray

    def copies(self, times: int) -> list[Prediction]:
        """One by one, those of runs that were repeated so many times."""
        pairs = zip(np.split(self.accel_v, times), np.split(self.lasers_m, times), strict=True)
        return [Prediction(accel_v, lasers_m) for accel_v, lasers_m in pairs]


@dataclass(frozen=True)
class Place:
    """Where a head stands in each run and where its beam is tilted to, (runs, 1, 3); one value per run:
    a head sees other faces in other configurations."""

    outward: FloatArray
    leaning: FloatArray
    tilt: float


@dataclass(frozen=True)
class Chain:
    """The chain of some runs, with the `places` of the heads in them and the effects that act, each on its heads."""

    conditions: Runs
    places: Mapping[str, Place]
    acting: Mapping[Effect, tuple[str, ...]]

    def repeated(self, times: int) -> Chain:
        """The chain of the same runs so many times, one copy after the other."""
        return Chain(
            self.conditions.repeated(times),
            {
                head: Place(np.tile(place.outward, (times, 1, 1)), np.tile(place.leaning, (times, 1, 1)), place.tilt)
                for head, place in self.places.items()
            },
            self.acting,
        )

    def is_run_by_run(self) -> bool:
        """Whether no effect looks from run to run, as one of a laboratory's own may: what acts on a run is the same
        beside any others."""
        beside = self.repeated(3)
        for item, heads in self.acting.items():
            for head in heads or ("",):
                run, runs = (chain.at_head(head) if head else chain.conditions for chain in (self, beside))
                # Copies of the runs with others between them, which move more.
                signal = np.concatenate([run.x, 1.5 * run.x, run.x])
                try:
                    alone = item(run.at(signal=run.x), **item.typical)
                    first, _, last = np.split(item(runs.at(signal=signal), **item.typical) + 0.0 * signal, 3)
                except RigError:
                    return False
                if not all(np.array_equal(each, alone + 0.0 * run.x, equal_nan=True) for each in (first, last)):
                    return False
        return True

    def at_head(self, head: str) -> Runs:
        """The runs as an effect on a head's reading finds them, as if the head read the motion itself: a perfectly
        mounted package would hide from the side heads what they see of any other."""
        run = self.conditions
        return self._seen(head, lab_from_cube_mount(run.theta, np.zeros(3)), run).at(signal=run.x)

    def predict(self, given: Mapping[str, FloatArray], *, accel: bool = True, lasers: bool = True) -> Prediction:
        """Amplitudes of every channel of every run; of each family of parameters `given` holds every run's (runs, 1).

        Channels that are not wanted are left zero.
        """
        run = self.conditions.at(theta0=given["theta0"])
        if "motion_m" in self._at_point:
            # As a difference: velocity and acceleration follow what is added to the motion.
            run = run.moved(self._passed("motion_m", run, given, run.x) - run.x)
        run = run.at(theta=self._passed("angle_rad", run, given, run.theta))
        runs = len(run.omega)
        accel_v = self._accel(run, given) if accel else np.zeros((runs, HARMONICS + 1), np.complex128)
        if not (lasers and self.places):
            return Prediction(accel_v, np.zeros((runs, len(self.places), HARMONICS + 1), np.complex128))
        return Prediction(accel_v, self._lasers(run, given))

    @cached_property
    def _at_point(self) -> dict[str, list[Effect]]:
        return {
            point: [item for item in self.acting if item.on == point] for point in {each.on for each in self.acting}
        }

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
        for head in self.places:
            seen = self._seen(head, rotation, run)
            # A head whose scale nobody calls uncertain has no such parameter.
            scale = 1.0 + given.get(scale_of(head), np.zeros(1))
            readings.append(self._passed("laser_m", seen, given, seen.signal * scale))
        return referred(harmonics(np.stack(readings, axis=1), HARMONICS))

    def _seen(self, head: str, rotation: FloatArray, run: Runs) -> Runs:
        """The runs as one head sees them: `signal` is the motion along the face's normal n over c . n."""
        place = self.places[head]
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
        for item in self._at_point.get(point, ()):
            if item.scope == "head" and run.head not in self.acting[item]:
                continue
            parameters = {name: given[family_of(item, name, run.head)] for name in item.parameters}
            signal = signal + item(run.at(signal=signal), **parameters)
        return signal
