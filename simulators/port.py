"""A loopback port at which an instrument can be reached."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable

from rigctl.core.errors import ConfigError
from simulators.wiring import SimulatedInstrument

LOOPBACK = "127.0.0.1"

Ready = Callable[[socket.socket, SimulatedInstrument], None]


class Port:
    """A loopback port; nobody listens at it while its instrument does not, if that can be said of it."""

    def __init__(
        self, name: str, instrument: SimulatedInstrument, port: int, ready: Ready, selector: selectors.BaseSelector
    ) -> None:
        self._name = name
        self._instrument = instrument
        self._ready = ready
        self._selector = selector
        self._listener: socket.socket | None = None
        self._number = port
        self._open()

    @property
    def number(self) -> int:
        """Which port it is."""
        return self._number

    def look(self) -> None:
        """See whether anybody listens."""
        # Only faulty instruments know when nobody listens.
        listening = bool(getattr(self._instrument, "listening", True))
        if listening and self._listener is None:
            self._open()
        elif not listening:
            self.close()

    def close(self) -> None:
        """Nobody listens any more; may be called twice."""
        if self._listener is not None:
            self._selector.unregister(self._listener)
            self._listener.close()
            self._listener = None

    def _open(self) -> None:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            # A port that was just closed may be opened again at once.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((LOOPBACK, self._number))
        except (OSError, OverflowError) as error:
            listener.close()
            raise ConfigError(
                f"{self._name}: cannot serve on {LOOPBACK} port {self._number} ({error}); "
                "choose another or leave it out"
            ) from error
        listener.listen()
        listener.setblocking(False)
        self._listener, self._number = listener, listener.getsockname()[1]
        self._selector.register(listener, selectors.EVENT_READ, lambda _: self._ready(listener, self._instrument))
