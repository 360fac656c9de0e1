"""The person at the rig: actions no instrument can do, asked for and confirmed."""

from __future__ import annotations

import math
import os
import select
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any, Protocol

from rigctl.campaign.session.questions import Questions
from rigctl.core.errors import Aborted, ProcedureError

HEED_S = 0.1
"""How often a question looks up whether the campaign is being aborted (wall-clock)."""

FLIPS = {
    1: "Turn both sensors so that +g acts along them (arrow up), and bypass their amplifiers",
    -1: "Turn both sensors so that -g acts along them (arrow down), and bypass their amplifiers",
    0: "Put both sensors back on the platform, and their amplifiers back in",
}
"""What the person is asked to do, by the sign of g."""


@dataclass(frozen=True)
class Levelled:
    """When a mounting was levelled, and what the rotation stage read then."""

    at_s: float
    angle_deg: float


class OperatorLink(Protocol):
    """The hands of a simulated rig: what a person would do, done by the world. Nobody measures through it."""

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        """Do `{"remount": {...}}`, `{"level": true}`, `{"room": {...}}`, `{"flip": 1}` or `{"run": n}`.

        The answer to each, and to `{"stands": true}`, tells what `stands`: what hands have made, as such actions.
        """


@dataclass
class Operator:
    """Who is asked, and what hands then do: those of a simulated world, and none at a real rig.

    Every call returns once the action is done; `Aborted` when a person refuses.
    """

    link: OperatorLink | None
    heed: Callable[[], None] = field(default=lambda: None, kw_only=True)
    """Called several times a second while the hands are at work: what it raises ends the waiting."""

    def remount(self, axis: str, configuration: str, mounting: int) -> None:
        """Take the package off and seat it again for `axis` in `configuration`."""
        self._confirm(f"Mount the package for axis {axis} in {configuration} (mounting {mounting})")
        self._act(_seated(axis, configuration, mounting))

    def level(self, reading_v: float) -> float | None:
        """Turn the levelling screws until the static output is inside its limit.

        Returns when that was, by the clock of a served world; None where there is no clock but ours.
        """
        seen = f": static output {reading_v:+.3f} V" if math.isfinite(reading_v) else ""
        self._confirm(f"Level the package{seen}")
        return self._act({"level": True}).get("rig_time_s")

    def still_mounted(self, axis: str, configuration: str, mounting: int, levelled: Levelled | None = None) -> bool:
        """After a restart: is this mounting in place and untouched since it was `levelled`?

        A world that was served all the time says so itself; one that starts anew has nothing mounted. There the same
        mounting is made again, which nature repeats, and levelled as it was then, not anew: what has drifted since is
        to be seen.
        """
        seated = _seated(axis, configuration, mounting)
        stands = self._act({"stands": True}).get("stands", [])
        if seated in stands and (levelled is None or any("level" in made for made in stands)):
            return True
        self._act(seated)
        self._act({"level": True if levelled is None else asdict(levelled)})
        return True

    def bring_room_to(self, temperature_c: float) -> None:
        """Have the room, and all in it, at a temperature [degC]."""
        self._confirm(f"Bring the room to {temperature_c:g} degC and wait until the bench has followed")
        self._act({"room": {"temperature_c": temperature_c}})

    def restore_room(self, temperature_c: float, at_s: float) -> None:
        """After a restart: the room set out for this temperature at rig time `at_s`.

        A world that starts anew has to be told so; a person's room is as it is.
        """
        self._act({"room": {"temperature_c": temperature_c, "at_s": at_s}})

    def flip(self, g_sign: int) -> None:
        """Turn the sensors so that +g or -g acts along them, amplifiers bypassed; 0: back as they were."""
        self._confirm(FLIPS[g_sign])
        self._act({"flip": g_sign})

    def accept(self, question: str) -> bool:  # noqa: ARG002
        """Whether to go on in spite of what the question says: never when nobody watches."""
        return False

    def announce_run(self, number: int) -> None:
        """A run begins, the key of a simulated world's randomness; a person need not know."""
        self._act({"run": number})

    def _confirm(self, request: str) -> None:
        """Return when it may be taken for done: at once where nobody is asked."""

    def _act(self, action: dict[str, Any]) -> dict[str, Any]:
        if self.link is None:
            return {}
        answer = _awaited(partial(self.link.request, action), self.heed)
        if "error" in answer:
            raise ProcedureError(f"the simulated operator could not do {action}: {answer['error']}")
        return answer


