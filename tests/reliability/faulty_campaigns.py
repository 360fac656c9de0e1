"""Small campaigns of every procedure on every instrument, with faults drawn at random by seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl import config
from tests.reliability.campaigns import SMALL_CAMPAIGNS
from tests.reliability.commands import here

PROMISE = "A campaign under faults keeps no wrong number as valid, ends by itself, and says why in a typed message"

FAULTS = {
    "late": ", delay_s = 2.5",
    "garbage": "",
    "truncated": ", keep_bytes = 3",
    "silent": "",
    "duplicated": "",
    "disconnect": "",
}
WIRELESS = "drag-free-satellite"


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One campaign with one or two kinds of fault on one or two instruments."""
    random = np.random.default_rng(seed)
    small = list(SMALL_CAMPAIGNS.values())[seed % 7]
    faults = _faults(random, small.write(work).with_name("rig.toml"))
    (work / "rig.toml").write_text(small.rig_text + faults, encoding="utf-8")
    outcome = here(work, "run", "campaign.toml", "--store", "x.rig.sqlite", "--yes", "--json", "--seed", seed)
    return {
        "campaign": small.name,
        "faults": faults,
        "status": outcome.status,
        "message": outcome.message,
        "failed": outcome.broken(),
    }


def _faults(random: np.random.Generator, rig: Path) -> str:
    """Tables of the rig file with one or two faults."""
    wired = [name for name, table in config.read_rig(rig).instruments.items() if table.driver != WIRELESS]
    tables = []
    for name in random.choice(wired, size=int(random.integers(1, 3)), replace=False):
        kind = str(random.choice(list(FAULTS)))
        strike = f"nth = [{random.integers(5, 400)}]" if random.random() < 0.7 else "probability = 0.003"
        tables.append(
            f"\n[instruments.{name}.faults]\nseed = {random.integers(1000)}\n{kind} = {{ {strike}{FAULTS[kind]} }}\n"
        )
    return "".join(tables)
