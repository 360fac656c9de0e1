"""The displacement that all is measured against: the mean of the laser heads, and whether they agree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.experiments.frequency_response.observables import HeadReading, Sensitivity

DISAGREE_P = 1e-3
"""Heads that differ by more than noise and certificates let one expect, at this level, are not believed them."""


@dataclass(frozen=True)
class Reference:
    """Relative standard uncertainty `u` of the displacement, where it is from, and what a reader has to know."""

    u: float
    source: str = "certificates of the laser heads: scale, tilt"
    remarks: tuple[str, ...] = ()


def reference_of(runs: Sequence[Sensitivity], heads_u: Mapping[str, float]) -> Reference:
    """Of the mean of the heads that were recorded, by `heads_u`, the relative standard uncertainty of each.

    Where they differ by more, their scatter counts in its place.
    """
    # What a head has to say in the mean over all runs.
    share: dict[str, float] = {}
    for run in runs:
        for name in run.heads:
            share[name] = share.get(name, 0.0) + 1.0 / (len(run.heads) * len(runs))
    stated = math.sqrt(sum((part * heads_u.get(name, 0.0)) ** 2 for name, part in share.items()))
    beside = [run.heads for run in runs if len(run.heads) > 1]
    excess = {name: _mean([heads[name] for heads in beside if name in heads]) for name in share}
    known = {name: each for name, each in excess.items() if each is not None}
    apart = {
        name: abs(each.excess) / expected
        for name, each in known.items()
        if (expected := math.hypot(each.sigma, _stated_of_excess(name, heads_u, list(known)))) > 0.0
    }
    if not apart:
        return Reference(stated)
    worst = max(apart, key=lambda name: apart[name])
    # What they read beside their mean sums to nothing: one of them says nothing new.
    if (len(known) - 1) * math.erfc(apart[worst] / math.sqrt(2.0)) >= DISAGREE_P:
        return Reference(stated)
    count = len(known)
    scatter = math.sqrt(sum(each.excess**2 for each in known.values()) / (count * (count - 1)))
    percent = 1e2 * known[worst].excess
    said = (
        f"laser heads disagree: {worst} reads {percent:+.2g} % against the mean of {', '.join(known)}, "
        f"{apart[worst]:.2g} times what certificates and noise let one expect"
    )
    mend = "find out which is right, and leave the other's column out; until then their scatter counts as uncertainty"
    return Reference(max(stated, scatter), "scatter of the laser heads", (f"{said}: {mend}",))


def _mean(readings: Sequence[HeadReading]) -> HeadReading | None:
    """The mean by noise; None of none."""
    if not readings:
        return None
    weight = np.array([max(each.sigma, 1e-12) ** -2.0 for each in readings])
    mean = float(weight @ np.array([each.excess for each in readings]) / weight.sum())
    return HeadReading(mean, float(weight.sum() ** -0.5))


def _stated_of_excess(name: str, heads_u: Mapping[str, float], heads: Sequence[str]) -> float:
    """Standard uncertainty of a head's reading less the mean of all, by the certificates."""
    parts = [heads_u.get(each, 0.0) * (float(each == name) - 1.0 / len(heads)) for each in heads]
    return math.hypot(*parts)
