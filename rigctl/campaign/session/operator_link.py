"""The operator's port of a served simulated world: one JSON object per line, answered when it is done."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Callable
from typing import Any

from rigctl.core.clock import Clock
from rigctl.core.errors import BadReply, ConfigError, LinkLost, LinkTimeout, ProcedureError

LONGEST_ACTION_S = 7200.0
"""Rig time within which any action of the hands is done."""

Ask = Callable[[dict[str, Any]], dict[str, Any]]


class TcpOperatorLink:
    """Connects anew for every action, so that a restarted world is found again.

    A package stays where it is when a simulator ends: in a world that was started anew everything is first made as it
    stood, at the rig time that it would be by now.
    """

    def __init__(self, address: str, clock: Clock) -> None:
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        if not address.startswith("tcp://") or not host or not port.isdigit():
            raise ConfigError(f"operator.address '{address}' is not understood; write tcp://host:port")
        self._where = (host, int(port))
        self._address = address
        self._clock = clock
        speed = clock.speed if math.isfinite(clock.speed) else 1.0
        # On top, for the exchange itself, which takes wall-clock time however fast the rig's clock is.
        self._timeout_s = LONGEST_ACTION_S / speed + 10.0
        self._stood: list[dict[str, Any]] = []
        self._ahead_s = 0.0

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        """Have it done and wait for the answer."""
        try:
            with socket.create_connection(self._where, timeout=self._timeout_s) as link, link.makefile("rb") as lines:

                def ask(wanted: dict[str, Any]) -> dict[str, Any]:
                    link.sendall(json.dumps(wanted).encode() + b"\n")
                    return self._parsed(lines.readline())

                # Before every action: the connection is new, and the world behind it may be.
                self._restore(ask)
                answer = ask(action)
        except TimeoutError:
            raise LinkTimeout(f"{self._address}: the simulated operator did not answer to {action}") from None
        except OSError as error:
            raise LinkLost(
                f"{self._address}: no simulated operator ({error}); is `rigctl simulate` running?"
            ) from None
        self._stood = answer.get("stands", self._stood)
        # The world's clock is its own: kept as a difference, so that a restarted world can be put on to it.
        self._ahead_s = answer.get("rig_time_s", 0.0) - self._clock.now_s()
        return answer

    def _restore(self, ask: Ask) -> None:
        """Make everything as it stood where nothing stands any more."""
        if not self._stood or ask({"stands": True}).get("stands"):
            return
        # First the clock: levelling and room temperature are functions of rig time.
        for made in [{"clock": self._clock.now_s() + self._ahead_s}, *self._stood]:
            answer = ask(made)
            if "error" in answer:
                raise ProcedureError(f"{self._address}: a world started anew has not done {made}: {answer['error']}")

    def _parsed(self, line: bytes) -> dict[str, Any]:
        if not line:
            raise LinkLost(f"{self._address}: the simulated operator hung up; is `rigctl simulate` running?")
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise BadReply(f"{self._address}: {line[:60]!r} is no operator's answer; is this the operator's port?")
        return answer