class TypedLines:
    """Lines somebody types on the standard input; `heed` is called several times a second while nobody does.

    `elsewhere` gives a line that was typed somewhere else, None while there is none.
    """

    def __init__(self, heed: Callable[[], None], elsewhere: Callable[[], str | None] = lambda: None) -> None:
        self._heed = heed
        self._elsewhere = elsewhere
        self._typed = bytearray()

    def __call__(self) -> str:
        """The next line; `EOFError` at the end, or when the terminal is gone."""
        while b"\n" not in self._typed:
            if (elsewhere := self._elsewhere()) is not None:
                return elsewhere
            self._typed += self._read()
        line, _, rest = self._typed.partition(b"\n")
        self._typed = rest
        return line.decode(errors="replace")

    def _read(self) -> bytes:
        try:
            # Not input(): it cannot be left while nobody types, and an abort has to be heeded.
            if not select.select([sys.stdin], [], [], HEED_S)[0]:
                self._heed()
                return b""
            data = os.read(sys.stdin.fileno(), 4096)
        except (OSError, ValueError, TypeError):  # hung up, closed, or never there
            data = b""
        if not data:
            self._heed()  # who aborts often closes the terminal with the same gesture
            raise EOFError
        return data


@dataclass
class TerminalOperator(Operator):
    """Asks a person at the terminal first, and has the hands of a simulated world do what was confirmed."""

    ask: Callable[[], str]
    questions: Questions | None = None
    """Where what is asked is put up too, for whoever else looks after the campaign."""

    def still_mounted(self, axis: str, configuration: str, mounting: int, levelled: Levelled | None = None) -> bool:
        """Ask whether the mounting survived."""
        question = f"Is {axis} in {configuration}, mounting {mounting}, still in place and untouched?"
        return self.accept(question) and super().still_mounted(axis, configuration, mounting, levelled)

    def accept(self, question: str) -> bool:
        """Yes or no."""
        while True:
            answer = self._read(f"{question} [y/n] ").strip().lower()
            if answer in {"y", "yes"}:
                return True
            if answer in {"n", "no"}:
                return False

    def _confirm(self, request: str) -> None:
        while True:
            answer = self._read(f"{request}. Type 'done', or 'abort': ").strip().lower()
            if answer == "done":
                return
            if answer == "abort":
                raise Aborted(f"the operator aborted at: {request}")

    def _read(self, prompt: str) -> str:
        try:
            print(prompt, end="", file=sys.stderr, flush=True)  # noqa: T201 - stdout belongs to --json
            if self.questions is not None:
                self.questions.post(prompt)
            answer = self.ask()
        except EOFError:
            raise ProcedureError(
                f"nobody at the terminal to answer: {prompt.strip()} Run with --yes, or at a terminal"
            ) from None
        if self.questions is not None:
            self.questions.close(answer)
        return answer


def _seated(axis: str, configuration: str, mounting: int) -> dict[str, Any]:
    return {"remount": {"axis": axis, "configuration": configuration, "mounting": mounting}}


def _awaited(act: Callable[[], dict[str, Any]], heed: Callable[[], None]) -> dict[str, Any]:
    """What `act` returns; it goes on behind, and nobody hears of it, when `heed` raises first."""
    outcome: Future[dict[str, Any]] = Future()

    def carry_out() -> None:
        try:
            outcome.set_result(act())
        except BaseException as error:  # noqa: BLE001 - raised where it is awaited
            outcome.set_exception(error)

    # A thread, because hands may take hours of rig time and an abort must not wait for them.
    threading.Thread(target=carry_out, name="operator's hands", daemon=True).start()
    while not wait([outcome], HEED_S).done:
        heed()
    return outcome.result()
