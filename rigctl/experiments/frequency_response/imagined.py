"""Runs that could be made next, and what they would be if they were."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rigctl.experiments.frequency_response.observables import Sensitivity
from rigctl.workbench.study import Proposal

DIRECTIONS = {1: "forward", -1: "reversed"}
REMOUNT_S, OVERHEAD_S = 900.0, 15.0
_BEYOND = 2.0
"""Frequencies are proposed so far beyond those there are, and one between each two."""


def options(runs: Sequence[Sensitivity]) -> list[Proposal]:
    """Each frequency, used or near by, at the smallest and the largest acceleration; in both directions.

    No displacement is larger than the largest there was. The direction that is mounted comes first.
    """
    used = sorted({run.nominal_hz for run in runs})
    between = [math.sqrt(low * high) for low, high in pairwise(used)]
    largest_m = max(run.acceleration_m_s2 / run.omega**2 for run in runs)
    accelerations = [run.acceleration_m_s2 for run in runs]
    takes_s = float(np.median([run.duration_s for run in runs])) + OVERHEAD_S
    found = []
    for direction in (runs[-1].direction, -runs[-1].direction):
        there = direction == runs[-1].direction
        sitting, sitting_s = ("", 0.0) if there else (DIRECTIONS[direction], REMOUNT_S)
        for frequency_hz in sorted({*used, *between, used[0] / _BEYOND, used[-1] * _BEYOND}):
            most = largest_m * (2.0 * math.pi * frequency_hz) ** 2
            for wanted in (min(accelerations), max(accelerations)):
                settings = {
                    "frequency_hz": float(f"{frequency_hz:.4g}"),
                    "acceleration_m_s2": float(f"{min(wanted, most):.4g}"),
                    "direction": DIRECTIONS[direction],
                }
                found.append(Proposal(settings, takes_s, sitting, sitting_s))
    return list({tuple(each.settings.values()): each for each in found}.values())


def imagined(proposals: Sequence[Proposal], runs: Sequence[Sensitivity]) -> list[Sensitivity]:
    """Proposals as runs; the noise of each is that of the run of the nearest frequency.

    Each is the next run, for it is one of many that may be chosen: its place in the list is no time at which it
    would begin.
    """
    last, found = runs[-1], []
    mountings = {run.direction: run.mounting for run in runs}
    start_s = last.number("start_s") + last.duration_s + OVERHEAD_S
    temperature_c = _as_it_went_on(runs, start_s)
    for place, each in enumerate(proposals, start=1):
        frequency_hz, acceleration = each.settings["frequency_hz"], each.settings["acceleration_m_s2"]
        direction = 1 if each.settings["direction"] == "forward" else -1
        like = min(runs, key=lambda run: abs(math.log(run.frequency_hz / frequency_hz)))
        conditions = {
            **last.conditions,
            "direction": direction,
            "mounting": mountings.setdefault(direction, max(mountings.values()) + 1),
            "frequency_hz": frequency_hz,
            "amplitude_mm": 1e3 * acceleration / (2.0 * math.pi * frequency_hz) ** 2,
            "start_s": start_s,
            "temperature_c": temperature_c,
        }
        # Output and displacement have noise of their own size: what it does to S goes with the amplitude.
        weaker = like.acceleration_m_s2 / acceleration
        found.append(
            Sensitivity(
                f"next {place}",
                conditions,
                frequency_hz,
                like.duration_s,
                like.value,
                like.sigma * weaker,
                like.dof,
                acceleration,
                like.own_clock,
                like.displacement_u * weaker,
            )
        )
    return found


def _as_it_went_on(runs: Sequence[Sensitivity], start_s: float) -> float:
    """The temperature of a run that begins then, if it goes on changing as it did; NaN where it was not recorded.

    A straight line in time tells nothing apart from a drift: no promise rests on it.
    """
    known = np.array([(run.number("start_s"), run.number("temperature_c")) for run in runs])
    since_s = known[:, 0] - known[:, 0].mean()
    if len(runs) < 3 or not np.isfinite(known).all() or not since_s.any():
        return float(known[-1, 1])
    slope = float(since_s @ known[:, 1] / (since_s @ since_s))
    return float(known[:, 1].mean() + slope * (start_s - known[:, 0].mean()))
