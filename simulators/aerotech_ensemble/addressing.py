"""How the axis is named in a line, or that it is not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from simulators.aerotech_ensemble.grammar import Command, Invalid, move_words


class Addressing(Protocol):
    """Where the axis stands among the words of a line; `Invalid` where it should stand and does not."""

    def require(self, words: tuple[str, ...]) -> None:
        """Nothing but the axis, once or several times."""

    def after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """The words behind it."""

    def perhaps_after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """The words behind it where it may be left out."""

    def move(self, words: tuple[str, ...], *, coordinated: bool) -> tuple[float, float | None]:
        """Position and speed of a move."""

    def check(self, command: Command) -> None:
        """The form of a line, before its words are looked at."""


@dataclass(frozen=True)
class NamedAxis:
    """By its name or by `@0`; `bare_speed_word` allows `F20` for the speed of a single axis' move."""

    name: str
    bare_speed_word: bool

    @property
    def _names(self) -> frozenset[str]:
        return frozenset({self.name.upper(), "@0"})

    def require(self, words: tuple[str, ...]) -> None:
        """As in `ABORT X @0`."""
        if not words or any(word not in self._names for word in words):
            raise Invalid

    def after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """As in `GETPARM(X, 2)`."""
        if not words or words[0] not in self._names:
            raise Invalid
        return words[1:]

    def perhaps_after(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """As in `RAMP RATE X 100`, or `RAMP RATE 100`."""
        return words[1:] if len(words) == 2 and words[0] in self._names else words

    def move(self, words: tuple[str, ...], *, coordinated: bool) -> tuple[float, float | None]:
        """As in `X 5 XF20`."""
        own = frozenset(f"{name}F" for name in self._names)
        return move_words(words, self._names, own | {"F"} if coordinated or self.bare_speed_word else own)

    def check(self, command: Command) -> None:
        """Either form will do."""
