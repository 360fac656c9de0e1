"""What every channel of some runs reads for given parameters: the chain from motion to volts and millimetres."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import is_
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import RigError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Runs, amplitudes
from rigctl.experiments.sensing_axis.model.geometry import about_vertical, component, from_vector, turned
from rigctl.experiments.sensing_axis.model.parameters import family_of, scale_of
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS

Stage = TypeVar("Stage")


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
class Observer:
    """What of a prediction is compared with data, (runs, columns): of the accelerometer, then of head after head.

    `accel` and `laser` take it from the amplitudes (runs, H+1) of one channel.
    """

    accel: Callable[[ComplexArray], FloatArray]
    laser: Callable[[ComplexArray], FloatArray]

    def __call__(self, prediction: Prediction, accel: bool = True, lasers: bool = True) -> FloatArray:
        """All columns, or only those of the accelerometer or of the heads."""
        parts = [self.accel(prediction.accel_v)] if accel else [np.zeros((len(prediction.accel_v), 0))]
        if lasers:
            parts += [self.laser(prediction.lasers_m[:, head]) for head in range(prediction.lasers_m.shape[1])]
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class Place:
    """Where a head stands in each run and where its beam is tilted to, (runs, 1, 3); one value per run:
    a head sees other faces in other configurations."""

    outward: FloatArray
    leaning: FloatArray
    tilt: float


class Turn(NamedTuple):
    """How the cube of each run is turned: by matrices (..., 3, 3) in its mounting, and about the vertical by angles
    with this cosine and sine."""

    mounted: FloatArray
    cos: FloatArray
    sin: FloatArray


@dataclass(frozen=True)
class Stages:
    """What the first of some predictions worked out on its way, by where in the chain and of which arrays: those that
    are given the very same arrays there find it."""

    worked_out: dict[str, tuple[tuple[FloatArray, ...], Any]] = field(default_factory=dict)

    def at(self, where: str, of: tuple[FloatArray, ...], work_out: Callable[[], Stage]) -> Stage:
        """What is worked out at this point of the chain of these arrays, or what the first prediction had of them."""
        known = self.worked_out.get(where)
        if known is None:
            known = self.worked_out[where] = (of, work_out())
        return cast(Stage, known[1]) if all(map(is_, known[0], of)) else work_out()


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
        level = Turn(from_vector(np.zeros(3)), np.cos(run.theta), np.sin(run.theta))
        return self._seen(head, level, run, Stages()).at(signal=run.x)

    def predict(
        self,
        given: Mapping[str, FloatArray],
        *,
        accel: bool = True,
        lasers: bool = True,
        stages: Stages | None = None,
    ) -> Prediction:
        """Amplitudes of every channel of every run; of each family of parameters `given` holds every run's (runs, 1).

        Channels that are not wanted are left zero. What a first prediction with the same `stages` worked out of the
        same arrays is not worked out again.
        """
        stages = stages or Stages()
        run = self.conditions.at(theta0=given["theta0"])
        moved = self._passed("motion_m", run, given, run.x, stages)
        if moved is not run.x:
            # As a difference: velocity and acceleration follow what is added to the motion.
            there = stages.at("motion", (moved,), lambda: run.moved(moved - run.x))
            run = run.at(x=there.x, v=there.v, a=there.a)
        run = run.at(theta=self._passed("angle_rad", run, given, run.theta, stages))
        runs = len(run.omega)
        accel_v = self._accel(run, given, stages) if accel else np.zeros((runs, HARMONICS + 1), np.complex128)
        if not (lasers and self.places):
            return Prediction(accel_v, np.zeros((runs, len(self.places), HARMONICS + 1), np.complex128))
        return Prediction(accel_v, self._lasers(run, given, stages))

    @cached_property
    def _at_point(self) -> dict[str, list[Effect]]:
        return {
            point: [item for item in self.acting if item.on == point] for point in {each.on for each in self.acting}
        }

    def _accel(self, run: Runs, given: Mapping[str, FloatArray], stages: Stages) -> ComplexArray:
        run = run.at(theta0=self._passed("null_rad", run, given, run.theta0, stages))
        # Eq. 5: a = -w^2 x, so that S rises with theta - theta0 (docs/physics.md).
        angles = run.theta, run.theta0
        inertia = stages.at("inertia", (*angles, run.a), lambda: -np.sin(run.theta - run.theta0) * run.a)
        force = self._passed("specific_force_m_s2", run, given, inertia, stages)
        gain, level = given["gain"], given["dc"]
        # The level is static: effects behind this point (gain drifts) act on it too.
        ideal = stages.at("volts", (gain, force, level), lambda: gain * force + level)
        volts = self._passed("sensor_output_v", run, given, ideal, stages)
        return stages.at("accel_v", (volts,), lambda: amplitudes(volts, HARMONICS))

    def _lasers(self, run: Runs, given: Mapping[str, FloatArray], stages: Stages) -> ComplexArray:
        turns = given["delta_x"], given["delta_y"], given["delta_z"]
        mounted = stages.at("mounted", turns, lambda: from_vector(np.concatenate(turns, axis=1)[:, None, :]))
        cos, sin = stages.at("turntable", (run.theta,), lambda: (np.cos(run.theta), np.sin(run.theta)))
        turn = Turn(mounted, cos, sin)
        return np.stack([self._read(head, turn, run, given, stages) for head in self.places], axis=1)

    def _read(
        self, head: str, turn: Turn, run: Runs, given: Mapping[str, FloatArray], stages: Stages
    ) -> ComplexArray:
        """Amplitudes that a head reads, (runs, H+1)."""
        seen = self._seen(head, turn, run, stages)
        scaled = seen.signal
        # A head whose scale nobody calls uncertain has no such parameter.
        if (scale := given.get(scale_of(head))) is not None:
            scaled = stages.at(f"scaled {head}", (seen.signal, scale), lambda: seen.signal * (1.0 + scale))
        reading = self._passed("laser_m", seen, given, scaled, stages)
        return stages.at(f"read {head}", (reading,), lambda: amplitudes(reading, HARMONICS))

    def _seen(self, head: str, turn: Turn, run: Runs, stages: Stages) -> Runs:
        """The runs as one head sees them: `signal` is the motion along the face's normal n over c . n."""
        place = self.places[head]
        along, across, signal = stages.at(f"seen {head}", (*turn, run.x), lambda: _faced(place, turn, run.x))
        return run.at(
            head=head,
            along=along,
            across=across,
            tilt=place.tilt,
            # 1 for a head along y, across the motion.
            side=np.abs(place.outward[..., 1]),
            signal=signal,
        )

    def _passed(
        self, point: str, run: Runs, given: Mapping[str, FloatArray], signal: FloatArray, stages: Stages
    ) -> FloatArray:
        """The signal behind a point of the chain, with what the effects add there, one after the other."""
        state = run.x, run.v, run.a, run.theta, run.theta0, run.along, run.across
        for item in self._at_point.get(point, ()):
            if item.scope == "head" and run.head not in self.acting[item]:
                continue
            parameters = {name: given[family_of(item, name, run.head)] for name in item.parameters}
            # Zero of all adds nothing.
            if any(each.any() for each in parameters.values()):
                behind = partial(_behind, item, run.at(signal=signal), parameters)
                signal = stages.at(f"{item.id} {run.head}", (signal, *parameters.values(), *state), behind)
        return signal


def _behind(item: Effect, run: Runs, parameters: Mapping[str, FloatArray]) -> FloatArray:
    """The signal with what an effect adds."""
    return run.signal + item(run, **parameters)


def _faced(place: Place, turn: Turn, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the normal of the face that a head looks at its part along and across the beam, and the reading for `x`."""
    normal = about_vertical(turn.cos, turn.sin, turned(turn.mounted, place.outward))
    along, across = component(normal, place.outward), component(normal, place.leaning)
    # A face moved by x meets the beam (n . x) / (c . n) farther along it, n its normal, c the beam's direction.
    cosine = np.cos(place.tilt) * along + np.sin(place.tilt) * across
    return along, across, x * (normal[0] / cosine)
