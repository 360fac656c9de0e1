"""Orders and times of further runs, so that an effect is not as slow as the noise that imitates it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle, islice
from math import degrees
from typing import Any

import numpy as np

from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.set_points import ROOM_S, SOON_S, last_of, overhead, rooms
from rigctl.workbench.study import Course, Proposal

VISITS = 12
"""Runs of a course, where it is not one of the room."""

SPANS = (1.0, 2.0, 4.0)
"""How long to go on repeating, in times of the recording: beyond, nobody has seen how the noise goes on."""

ROUNDS = (2, 3)
"""How often the room is brought to the cooler and to the warmer temperature: once could be a step of the noise."""

COMPANY = 3
"""Runs at each of them: what a run's own noise is shows beside its neighbours."""

Settings = Mapping[str, Any]


def courses(runs: Sequence[RunObservables]) -> list[Course]:
    """What can be done in the mounting that is there, at set-points used there; none where times are not known.

    Repeats of one set-point at intervals; the room brought to two temperatures in turn; the outermost angles in turn;
    and as many more runs of the same kind, to compare with.
    """
    starts = np.array([run.start_s for run in runs])
    if len(runs) < VISITS or not np.isfinite(starts).all():
        return []
    here = [run for run in runs if run.place == last_of(runs).place]
    clock = _Clock(float(max(run.start_s + run.duration_s for run in runs)) + SOON_S, overhead(runs))
    used = [_settings(run) for run in sorted(here, key=lambda run: run.start_s)]
    # Where the recording was oftenest, and of these what is nearest to the null.
    counts = Counter(map(_key, used))
    middle = min(used, key=lambda each: (-counts[_key(each)], abs(each["theta_deg"])))
    outer = [min(used, key=lambda each: sign * each["theta_deg"]) for sign in (1.0, -1.0)]
    span_s = float(np.ptp(starts))
    found = [
        clock.course(
            "repeats against time", [middle] * VISITS, [0.0] + [share * span_s / (VISITS - 1)] * (VISITS - 1)
        )
        for share in SPANS
    ]
    found.append(clock.course("alternation of set-points", list(islice(cycle(outer), VISITS)), [0.0] * VISITS))
    two = rooms(runs)
    for count in ROUNDS if two else ():
        wanted = [room for room in two * count for _ in range(COMPANY)]
        found.append(clock.course("alternation of the room", [{**middle, "temperature_c": room} for room in wanted]))
    for count in sorted({len(each.runs) for each in found}):
        # Every so manieth of them: all kinds of set-points there are.
        places = np.linspace(0, len(used) - 1, count).round().astype(np.intp)
        found.append(clock.course("more of the same", [used[place] for place in places]))
    return found


class _Clock:
    """When runs begin that are made one after the other from `start_s` on."""

    def __init__(self, start_s: float, overhead_s: float) -> None:
        self._start_s, self._overhead_s = start_s, overhead_s

    def course(self, kind: Any, settings: Sequence[Settings], waits_s: Sequence[float] = ()) -> Course:
        return Course(kind, tuple(self._runs(settings, waits_s or [0.0] * len(settings))))

    def _runs(self, settings: Sequence[Settings], waits_s: Sequence[float]) -> Iterator[Proposal]:
        now_s, room = self._start_s, None
        for each, wait_s in zip(settings, waits_s, strict=True):
            # From one run's beginning to the next: the run and what lies between are part of the wait.
            before_s = round(max(wait_s - self._overhead_s - each["dwell_s"], 0.0), 1)
            wait = {"wait_s": before_s} if before_s else {}
            if each.get("temperature_c") != room:
                # Each return takes its time: the room is brought there anew.
                room, before_s = each.get("temperature_c"), before_s + ROOM_S
            now_s += before_s
            takes_s = each["dwell_s"] + self._overhead_s
            yield Proposal({**each, **wait, "start_s": round(now_s, 1)}, before_s + takes_s)
            now_s += takes_s


def _settings(run: RunObservables) -> dict[str, Any]:
    return {
        # Rounded, so that repeats of a set-point come out as one: what was reached differs in its last digits.
        "theta_deg": round(degrees(run.theta_rad), 4),
        "frequency_hz": round(run.frequency_hz, 4),
        "amplitude_mm": round(1e3 * run.amplitude_m, 2),
        "approach": 1 if run.approach >= 0.0 else -1,
        "dwell_s": float(round(run.duration_s)),
    }


def _key(settings: Settings) -> tuple[Any, ...]:
    return tuple(settings.values())
