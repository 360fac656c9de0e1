"""What each command takes, read from the definitions of the commands: for completion and the manual page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from typer.main import get_command

from rigctl.cli.application import app


@dataclass(frozen=True)
class Parameter:
    """An argument, which has no `names`, or an option; `value` is the placeholder of its value, empty for a flag."""

    names: tuple[str, ...]
    value: str
    help: str
    required: bool


@dataclass(frozen=True)
class Definition:
    """A command by its full name, "run" or "model add", with its help and what it takes."""

    name: str
    help: str
    parameters: tuple[Parameter, ...]

    @property
    def summary(self) -> str:
        """The first line of its help."""
        return self.help.split("\n", 1)[0]

    @property
    def arguments(self) -> list[Parameter]:
        """In their order."""
        return [each for each in self.parameters if not each.names]

    @property
    def options(self) -> list[Parameter]:
        """As the help lists them."""
        return [each for each in self.parameters if each.names]


def definitions() -> Iterator[Definition]:
    """All commands in the order of the help; imports nothing that they work with."""
    for name, lazy in get_command(app).commands.items():  # type: ignore[attr-defined]
        command = lazy.declared()
        parts = getattr(command, "commands", None)
        if parts is None:
            yield _definition(name, command)
        else:
            yield from (_definition(f"{name} {part}", each) for part, each in parts.items())


def _definition(name: str, command: Any) -> Definition:
    return Definition(name, command.help or "", tuple(map(_parameter, command.params)))


def _parameter(parameter: Any) -> Parameter:
    named = parameter.param_type_name == "option"
    value = "" if named and parameter.is_flag else parameter.metavar
    names = (*parameter.opts, *parameter.secondary_opts) if named else ()
    return Parameter(names, value, parameter.help or "", bool(parameter.required))
