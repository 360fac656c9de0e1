"""An instrument that is a list of messages and replies."""

from __future__ import annotations

from collections.abc import Callable

Send = Callable[[bytes], None]


class Expected:
    """Expects these messages in this order and gives these replies."""

    def __init__(self, *exchanges: tuple[bytes, bytes]) -> None:
        self.left = list(exchanges)
        self._send: Send = lambda _: None

    def connect(self, send: Send) -> Expected:
        self._send = send
        return self

    def receive(self, data: bytes) -> None:
        message, reply = self.left.pop(0)
        assert data == message
        self._send(reply)

    def close(self) -> None:
        pass
