"""What packages register with this program: entry points, each imported only when it is used."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from rigctl.core.errors import ConfigError, one_line

OURS = "rigctl"


class Declaration(Protocol):
    """What is registered."""

    @property
    def contract(self) -> int:
        """The version of the contract it was written for."""


D = TypeVar("D", bound=Declaration)


@dataclass(frozen=True)
class Registry(Generic[D]):
    """One group of entry points, each named as the declaration behind it names itself.

    A package that cannot be used concerns those alone who ask for what it registers: `ConfigError`, one line.
    """

    group: str
    declared: type[D]
    contract: int
    name_of: Callable[[D], str]

    def names(self) -> tuple[str, ...]:
        """All that is registered, sound or not."""
        # A name that is registered twice is one name here; `get` says what is wrong with it.
        return tuple(dict.fromkeys(point.name for point in _points(self.group)))

    def get(self, name: str) -> D:
        """What is registered by this name; imports its module."""
        points = [point for point in _points(self.group) if point.name == name]
        if not points:
            raise ConfigError(f"unknown {self.group} '{name}'; one of {', '.join(self.names())}")
        if len(points) > 1:
            packages = " and ".join(f"{_package(point)} ({point.value})" for point in points)
            raise ConfigError(f"{self.group} '{name}' is registered by {packages}; uninstall one")
        return self._sound(points[0])

    def sound(self) -> Iterator[D]:
        """Everything that can be used; imports all modules."""
        for name in self.names():
            try:
                yield self.get(name)
            # What is wrong with it is for `flaws` to tell.
            except ConfigError:
                continue

    def flaws(self) -> list[str]:
        """What is wrong with each that cannot be used, a line each; imports all modules."""
        return [str(flaw) for name in self.names() if (flaw := self._flaw(name))]

    def _flaw(self, name: str) -> ConfigError | None:
        try:
            self.get(name)
        except ConfigError as flaw:
            return flaw
        return None

    def _sound(self, point: EntryPoint) -> D:
        where = f"{self.group} '{point.name}' of {_package(point)}"
        declaration = _loaded(point, where)
        if not isinstance(declaration, self.declared):
            raise ConfigError(f"{where}: {point.value} is no {self.declared.__name__}; correct the entry point")
        if declaration.contract != self.contract:
            raise ConfigError(
                f"{where} was written for contract {declaration.contract}, this program has {self.contract}; "
                "install the versions that belong together"
            )
        if self.name_of(declaration) != point.name:
            raise ConfigError(f"{where} calls itself '{self.name_of(declaration)}'; correct the entry point's name")
        return declaration


def resolved(text: str, who: str) -> Any:
    """The object behind `package.module:OBJECT`, imported now; `ConfigError` that says of `who` what fails."""
    return _loaded(EntryPoint(who, text, ""), who)


def _loaded(point: EntryPoint, where: str) -> Any:
    try:
        return point.load()
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever another's module may raise
        why = one_line(f"{type(error).__name__}: {error}")
        raise ConfigError(f"{where} cannot be imported ({why}); mend or uninstall it") from None


@cache
def _points(group: str) -> tuple[EntryPoint, ...]:
    """Of a source tree, what its pyproject.toml says now: an editable install may be older than that."""
    tree = _of_the_tree(group)
    others = [point for point in entry_points(group=group) if not tree or _package(point) != OURS]
    # A tree that is installed twice on the path shows the same entry point twice.
    distinct = {(point.name, point.value): point for point in (*tree, *others)}
    return tuple(distinct.values())


def _of_the_tree(group: str) -> list[EntryPoint]:
    try:
        text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
        project = tomllib.loads(text)["project"]
    # An installed program has no such file; where it is being edited, what is installed counts.
    except (OSError, tomllib.TOMLDecodeError, KeyError):
        return []
    listed = project.get("entry-points", {}).get(group, {}) if project.get("name") == OURS else {}
    return [EntryPoint(name, value, group) for name, value in listed.items()]


def _package(point: EntryPoint) -> str:
    # Those that were read from this tree's own pyproject.toml belong to no installed package.
    return point.dist.name if point.dist is not None else OURS
