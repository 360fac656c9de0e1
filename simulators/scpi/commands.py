"""Commands of a simulated SCPI device: what a header does with its parameters, and replies that come later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from simulators.scpi.grammar import Integer, Number, ScpiError


@dataclass(frozen=True)
class Pending:
    """A reply that comes later: when `ready`, which is looked at after every command and at `wake_s`."""

    ready: Callable[[], bool]
    reply: Callable[[], Reply]
    wake_s: Callable[[], float]
    is_query: bool = True


Immediate = str | bytes | None
Reply = Immediate | Pending


@dataclass(frozen=True)
class Command:
    """A header as the manual writes it and what it does with its parameters (after numeric suffixes)."""

    pattern: str
    handler: Callable[..., Reply]
    required: int = 0
    optional: int = 0


class ParameterType(Protocol):
    """How one parameter is read and written."""

    def parse(self, text: str) -> Any:
        """The value of what was sent."""
        ...

    def format(self, value: Any) -> str:
        """The value as it is sent."""
        ...


def setting(
    pattern: str, kind: ParameterType, get: Callable[[], Any], put: Callable[[Any], None]
) -> tuple[Command, Command]:
    """The command that sets a value, and its query; that of a number also answers MIN, MAX and DEF."""

    def query(*which: str) -> str:
        return kind.format(kind.limit(which[0]) if which and isinstance(kind, Number) else get())

    return (
        Command(pattern, lambda text: put(kind.parse(text)), 1),
        Command(pattern + "?", query, 0, isinstance(kind, Number)),
    )


def resting(pattern: str, kind: ParameterType, value: Any) -> tuple[Command, Command]:
    """A setting that is not simulated: it has this value, which may be set again; any other is a settings conflict.

    So that nobody takes for done what was not.
    """
    return setting(pattern, kind, lambda: value, lambda told: require_resting(told, value))


def require_resting(told: Any, value: Any) -> None:
    """-221 for another value than the one that it has."""
    if told != value:
        raise ScpiError(-221, "not simulated")


@dataclass
class Register:
    """A status register; `condition`, asked before the latched events are read, may bring more of them."""

    condition: Callable[[], int] = lambda: 0
    event: int = 0
    enable: int = 0

    def read(self) -> int:
        """The events since the last time."""
        self.condition()
        event, self.event = self.event, 0
        return event

    def set_enable(self, mask: float) -> None:
        """Which events the summary tells of."""
        self.enable = int(mask)

    @property
    def summary(self) -> bool:
        """True when an enabled event is latched."""
        self.condition()
        return bool(self.event & self.enable)


def register_commands(name: str, register: Register) -> tuple[Command, ...]:
    """The commands of a status register."""
    word = Integer(0, 32767, 0)
    return (
        Command(f"STATus:{name}[:EVENt]?", lambda: f"{register.read():+d}"),
        Command(f"STATus:{name}:CONDition?", lambda: f"{register.condition():+d}"),
        *setting(f"STATus:{name}:ENABle", word, lambda: register.enable, register.set_enable),
    )
