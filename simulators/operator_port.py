"""The port through which the simulated operator handles a served world: one JSON object per line."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from simulators.clock import SimulationClock

LONGEST_LINE_BYTES = 65536


@dataclass(frozen=True)
class Done:
    """An action that is finished at rig time `at_s`, with what there is to tell then."""

    at_s: float
    facts: Mapping[str, Any] = field(default_factory=dict)


Handler = Callable[[dict[str, Any]], Mapping[str, Any] | Done]
"""Does what a request asks and says when it is done; `ValueError` when it cannot be done."""


class OperatorPort:
    """Hands each request to `handler`; called under the clock's lock.

    A request like `{"level": true}` is answered by `{"done": true, ...}` when the action is finished, or by
    `{"error": "..."}`. Answers of actions that take time may come after answers to later requests.
    """

    kind = "operator"

    def __init__(self, handler: Handler, clock: SimulationClock) -> None:
        self._handler = handler
        self._clock = clock

    def connect(self, send: Callable[[bytes], None]) -> OperatorConnection:
        """Serve one more client."""
        return OperatorConnection(self._handler, self._clock, send)


class OperatorConnection:
    """One client of the operator's port."""

    def __init__(self, handler: Handler, clock: SimulationClock, send: Callable[[bytes], None]) -> None:
        self._handler = handler
        self._clock = clock
        self._send = send
        self._received = bytearray()
        self._open = True
        self.hung_up = False

    def receive(self, data: bytes) -> None:
        """Take bytes; every complete line is a request."""
        self._received += data
        while (end := self._received.find(b"\n")) >= 0:
            line = bytes(self._received[:end])
            del self._received[: end + 1]
            if line.strip():
                self._request(line)
        if len(self._received) > LONGEST_LINE_BYTES:
            self._answer({"error": f"a line is at most {LONGEST_LINE_BYTES} bytes"})
            self.hung_up = True

    def close(self) -> None:
        """The client has gone; what it asked for is finished, but not told."""
        self._open = False

    def _request(self, line: bytes) -> None:
        try:
            outcome = self._handler(_parse(line))
        # Deeply nested JSON ends the parser like this.
        except (ValueError, RecursionError) as error:
            self._answer({"error": str(error)})
            return
        if isinstance(outcome, Done):
            self._clock.call_at(outcome.at_s, lambda: self._answer({"done": True, **outcome.facts}))
        else:
            self._answer({"done": True, **outcome})

    def _answer(self, answer: Mapping[str, Any]) -> None:
        if self._open:
            self._send(json.dumps(answer).encode() + b"\n")


def _parse(line: bytes) -> dict[str, Any]:
    request = json.loads(line.decode())
    if isinstance(request, dict):
        return request
    raise ValueError("a request is one JSON object per line")
