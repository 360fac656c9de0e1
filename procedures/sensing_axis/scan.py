"""The scan: every combination of angle, frequency, direction of approach and amplitude, or an explicit list of runs.

The order is random by default, so that what changes with time - a drift, red noise - cannot pass for something that
changes with the angle. Where the lasers' spots would leave the cube they are not recorded.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.sensing_axis.bench import Bench, SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting, MountingLostError, Seated
from procedures.sensing_axis.tables import ListedRun, Procedure
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.entries import Event
from rigctl.core.errors import ConfigError

ROOM = "room"
"""The kind of event that keeps for which run the room was brought to a temperature, and when that began."""

IN_PLACE = 0
"""The number, in a list of runs, of the mounting that is there already."""


@dataclass(frozen=True)
class Wanted:
    """A set-point under the name it has in its mounting, at the room temperature it is wanted at (None: any), so long
    after the run before it."""

    name: str
    point: SetPoint
    temperature_c: float | None = None
    wait_s: float = 0.0


@dataclass(frozen=True)
class Stretch:
    """What is measured in one mounting, in this order."""

    mounting: Mounting
    wanted: tuple[Wanted, ...]


def stretches(procedure: Procedure, seated: Seated) -> list[Stretch]:
    """A scan's runs by mounting; `ConfigError` for one that has none, or asks for a mounting that is not there."""
    places: dict[tuple[str, str, int], list[ListedRun]] = {}
    for run in listed(procedure):
        axis = run.axis or procedure.axes[0]
        configuration = run.configuration or procedure.configurations[0]
        number = run.mounting if run.mounting is not None else _usual(procedure, seated)
        places.setdefault((axis, configuration, number), []).append(run)
    by_mounting = []
    counter = itertools.count(seated.count + 1)
    for index, ((axis, configuration, number), runs) in enumerate(_in_place_first(places)):
        mounting = (
            _in_place(axis, configuration, seated)
            if number == IN_PLACE
            else Mounting(axis, configuration, next(counter))
        )
        wanted = _named(_wanted(procedure, mounting, run) for run in runs)
        by_mounting.append(Stretch(mounting, _ordered(wanted, procedure, index)))
    return by_mounting


def listed(procedure: Procedure) -> tuple[ListedRun, ...]:
    """The runs of a scan as a list, whichever way they are given; `ConfigError`."""
    if procedure.runs and procedure.angles_deg:
        raise ConfigError("procedure: angles_deg and runs are two ways to say what to scan; leave one out")
    if not procedure.runs and not procedure.angles_deg:
        raise ConfigError("procedure.angles_deg is missing; a scan needs its angles, or [[procedure.runs]]")
    if procedure.runs:
        return procedure.runs
    if procedure.mounting != "new" and procedure.mountings > 1:
        kind = procedure.mounting
        raise ConfigError(
            f'procedure.mountings: there is one mounting in place; leave it out with mounting = "{kind}"'
        )
    in_place = {"new": tuple(range(1, procedure.mountings + 1)), "same": (IN_PLACE,), "kept": (None,)}
    grid = itertools.product(
        procedure.axes,
        procedure.configurations,
        in_place[procedure.mounting],
        range(procedure.repeats),
        procedure.amplitudes_mm or (procedure.amplitude_mm,),
        procedure.frequencies_hz,
        procedure.approaches,
        procedure.angles_deg,
    )
    return tuple(
        ListedRun(
            theta_deg=theta_deg,
            frequency_hz=frequency_hz,
            amplitude_mm=amplitude_mm,
            approach=approach,
            axis=axis,
            configuration=configuration,
            mounting=mounting,
        )
        for axis, configuration, mounting, _, amplitude_mm, frequency_hz, approach, theta_deg in grid
    )


def _usual(procedure: Procedure, seated: Seated) -> int:
    """The mounting of runs that do not say: a kept one is in place only where one has been made."""
    return int(procedure.mounting == "new" or (procedure.mounting == "kept" and seated.last is None))


