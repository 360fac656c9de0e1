"""Where in a bundle something is, for messages."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.core.errors import DataError, one_line


@dataclass(frozen=True)
class Place:
    """A file of a bundle as messages name it."""

    file: str

    def error(self, message: str, line: int | None = None) -> DataError:
        """A `DataError` that says where; `message` says what and the mend."""
        return DataError(f"{one_line(self.file)}{'' if line is None else f', line {line}'}: {one_line(message)}")
