"""Lines for a controller with one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from simulators.aerotech_ensemble.grammar import Command, Invalid, move_words, none

POSITION, SPEED = frozenset({"D"}), frozenset({"F"})
READINGS = frozenset({"PFBK", "PFBKPROG", "PCMD", "PCMDPROG", "CMDPOS", "PERR", "VFBK", "VCMD"})
QUESTIONS = READINGS | {"AXISSTATUS", "AXISFAULT"}


@dataclass(frozen=True)
class SoleAxis:
    """The axis is in no line."""

    questions: Literal["bare", "parentheses", "either"]

    def require(self, words: tuple[str, ...]) -> None:
        """As in `ABORT`."""
        none(words)

    def after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """As in `GETPARM(257)`."""
        return words

    def perhaps_after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """As in `RAMP RATE 100`."""
        return words

    def move(self, words: tuple[str, ...], *, coordinated: bool) -> tuple[float, float | None]:  # noqa: ARG002
        """As in `D12.5 F20`."""
        return move_words(words, POSITION, SPEED)

    def check(self, command: Command) -> None:
        """A question without arguments has `()` behind it, or nothing."""
        if command.words or self.questions == "either" or command.keyword not in QUESTIONS:
            return
        if command.called != (self.questions == "parentheses"):
            raise Invalid
