"""Small campaigns of every procedure on every instrument, with faults drawn at random by seed."""

from __future__ import annotations

import functools
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.campaign.store.store import Store
from tests.reliability.accounted import unaccounted
from tests.reliability.campaigns import SMALL_CAMPAIGNS, SmallCampaign
from tests.reliability.commands import Outcome, Process, here
from tests.reliability.random_faults import Plans, as_toml, kinds_of, random_faults
from tests.reliability.served import served
from tests.reliability.truth import wrong_number

PROMISE = "A campaign under faults keeps no wrong number as valid, ends by itself, and says why in a typed message"

WIRED = [small for small in SMALL_CAMPAIGNS.values() if small.rig != "microscope-rig.toml"]
FLOWN = replace(
    SMALL_CAMPAIGNS["calibration"], text=SMALL_CAMPAIGNS["calibration"].text.replace('["dx", "ad11"]', '["dx"]')
)
"""One session, with telemetry once a second (`WORLD`): six orbits, as few as give a result."""
QUICK_HANDS = "remount_s = 1.0\nlevel_s = 1.0\n"
WORLD = {"bias-rejection-rig.toml": "", "microscope-rig.toml": "sample_period_s = 1.0\n"}
FAULTY = [*WIRED, *WIRED, FLOWN]
FAULTS = (1, 2, 3)
SERVED_EVERY = 4
QUICK = ("null-search", "scan", "angle-scan", "quick-check", "six-mountings")
"""Those last some seconds over wires."""
CLOCK_SPEED = 50.0
ENDS_S = 60.0
SAYING = ("text", "reason", "error")
"""Where an event has words about a fault."""


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One campaign with one to three faults."""
    random = np.random.default_rng(seed)
    small = FAULTY[seed % len(FAULTY)]
    rig = small.write(work).with_name("rig.toml")
    count = int(random.choice(FAULTS))
    faults = random_faults(seed, rig, length_s=_length_s(small), replies=_replies(random), faults=count)
    rig.write_text(heard(small) + as_toml(faults), encoding="utf-8")
    over_wires = seed % SERVED_EVERY == 0 and small.name in QUICK
    outcome = _over_wires(work, rig.read_text(encoding="utf-8"), seed) if over_wires else here(work, *_run(seed))
    return {
        "campaign": small.name,
        "served": over_wires,
        "faults": kinds_of(faults),
        "status": outcome.status,
        "message": outcome.message,
        "told": told(work / "x.rig.sqlite"),
        "failed": outcome.broken() or _not_tried(outcome) or _judged(work, faults, over_wires),
    }


def _run(seed: int) -> tuple[str, ...]:
    return ("run", "campaign.toml", "--store", "x.rig.sqlite", "--yes", "--json", "--seed", str(seed))


def _over_wires(work: Path, rig_text: str, seed: int) -> Outcome:
    """The same with the rig in another process, by TCP and pseudo-terminals, on a fast clock."""
    text = re.sub(r"^clock_speed = .*\n", "", rig_text.replace('measured = "measured.jsonl"\n', "", 1), flags=re.M)
    text = re.sub(r'^clock = "virtual".*$', f'clock = "real"\nclock_speed = {CLOCK_SPEED}', text, count=1, flags=re.M)
    with served(work, text, "--measured", "measured.jsonl"):
        return Process(work, *_run(seed)).ended(ENDS_S)


def heard(small: SmallCampaign) -> str:
    """The rig file's text: what is measured is written down, and hands are quick, so that faults meet runs."""
    world = '[world]\nmeasured = "measured.jsonl"\n' + WORLD.get(small.rig, QUICK_HANDS)
    return small.rig_text.replace("[world]\n", world, 1)


def _not_tried(outcome: Outcome) -> str:
    """A rig that somebody else on this machine has taken tries nothing: pseudo-terminals are few."""
    return "nothing was tried: the rig was taken" if "holds these instruments" in outcome.message else ""


def _judged(work: Path, faults: Plans, over_wires: bool) -> str:
    store, measured = work / "x.rig.sqlite", work / "measured.jsonl"
    planned = [each.split(" of ")[0] for each in kinds_of(faults)]
    wrong = wrong_number(store, measured, own_clock=over_wires)
    return wrong or unaccounted(store, measured, planned, own_clock=over_wires)


def told(path: Path) -> list[str]:
    """What the store's events say of faults, in the words the operator has."""
    if not path.exists():
        return []
    with Store.open(path, readonly=True) as store:
        data = [event.data for event in store.events()]
    return list(dict.fromkeys(str(said) for each in data for key in SAYING if (said := each.get(key))))


def _replies(random: np.random.Generator) -> int:
    """Within how many replies a fault strikes: instruments differ much in how often they are asked."""
    return int(10 ** random.uniform(1.0, 3.3))


@functools.cache
def _length_s(small: SmallCampaign) -> float:
    """Rig time of the campaign without a fault."""
    with tempfile.TemporaryDirectory() as directory:
        work = Path(directory)
        small.write(work, heard(small))
        here(work, "run", "campaign.toml", "--store", "x.rig.sqlite", "--yes", "--seed", 1)
        with Store.open(work / "x.rig.sqlite", readonly=True) as store:
            return max(event.rig_time_s or 0.0 for event in store.events())
