"""What becomes of a command besides a value."""

from __future__ import annotations

from dataclasses import dataclass


class Faulted(Exception):
    """Understood but not executed."""


class Restarting(Exception):
    """The controller boots; nobody is answered."""


@dataclass(frozen=True)
class Blocked:
    """The acknowledge comes at `until_s`; nothing else is interpreted before."""

    until_s: float


Reply = str | Blocked | None
"""A value, an acknowledge that comes later, or (None) at once."""
