"""What a check of an instrument finds: one line for everything that was looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Outcome = Literal["ok", "differs", "unknown"]
Step = Literal["found", "identity", "capability", "limits", "trigger", "interlock", "motion"]
"""In the order in which a check goes."""


@dataclass(frozen=True)
class Finding:
    """What one look at an instrument has shown.

    `mend` says what to do where something differs, and where to look it up where nobody could tell; `rig_file` are
    the keys of the instrument's table as they would have to be. A check goes on as if they were.
    """

    step: Step
    item: str
    outcome: Outcome
    found: str
    mend: str = ""
    rig_file: Mapping[str, Any] = field(default_factory=dict)


def ok(step: Step, item: str, found: str) -> Finding:
    """As it has to be."""
    return Finding(step, item, "ok", found)


def differs(step: Step, item: str, found: str, mend: str, rig_file: Mapping[str, Any] | None = None) -> Finding:
    """Not as it has to be."""
    return Finding(step, item, "differs", found, mend, rig_file or {})


def unknown(step: Step, item: str, found: str, look_up: str) -> Finding:
    """Nobody could tell."""
    return Finding(step, item, "unknown", found, look_up)
