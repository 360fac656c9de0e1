"""One group of an XPS: its state, questions about it, and what a refusal means."""

from __future__ import annotations

import contextlib
import re

from drivers.newport_xps_socket import Reply, XpsSocket
from rigctl.core.errors import BadReply, InstrumentError, LinkError, RigError, SafetyStop

# Numbers of GroupStatusGet, as three public drivers agree on them.
NOT_INITIALISED = frozenset({*range(10), 50, 63, 66, 67, 71, 72, 83, 106})
READY = frozenset({*range(10, 20), 56, 70, 77})
DISABLED_BY_SOMETHING = frozenset(range(84, 104))
"""States of newer firmware (XPS-D): disabled by an interlock, a time-out or an interferometer; its text tells."""
DISABLED = frozenset({*range(20, 39), 74, 75, 76}) | DISABLED_BY_SOMETHING
NOT_REFERENCED = 42
AT_REST = NOT_INITIALISED | READY | DISABLED | {NOT_REFERENCED}
ONLY_KILL_STOPS = frozenset({41, 43, 49})
IN_MOTION = frozenset({40, 41, *range(43, 50), 51, 64, 68, 69, 73, 104, 105})

SAFETY_STATES = frozenset({1, 2, 8, 40, 83})
"""After an emergency brake, an emergency stop, an end of run, or an interlock; braking."""
INTERLOCK = re.compile("interlock|emergency|^no text$", re.IGNORECASE)
"""Of those states; one that nobody can name is taken for a safety device's."""

NOT_ALLOWED, ABORTED = -22, -27
SAFETY_ERRORS = frozenset({-26, -45, -113})
ERROR_TEXTS = {
    -1: "socket busy with the previous command",
    -4: "unknown command",
    -5: "not allowed due to a positioner error or hardware status",
    -9: "wrong number of parameters",
    -17: "parameter out of range",
    -18: "unknown positioner name",
    -19: "unknown group name",
    -21: "controller is initialising",
    -22: "not allowed in this state",
    -25: "following error",
    -26: "emergency signal",
    -27: "move aborted",
    -28: "home search timeout",
    -31: "home position out of range",
    -33: "motion done timeout",
    -35: "beyond the travel limits",
    -45: "end of run",
    -49: "home search: mechanical zero error",
    -50: "motor initialisation error",
    -108: "socket closed by administrator",
    -113: "both end-of-runs active",
}


class XpsGroup:
    """Functions called over the socket on which nothing blocks; failures are raised as errors that say what to do."""

    def __init__(self, name: str, group: str, queries: XpsSocket, timeout_s: float) -> None:
        self._name = name
        self._group = group
        self._queries = queries
        self._timeout_s = timeout_s

    def status(self) -> int:
        """Its state, a number of the manual's list."""
        request = f"GroupStatusGet({self._group},int *)"
        (status,) = self.numbers(request, 1)
        if not status.is_integer():
            raise BadReply(f"{self._name}: {request!r} gave {status:g}, which is no state", instrument=self._name)
        return int(status)

    def numbers(self, request: str, count: int) -> tuple[float, ...]:
        """The numbers a function gives; `BadReply` when they are not `count` numbers."""
        reply = self.query(request)
        self.check(request, reply)
        try:
            return reply.numbers(count)
        except ValueError as error:
            raise BadReply(
                f"{self._name}: {request!r} gave {reply.text[:80]!r}: {error}; check the firmware's version",
                instrument=self._name,
                text=reply.text,
            ) from error

    def succeed(self, request: str) -> None:
        """Call a function that gives nothing."""
        self.check(request, self.query(request))

    def query(self, request: str) -> Reply:
        """The reply to a function, whatever its code."""
        return self._queries.exchange(request, self._timeout_s)

    def check(self, request: str, reply: Reply) -> None:
        """`InstrumentError` when a function has failed."""
        if reply.code != 0:
            raise self.refused(request, reply.code)

    def refused(self, request: str, code: int) -> InstrumentError:
        """The error for a function that gave this code, with the controller's own text."""
        # The controller's own text first: wording and codes differ between firmwares.
        text = self._look_up(f"ErrorStringGet({code},char *)") or ERROR_TEXTS.get(code, "unknown error")
        kind = SafetyStop if code in SAFETY_ERRORS else InstrumentError
        return kind(
            f"{self._name}: {request!r} failed with {code} ({text}){self._advice(code)}",
            instrument=self._name,
            code=str(code),
            text=text,
        )

    def _advice(self, code: int) -> str:
        if code != NOT_ALLOWED:
            return ""
        # Advice must not replace the error it belongs to.
        with contextlib.suppress(RigError):
            status = self.status()
            return f" in state {status} ({self.status_text(status)}); home the stage"
        return "; home the stage"

    def not_ready(self, status: int) -> InstrumentError:
        """The error for a group that should move and is in this state."""
        text = self.status_text(status)
        return InstrumentError(
            f"{self._name}: group {self._group} is in state {status} ({text}), not ready to move; "
            "stop it, then home it",
            instrument=self._name,
            code=str(status),
            text=text,
        )

    def status_text(self, status: int) -> str:
        """The controller's text for a state."""
        return self._look_up(f"GroupStatusStringGet({status},char *)") or "no text"

    def safety_text(self, status: int) -> str:
        """The controller's text for a state that a safety device has brought about; "" for any other."""
        if status not in SAFETY_STATES | DISABLED_BY_SOMETHING:
            return ""
        text = self.status_text(status)
        return text if status in SAFETY_STATES or INTERLOCK.search(text) else ""

    def _look_up(self, request: str) -> str:
        """A text for a message, empty when it cannot be had."""
        with contextlib.suppress(LinkError, BadReply):
            reply = self.query(request)
            return reply.text if reply.code == 0 else ""
        return ""
