"""Fault plans at random: by seed, over the kinds of fault, the instruments and the length of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from simulators.faults.plan import WIRE_FAULTS, FaultPlan
from simulators.keyed_random import generator

NEVER_DRAWN = frozenset({"wrong_identity"})
"""Not something that comes and goes."""
AT_A_TIME = 0.7
"""How many faults of a wire come at a rig time; the others by the number of the reply."""


def random_plans(
    seed: int,
    possible: Mapping[str, Collection[str]],
    *,
    begin_s: float = 0.0,
    length_s: float = 600.0,
    replies: int = 2000,
    faults: int = 3,
) -> dict[str, FaultPlan]:
    """Plans for some of a rig's instruments (by name, what can befall each), `faults` faults in all.

    They strike within `length_s` of rig time from `begin_s` on, or within the first `replies` replies, where few
    are as likely as many. The same arguments give the same plans. Over seeds every kind of fault befalls every
    instrument that can have it.
    """
    random = generator(seed, "fault plans")
    tables: dict[str, dict[str, Any]] = {}
    for _ in range(faults):
        # Sorted first: a set has no order that another process would repeat.
        name = str(random.choice(sorted(possible)))
        table = tables.setdefault(name, {"seed": int(random.integers(1 << 31))})
        fault = str(random.choice(sorted(set(possible[name]) - NEVER_DRAWN)))
        table[fault] = _drawn(fault, random, (begin_s, begin_s + length_s), replies)
    return {name: FaultPlan.model_validate(table) for name, table in tables.items()}


def _drawn(fault: str, random: np.random.Generator, between_s: tuple[float, float], replies: int) -> dict[str, Any]:
    at_s = round(float(random.uniform(*between_s)), 3)
    # Evenly over the logarithm: as many spells of seconds as of minutes.
    lasting_s = round(float(np.exp(random.uniform(np.log(1.0), np.log(60.0)))), 3)
    match fault:
        case "clock_drift":
            return {"ppm": round(float(random.normal(0.0, 50.0)), 3)}
        case "clock_jump":
            return {"at_s": at_s, "jump_s": lasting_s}
        case "missing_edges":
            # Some edges, which must be noticed by counting, or all, which ends the record.
            return {"at_s": at_s, "lasting_s": lasting_s, "share": float(random.choice([0.01, 1.0]))}
        case "following_error" | "limit_hit" | "memory_overflow":
            return {"at_s": at_s}
        case "refused":
            # Not the first attempt, with which the rig is opened.
            return {"between_s": [at_s, at_s + lasting_s]} if random.random() < AT_A_TIME else {"nth": [2, 3]}
        case _ if fault in WIRE_FAULTS:
            by_time = random.random() < AT_A_TIME
            # Evenly over the logarithm, so that the first replies are struck as often as the later ones.
            when = {"at_s": at_s} if by_time else {"nth": [int(replies ** random.random())]}
            return {**when, **_wire_details(fault, random)}
        case _:
            return {"at_s": at_s, "lasting_s": lasting_s}


def _wire_details(fault: str, random: np.random.Generator) -> dict[str, Any]:
    match fault:
        case "late":
            return {"delay_s": round(float(random.uniform(0.1, 10.0)), 3)}
        case "previous":
            return {"instead": bool(random.random() < 0.5)}
        case "disconnect":
            return {"before": bool(random.random() < 0.5)}
        case _:
            return {}
