"""Effects that are much the same question are a family, with one portion of the level (decision 052)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from rigctl.workbench.study import Study


@runtime_checkable
class HasFamilies(Protocol):
    """A study whose effects are much the same question in families, each of which has one portion of the level."""

    def family(self, effect: str) -> str:
        """The family of an effect, by id."""


def families_of(study: Study) -> Callable[[str], str]:
    """What tells the family of an effect; of a study without families all effects are one."""
    return study.family if isinstance(study, HasFamilies) else lambda _: ""
