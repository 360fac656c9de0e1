"""The person at the rig during a check: told what is about to happen, asked what only a person sees."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Collection

from rigctl.core.clock import Clock

POLL_S = 0.1
ANSWER_S = 600.0


class Hands:
    """Speaks by `say`; hears what is typed, where somebody can type. `heed` is called several times a second."""

    def __init__(self, say: Callable[[str], None], heed: Callable[[], None], clock: Clock) -> None:
        self.say = say
        self._heed = heed
        self._clock = clock
        self._typed = b""
        self._deaf = False

    def confirm(self, what: str) -> bool:
        """Whether to go on with what is about to happen: where nobody can type, whoever asked for it has said so."""
        if not self._at_terminal():
            self.say(what)
            return True
        return self.ask(what, ("done", "skip")) == "done"

    def ask(
        self, what: str, answers: Collection[str], seen: Callable[[], str] = lambda: "", wait_s: float = 0.0
    ) -> str:
        """One of the answers, or what was `seen` meanwhile, whichever is first; "" when nobody answers.

        Where nobody can type, `seen` is looked at for `wait_s`.
        """
        self.say(f"{what} Type {' or '.join(repr(answer) for answer in answers)}.")
        end_s = self._clock.now_s() + (ANSWER_S if self._at_terminal() else wait_s)
        while True:
            self._heed()
            if came := seen() or self._line(answers):
                return came
            if self._clock.now_s() >= end_s or (self._deaf and not wait_s):
                return ""
            self._clock.sleep_s(POLL_S)

    def _line(self, answers: Collection[str]) -> str:
        """What was typed and is one of the answers; other lines are passed over."""
        self._listen()
        while b"\n" in self._typed:
            line, _, self._typed = self._typed.partition(b"\n")
            if (answer := line.decode(errors="replace").strip().lower()) in answers:
                return answer
        return ""

    def _listen(self) -> None:
        try:
            if self._deaf or not select.select([sys.stdin], [], [], 0.0)[0]:
                return
            data = os.read(sys.stdin.fileno(), 4096)
        except (OSError, ValueError, TypeError):  # hung up, closed, or never there
            data = b""
        self._typed += data
        self._deaf = not data

    def _at_terminal(self) -> bool:
        try:
            return not self._deaf and sys.stdin.isatty()
        except (AttributeError, ValueError):  # closed, or never there
            return False
