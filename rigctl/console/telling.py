"""What the console tells: alarms as long as they last, the last note for a while, the title of the terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from rigctl.console.messages import Severity

if TYPE_CHECKING:
    from rigctl.console.alarms import Alarm  # with what instruments are, which the first paint does not wait for

NOTE_S = 8.0
ERROR_S = 30.0
"""A note is seen for so long; all of them are in the log."""
AGAIN_S = 10.0
"""What the campaign asks rings again after so long, until it is answered."""


class Bell:
    """Rings once for each alarm that is new, and again and again while the campaign waits for an answer."""

    def __init__(self, ring: Callable[[], object]) -> None:
        self._ring = ring
        self._known: frozenset[str] = frozenset()
        self._rung_s = 0.0

    def hear(self, alarms: Sequence[Alarm]) -> None:
        """What is wrong now."""
        keys = frozenset(alarm.key for alarm in alarms)
        asked = any(alarm.key.startswith("question ") for alarm in alarms)
        if keys - self._known or (asked and time.monotonic() - self._rung_s > AGAIN_S):
            self._rung_s = time.monotonic()
            self._ring()
        self._known = keys


class Notes:
    """The last thing that was told, until it is old."""

    def __init__(self) -> None:
        self._text = ""
        self._severity: Severity = "information"
        self._until_s = 0.0

    def tell(self, text: str, severity: Severity) -> None:
        """Something new; an error is not pushed away by what is none."""
        if severity != "error" and self._severity == "error" and time.monotonic() < self._until_s:
            return
        self._text, self._severity = text, severity
        self._until_s = time.monotonic() + (ERROR_S if severity == "error" else NOTE_S)

    def forget(self) -> None:
        """It has been read."""
        self._until_s = 0.0

    def text(self, jobs: Sequence[str]) -> Text:
        """What is being worked out, then the note."""
        lines = [Text(f"… {job}") for job in jobs]
        if self._text and time.monotonic() < self._until_s:
            sign = {"error": "✗ ", "warning": "! "}.get(self._severity, "")
            lines.append(Text(sign + self._text, style="bold" if self._severity != "information" else ""))
        return Text("\n").join(lines)
