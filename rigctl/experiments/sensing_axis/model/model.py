"""Baseline plus effects: what a recording's runs should read, and how that depends on the parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Origins, Runs, periodic_motion
from rigctl.experiments.sensing_axis.model.geometry import leaning
from rigctl.experiments.sensing_axis.model.parameters import Family, Layout, Sharing
from rigctl.experiments.sensing_axis.model.prediction import Chain, Observer, Place, Prediction, Stages
from rigctl.experiments.sensing_axis.observe.observables import RunObservables, heads_of
from rigctl.files.package import HeadSettings, Package, unit_vector

_ROWS_TOGETHER, _FEWEST = 1000, 2
"""Runs with their copies that are predicted at once, and the families for which that is worth it."""


class Channels(NamedTuple):
    """Which of them depend on a family of parameters."""

    accel: bool
    lasers: bool


@dataclass(frozen=True)
class Here:
    """A model's parameters at some values, every run's of each family, and what its chain worked out there."""

    given: Mapping[str, FloatArray]
    stages: Stages = field(default_factory=Stages)


class Latest:
    """Where the last of some models was asked: derivatives are asked for where a prediction was."""

    def __init__(self) -> None:
        # One value: whoever asks in another thread finds the one or the other, never one's answer for the other's.
        self.kept: tuple[tuple[object, bytes], Here] | None = None


@dataclass(frozen=True)
class Tried:
    """What trying effects on these runs has told: which heads they reach, why the runs cannot be asked about them."""

    reach: dict[Effect, tuple[str, ...]] = field(default_factory=dict)
    untestable: dict[Effect, str | None] = field(default_factory=dict)


class RecordingModel:
    """The model of a set of runs; parameters in SI and radians, runs in the order given.

    `effects` act in the order given. Drifts count from `origins`, by default the means of these runs. What does not
    depend on the effects is that of a model `like` this one, of the same runs and heads.
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
        like: RecordingModel | None = None,
    ) -> None:
        self.runs = tuple(runs)
        self.package = package
        self.effects = tuple(effects)
        self.head_settings = dict(heads)
        self.g_m_s2 = g_m_s2
        self.origins = origins or origins_of(self.runs)
        self.heads = tuple(name for name in heads_of(runs) if name in heads)
        if like is None:
            self._sharing, self._latest, self.tried = Sharing(self.runs), Latest(), Tried()
            self._bare = Chain(self._collect_conditions(), {name: self._place(name) for name in self.heads}, {})
        else:
            self._sharing, self._latest, self.tried = like._sharing, like._latest, like.tried
            self._bare = like._bare
        acting = {item: self.reach(item) for item in self.effects if not item.scanned}
        self._chain = replace(self._bare, acting=acting)
        layout = Layout(self._sharing, package, {name: heads[name] for name in self.heads}, acting)
        self.parameters = layout.parameters
        self.units = layout.units
        self.owners = layout.owners
        self.families = layout.families
        self._repeated: dict[int, Chain] = {}
        self._key = object()
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
        same = self.package, self.head_settings, self.g_m_s2
        return RecordingModel(self.runs, *same, effects, origins=self.origins, like=self)

    def reach(self, effect: Effect) -> tuple[str, ...]:
        """The heads an effect acts on; none unless it has a value for each head."""
        if effect.scope != "head":
            return ()
        if effect.heads:
            return effect.heads
        # Found by trying: what is an error of side heads adds nothing to the main one, whatever its size.
        if effect not in self.tried.reach:
            self.tried.reach[effect] = tuple(
                head for head in self.heads if np.any(effect(self.at_head(head), **effect.typical))
            )
        return self.tried.reach[effect]

    def at_head(self, head: str) -> Runs:
        """The runs as an effect on a head's reading finds them."""
        return self._bare.at_head(head)

    @property
    def conditions(self) -> Runs:
        """Of the runs."""
        return self._bare.conditions

    def predict(self, values: FloatArray) -> Prediction:
        """Amplitudes of every channel of every run for parameter values of shape (parameters,)."""
        here = self._here(values)
        return self._chain.predict(here.given, stages=here.stages)

    def _here(self, values: FloatArray) -> Here:
        """What has been worked out at these values, if they were the last."""
        asked = self._key, values.tobytes()
        kept = self._latest.kept
        if kept is None or kept[0] != asked:
            kept = self._latest.kept = asked, Here(self._of_runs(values))
        return kept[1]

    def _of_runs(self, values: FloatArray) -> dict[str, FloatArray]:
        """Of each family every run's own parameter, (runs, 1)."""
        return {family.base: values[family.columns][:, None] for family in self.families}

    def jacobian(
        self,
        values: FloatArray,
        observe: Observer,
        *,
        present: BoolArray | None = None,
        owners: Collection[str] | None = None,
    ) -> FloatArray:
        """Derivatives of `observe(prediction)`, (runs, columns), where that is `present`, by default everywhere.

        Their shape is (present, parameters), run by run, each parameter's contiguous in memory.

        One pair of predictions per family: the parameters of a family touch different runs. With `owners` only
        the columns of these effects are worked out, the rest is zero.
        """
        here = self._here(values)
        first = self._chain.predict(here.given, stages=here.stages)
        present = np.ones(observe(first).shape, dtype=np.bool_) if present is None else present
        accel_columns = observe(first, lasers=False).shape[1]
        slopes = np.zeros((len(self.parameters), np.count_nonzero(present)))
        rows = np.cumsum(present).reshape(present.shape) - 1
        stepped = self._stepped(here.given, here.stages, owners)
        for channels, alike in groupby(stepped, lambda each: _channels(each[0])):
            own = slice(0 if channels.accel else accel_columns, None if channels.lasers else accel_columns)
            run, column = np.nonzero(present[:, own])
            row = rows[run, own.start + column]
            for family, upper, lower in alike:
                # Of a run only its own member of the family moved: its row is that member's derivative.
                step = self._steps[family.columns][:, None]
                moved = (observe(upper, *channels) - observe(lower, *channels)) / (2.0 * step)
                slopes[family.columns[run], row] = moved[run, column]
        return slopes.T

    def _stepped(
        self, given: Mapping[str, FloatArray], stages: Stages, owners: Collection[str] | None
    ) -> Iterator[tuple[Family, Prediction, Prediction]]:
        """Each family, by channels, with the predictions a step above what is `given` and a step below; `stages` of
        there."""
        asked = [family for family in self.families if owners is None or family.owner in owners]
        together = max(_ROWS_TOGETHER // (2 * max(len(self.runs), 1)), 1)
        for (accel, lasers), alike in groupby(sorted(asked, key=_channels), key=_channels):
            families = list(alike)
            for first in range(0, len(families), together):
                some = families[first : first + together]
                # A call for few runs costs as much as one for a hundred.
                if len(some) >= _FEWEST and self._run_by_run:
                    yield from zip(some, *self._predict_copies(given, some, accel, lasers), strict=True)
                    continue
                for family in some:
                    step = self._steps[family.columns][:, None]
                    above, below = ({**given, family.base: given[family.base] + moved} for moved in (step, -step))
                    yield (
                        family,
                        self._chain.predict(above, accel=accel, lasers=lasers, stages=stages),
                        self._chain.predict(below, accel=accel, lasers=lasers, stages=stages),
                    )

    def _predict_copies(
        self, given: Mapping[str, FloatArray], families: Sequence[Family], accel: bool, lasers: bool
    ) -> tuple[list[Prediction], list[Prediction]]:
        """Predictions a step above and a step below, family by family, from copies of the runs."""
        times = 2 * len(families)
        copied = {base: np.tile(column, (times, 1)) for base, column in given.items()}
        for place, family in enumerate(families):
            step = self._steps[family.columns]
            copies = copied[family.base].reshape(times, -1)
            copies[2 * place] += step
            copies[2 * place + 1] -= step
        if times not in self._repeated:
            self._repeated[times] = self._chain.repeated(times)
        each = self._repeated[times].predict(copied, accel=accel, lasers=lasers).copies(times)
        return each[::2], each[1::2]

    @cached_property
    def _run_by_run(self) -> bool:
        return self._chain.is_run_by_run()

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

    def _place(self, head: str) -> Place:
        kinds = [(run.axis, run.configuration, run.faces.get(head)) for run in self.runs]
        known = {kind: self._position(head, *kind) for kind in dict.fromkeys(kinds)}
        positions = [known[kind] for kind in kinds]
        return Place(
            np.array(positions)[:, None, :],
            np.array([leaning(each) for each in positions])[:, None, :],
            self.head_settings[head].tilt_rad,
        )

    def _position(self, head: str, axis: str, configuration: str, face: str | None) -> FloatArray:
        """Where the head stands in the lab: before the face it looks at, whose nominal normal is M n_C."""
        if face is None:
            return unit_vector(self.head_settings[head].position)
        return self.package.turntable_from_cube(axis, configuration) @ unit_vector(face)


def _channels(family: Family) -> Channels:
    return Channels(family.accel, family.lasers)


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