@dataclass
class Scan:
    """Carries out stretches."""

    session: Session
    bench: Bench
    fixture: Fixture
    spare: int
    _room_c: float | None = field(default=None, init=False)
    _rooms: Sequence[Event] = field(init=False)

    def __post_init__(self) -> None:
        # Where rooms are simulated on a virtual clock; a real room is as it is.
        virtual = math.isinf(self.session.clock.speed)
        self._rooms = self.session.of_recorded_runs(ROOM) if virtual else ()

    def measure(self, stretch: Stretch, *, in_place: bool) -> None:
        """All runs of a stretch; those that are left when the mounting is disturbed are measured in another one."""
        mounting = stretch.mounting
        try:
            if not in_place:
                self.fixture.mount(mounting)
            for wanted in stretch.wanted:
                self._run(mounting, wanted)
        except MountingLostError as lost:
            self.session.event("mounting-lost", mounting=mounting.key, reason=str(lost))
            self.measure(self._left(stretch), in_place=False)

    def _left(self, stretch: Stretch) -> Stretch:
        disturbed = stretch.mounting
        mounting = Mounting(disturbed.axis, disturbed.configuration, self.spare)
        self.spare += 1
        remaining = [
            replace(wanted, point=replace(wanted.point, mounting=mounting.number))
            # Only what is left: runs before the disturbance were made in a sound mounting.
            for wanted in stretch.wanted
            if not self.session.recorded(_key(disturbed, wanted))
        ]
        return Stretch(mounting, tuple(remaining))

    def _run(self, mounting: Mounting, wanted: Wanted) -> None:
        key, point = _key(mounting, wanted), wanted.point

        def before() -> None:
            self.fixture.confirm(mounting)
            self._restore_room()
            self._condition(wanted.temperature_c, key)
            self._wait(wanted.wait_s)

        self.bench.run(self.session, key, point, before=before, lasers=self.bench.spots_stay(point))

    def _restore_room(self) -> None:
        """After a restart a world on a virtual clock has to be told what its room has been through."""
        # Once: from here on the rooms are those of this process.
        rooms, self._rooms = self._rooms, ()
        for room in rooms:
            self._room_c = room.data["temperature_c"]
            self.session.operator.restore_room(self._room_c, room.data["at_s"])

    def _wait(self, duration_s: float) -> None:
        if duration_s:
            # As for the room: nothing need oscillate meanwhile.
            self.bench.rest()
            self.session.guarded("taking up", self.bench.apparatus(), self.session.take_up)
            self.session.wait_s(duration_s)

    def _condition(self, temperature_c: float | None, key: str) -> None:
        if temperature_c is not None and temperature_c != self._room_c:
            # The room takes hours, for which nothing need oscillate.
            self.bench.rest()
            self.session.guarded("taking up", self.bench.apparatus(), self.session.take_up)
            # Before the hands begin: the room sets out from here.
            at_s = self.session.clock.now_s()
            self.session.operator.bring_room_to(temperature_c)
            self.session.event(ROOM, temperature_c=temperature_c, at_s=at_s, key=self.session.key(key))
            self._room_c = temperature_c


def check(planned: Iterable[Stretch], bench: Bench) -> None:
    """Whether the bench can do every run: `LimitError`, before anything moves."""
    for stretch in planned:
        for wanted in stretch.wanted:
            bench.check(wanted.point, lasers=bench.spots_stay(wanted.point))
            bench.check_level(wanted.point)


def _key(mounting: Mounting, wanted: Wanted) -> str:
    return f"{mounting.key} scan {wanted.name}"


def _in_place_first(
    places: dict[tuple[str, str, int], list[ListedRun]],
) -> list[tuple[tuple[str, str, int], list[ListedRun]]]:
    """What is mounted now can only be measured before anything else is mounted."""
    return sorted(places.items(), key=lambda item: item[0][2] != IN_PLACE)


def _in_place(axis: str, configuration: str, seated: Seated) -> Mounting:
    mounted = seated.last
    if mounted is None:
        raise ConfigError(
            'procedure.mounting: nothing is mounted yet; "same" (in a list: mounting 0) is for a campaign that '
            "goes on in a store"
        )
    if (axis, configuration) != (mounted.axis, mounted.configuration):
        raise ConfigError(
            f"procedure.mounting: {mounted.axis} is mounted in {mounted.configuration}, not {axis} in "
            f"{configuration}; give it a new mounting"
        )
    return mounted


def set_point(procedure: Procedure, mounting: Mounting, run: ListedRun) -> SetPoint:
    """A run of a list as the bench is asked for it; what it does not say is as in `procedure`."""
    return SetPoint(
        mounting.axis,
        mounting.configuration,
        mounting.number,
        run.theta_deg,
        run.frequency_hz,
        run.amplitude_mm or procedure.amplitude_mm,
        run.dwell_s or procedure.dwell_s,
        procedure.sample_rate_hz,
        run.approach,
    )


def _wanted(procedure: Procedure, mounting: Mounting, run: ListedRun) -> Wanted:
    point = set_point(procedure, mounting, run)
    side = "below" if point.approach > 0 else "above"
    at = "" if run.temperature_c is None else f" at {run.temperature_c:g} C"
    name = (
        f"{point.theta_deg:.4f} deg from {side} {point.frequency_hz:g} Hz {point.amplitude_mm:g} mm "
        f"{point.dwell_s:g} s{at}"
    )
    return Wanted(name, point, run.temperature_c, run.wait_s)


def _named(wanted: Iterable[Wanted]) -> list[Wanted]:
    """Repetitions are told apart by their number."""
    seen: Counter[str] = Counter()
    named = []
    for each in wanted:
        seen[each.name] += 1
        named.append(replace(each, name=f"{each.name} #{seen[each.name]}"))
    return named


def _ordered(wanted: Sequence[Wanted], procedure: Procedure, index: int) -> tuple[Wanted, ...]:
    """As listed, or shuffled; a temperature is gone to once, its runs are shuffled among themselves."""
    if procedure.order == "as-listed" or procedure.name == "angle-scan":
        return tuple(wanted)
    # The same order whenever the campaign is resumed, another one for every mounting.
    shuffled = [wanted[i] for i in np.random.default_rng([procedure.order_seed, index]).permutation(len(wanted))]
    rooms = list(dict.fromkeys(each.temperature_c for each in wanted))
    # A stable sort: the random order stays within each temperature.
    return tuple(sorted(shuffled, key=lambda each: rooms.index(each.temperature_c)))
