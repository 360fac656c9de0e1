"""What a second world must offer for blind trials on it, and what all of them need to score an answer."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from tests.foreign.sessions import Session


class Trial(Protocol):
    """One draw: the effects that are hidden with their sizes in sigma, and the parameters the world was given."""

    @property
    def hidden(self) -> Mapping[str, float]: ...

    @property
    def parameters(self) -> Mapping[str, float]: ...


def nothing(trial: Any, session: Session) -> set[str]:
    return set()


@dataclass(frozen=True)
class Kind:
    """A second world as trials see it.

    ``known`` and ``unknown`` are its effects, each with its parameters' names without places; ``companions`` are
    effects that nature brings along. ``fitted_name`` is the fit's name, of those given, for a parameter of an effect
    of this trial, or None; ``unpulled`` are effects whose parameters do not compare one by one; ``displaced`` are
    effects that were named, but of another part of the bench.
    """

    drawn: Callable[[int], Any]
    write: Callable[[Any, int, Path], None]
    known: Mapping[str, tuple[str, ...]]
    unknown: Mapping[str, tuple[str, ...]]
    fitted_name: Callable[[Any, str, str, Collection[str]], str | None]
    companions: Mapping[str, set[str]] = field(default_factory=dict)
    unpulled: frozenset[str] = frozenset()
    displaced: Callable[[Any, Session], set[str]] = nothing

    def pulls(self, trial: Trial, session: Session) -> dict[str, float]:
        """(fitted - true) / sigma of every parameter of the effects that were hidden and named."""
        found: dict[str, float] = {}
        parameters = session.fit["parameters"]
        alike = {entry["effect"]: set(entry["equivalent_to"]) for entry in session.diagnose["ranking"]}
        for name in set(trial.hidden) & set(session.suggested) - self.unpulled:
            # Of two that cannot be told apart only the sum is known.
            if alike.get(name, set()) & set(trial.hidden) - {name}:
                continue
            for parameter, true in trial.parameters.items():
                if re.sub(r"\[.*", "", parameter) not in self.known[name]:
                    continue
                called = self.fitted_name(trial, name, parameter, list(parameters))
                if called and parameters[called]["sigma"]:
                    found[parameter] = (parameters[called]["value"] - true) / parameters[called]["sigma"]
        return found
