"""The parameters of a recording's model: which there are, what is known of them, which runs they belong to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import isfinite

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import IntArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.files.package import HeadSettings, Package, SensorSettings

LEVEL_PRIOR_RAD = 15e-3
"""delta_x enters only times theta: runs near the null leave it to the operator's level reading."""

# One for each angle of the mounting rotation, delta_x through the stage angle.
_HEADS_THAT_FIX_A_CUBE = 3

Make = Callable[[str, RunObservables], Parameter]


@dataclass(frozen=True, eq=False)
class Members:
    """Parameters of one kind by their keys, the first run of each, and which of them is every run's, (runs,)."""

    keys: tuple[str, ...]
    first_runs: tuple[RunObservables, ...]
    of_run: IntArray


class Sharing:
    """Which runs share a parameter: worked out once for all models of the same runs."""

    def __init__(self, runs: Sequence[RunObservables]) -> None:
        self._runs = runs
        self._members: dict[str, Members] = {}
        self._fully_seen: dict[tuple[str, ...], frozenset[str]] = {}

    def members(self, scope: str) -> Members:
        """Of parameters with a scope of `_LABELS`."""
        if scope not in self._members:
            keys = [_LABELS[scope](run) for run in self._runs]
            first_runs = dict(zip(reversed(keys), reversed(self._runs), strict=True))
            places = {key: place for place, key in enumerate(dict.fromkeys(keys))}
            of_run = np.array([places[key] for key in keys], dtype=np.intp)
            self._members[scope] = Members(tuple(places), tuple(first_runs[key] for key in places), of_run)
        return self._members[scope]

    def fully_seen(self, heads: tuple[str, ...]) -> frozenset[str]:
        """Mountings that enough heads have seen to fix the cube's rotation."""
        if heads not in self._fully_seen:
            seen: dict[str, set[str]] = {}
            for run in self._runs:
                there = [name for name in heads if name in run.lasers_m]
                read = {name for name in there if np.isfinite(run.lasers_m[name].value[1])}
                seen.setdefault(by_mounting(run), set()).update(read)
            self._fully_seen[heads] = frozenset(
                key for key, names in seen.items() if len(names) >= _HEADS_THAT_FIX_A_CUBE
            )
        return self._fully_seen[heads]


@dataclass(frozen=True, eq=False)
class Family:
    """Parameters of one kind, of which every run uses one: all are varied at once for a derivative.

    `accel` and `lasers` tell which channels depend on them, `owner` is the effect they belong to or "".
    """

    base: str
    owner: str
    first: int
    members: Members
    accel: bool
    lasers: bool

    @property
    def count(self) -> int:
        """How many parameters the family has."""
        return len(self.members.keys)

    @cached_property
    def columns(self) -> IntArray:
        """Which parameter is every run's, (runs,)."""
        return np.asarray(self.first + self.members.of_run, dtype=np.intp)


def by_mounting(run: RunObservables) -> str:
    """Label of a run's mounting."""
    return f"{run.axis},{run.configuration},{run.mounting}"


def by_configuration(run: RunObservables) -> str:
    """Label of a run's axis in its configuration."""
    return f"{run.axis},{run.configuration}"


_LABELS: dict[str, Callable[[RunObservables], str]] = {
    "recording": lambda _: "",
    "head": lambda _: "",
    "axis": lambda run: run.axis,
    "axis-configuration": by_configuration,
    "mounting": by_mounting,
}


def scale_of(head: str) -> str:
    """Name of the parameter for a head's relative scale error."""
    return f"scale[{head}]"


def family_of(effect: Effect, parameter: str, head: str = "") -> str:
    """Name of the family of an effect's parameter; those of a head are families of their own."""
    return f"{effect.id}.{parameter}" + (f"[{head}]" if effect.scope == "head" else "")


