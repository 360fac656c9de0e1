"""The operator's port of a served simulated world: one JSON object per line, answered when it is done."""

from __future__ import annotations

import json
import math
import socket
from typing import Any

from rigctl.clock import Clock
from rigctl.errors import BadReply, ConfigError, LinkLost, LinkTimeout

LONGEST_ACTION_S = 7200.0
"""Rig time within which any action of the hands is done."""


class TcpOperatorLink:
    """Connects anew for every action, so that a restarted world is found again."""

    def __init__(self, address: str, clock: Clock) -> None:
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        if not address.startswith("tcp://") or not host or not port.isdigit():
            raise ConfigError(f"operator.address '{address}' is not understood; write tcp://host:port")
        self._where = (host, int(port))
        self._address = address
        speed = clock.speed if math.isfinite(clock.speed) else 1.0
        self._timeout_s = LONGEST_ACTION_S / speed + 10.0

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        """Have it done and wait for the answer."""
        try:
            with socket.create_connection(self._where, timeout=self._timeout_s) as link:
                link.sendall(json.dumps(action).encode() + b"\n")
                line = link.makefile("rb").readline()
        except TimeoutError:
            raise LinkTimeout(f"{self._address}: the simulated operator did not answer to {action}") from None
        except OSError as error:
            raise LinkLost(
                f"{self._address}: no simulated operator ({error}); is `rigctl simulate` running?"
            ) from None
        if not line:
            raise LinkLost(f"{self._address}: the simulated operator hung up; is `rigctl simulate` running?")
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise BadReply(f"{self._address}: {line[:60]!r} is no operator's answer; is this the operator's port?")
        return answer
