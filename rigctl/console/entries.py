"""What a form shows of a campaign file: keys that can be edited, and lists that are kept as they are."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One key: `text` as the form shows it, "" when the file leaves it to its `default`; None if it must be there."""

    table: str
    key: str
    text: str
    default: str | None
    choices: tuple[str, ...] = ()
    words: bool = False
    listed: bool = False

    @property
    def name(self) -> str:
        """As faults name it."""
        return f"{self.table}.{self.key}" if self.table else self.key

    @property
    def hint(self) -> str:
        """What stands where nothing is written."""
        if self.default is None:
            expected = "required"
        else:
            expected = f"{self.default} if left out" if self.default else "may be left out"
        return f"{expected}: {' | '.join(self.choices)}" if self.choices else expected


@dataclass(frozen=True)
class Listing:
    """A list of tables, `[[name]]`, each in a line: shown here and kept as it is, changed in an editor."""

    table: str
    key: str
    rows: tuple[str, ...]