class Layout:
    """Parameters with units and owners, in families: those of the baseline, then those of each effect."""

    def __init__(
        self,
        sharing: Sharing,
        package: Package,
        heads: Mapping[str, HeadSettings],
        effects: Mapping[Effect, Sequence[str]],
    ) -> None:
        """`heads` are those in the recording, `effects` with the heads on which they act."""
        self.parameters: list[Parameter] = []
        self.units: list[str] = []
        self.owners: list[str] = []
        self.families: list[Family] = []
        self._sharing = sharing
        self._package = package
        self._baseline(heads)
        names = [name for item in effects for name in item.parameters]
        for item, acted_on in effects.items():
            for name in item.parameters:
                # Several drifts have a rate.
                shown = name if names.count(name) == 1 else f"{item.id}.{name}"
                self._effect(item, name, shown, acted_on)

    def _baseline(self, heads: Mapping[str, HeadSettings]) -> None:
        self._declare("theta0", "mounting", "rad", _angle, accel=True)
        self._declare("gain", "axis-configuration", "V/(m/s2)", self._gain, accel=True)
        self._declare("dc", "mounting", "V", _mean, accel=True)
        if heads:
            self._declare("delta_x", "mounting", "rad", _levelled, lasers=True)
            loose = partial(_turned, self._sharing.fully_seen(tuple(heads)))
            self._declare("delta_y", "mounting", "rad", loose, lasers=True)
            self._declare("delta_z", "mounting", "rad", loose, lasers=True)
        for head, settings in heads.items():
            if settings.u_scale > 0.0:
                # Noise is far below what a certificate guarantees: without this freedom a head's scale would
                # pass for a mounting rotation.
                make = partial(_certified, settings.u_scale)
                self._declare(scale_of(head), "recording", "1", make, lasers=True)

    def _effect(self, item: Effect, name: str, shown: str, heads: Sequence[str]) -> None:
        make: Make = partial(_absent, item.typical[name])
        if item.id == "resonance":
            make = partial(self._resonance, name, item.typical[name])
        for head in heads if item.scope == "head" else ("",):
            self._declare(
                family_of(item, name, head),
                item.scope,
                item.parameters[name],
                make,
                shown=f"{shown}[{head}]" if head else shown,
                owner=item.id,
                accel=item.on != "laser_m",
                lasers=item.on in {"motion_m", "angle_rad", "laser_m"},
            )

    def _declare(
        self,
        base: str,
        scope: str,
        unit: str,
        make: Make,
        *,
        shown: str = "",
        owner: str = "",
        accel: bool = False,
        lasers: bool = False,
    ) -> None:
        members, name = self._sharing.members(scope), shown or base
        self.families.append(Family(base, owner, len(self.parameters), members, accel, lasers))
        for key, run in zip(members.keys, members.first_runs, strict=True):
            self.parameters.append(make(f"{name}[{key}]" if key else name, run))
            self.units.append(unit)
            self.owners.append(owner)

    def _sensor(self, run: RunObservables) -> SensorSettings:
        return self._package.axes[run.axis].sensor[run.configuration]

    def _gain(self, name: str, run: RunObservables) -> Parameter:
        sensor = self._sensor(run)
        value = sensor.gain_v_per_m_s2
        return Parameter(name, value, 1e-3 * value, prior=_belief(value, sensor.u_gain))

    def _resonance(self, parameter: str, typical: float, name: str, run: RunObservables) -> Parameter:
        """The package's data sheet knows the resonance roughly; a null search close to the null does not."""
        sensor = self._sensor(run)
        value: float = getattr(sensor, parameter)
        # 1/w0^2 is known half as well as w0.
        prior = _belief(value, 2.0 * sensor.u_frequency if parameter == "inv_w0_squared" else sensor.u_q)
        return _absent(typical, name, run) if prior is None else Parameter(name, value, 1e-2 * value, prior=prior)


def _belief(value: float, relative: float) -> Prior | None:
    return Prior(value, relative * value) if isfinite(relative) else None


def _mean(name: str, run: RunObservables) -> Parameter:
    # The first run's level: levels differ by a volt from mounting to mounting.
    return Parameter(name, run.accel_v.value[0].real, 1e-3)


def _angle(name: str, _: RunObservables) -> Parameter:
    return Parameter(name, 0.0, 1e-5)


def _levelled(name: str, _: RunObservables) -> Parameter:
    return Parameter(name, 0.0, 1e-5, prior=Prior(0.0, LEVEL_PRIOR_RAD))


def _turned(fully_seen: frozenset[str], name: str, run: RunObservables) -> Parameter:
    """A mounting angle: where heads are missing, what hands and level allow keeps it from being anything."""
    return (_angle if by_mounting(run) in fully_seen else _levelled)(name, run)


def _certified(u_scale: float, name: str, _: RunObservables) -> Parameter:
    """A quantity that a certificate says is zero within its standard uncertainty."""
    return Parameter(name, 0.0, 0.1 * u_scale, prior=Prior(0.0, u_scale))


def _absent(typical: float, name: str, _: RunObservables) -> Parameter:
    """A parameter of which only the plausible size is known: it starts from zero."""
    # The step of central differences: a hundredth of what the effect usually is.
    return Parameter(name, 0.0, 1e-2 * typical)
