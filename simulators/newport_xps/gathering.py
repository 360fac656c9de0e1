"""The controller's gathering memory: positions on the servo clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.clock import SimulationClock
from simulators.newport_xps.codes import Refused
from simulators.newport_xps.grammar import format_number
from simulators.newport_xps.settings import XpsSimulatorSettings

REPLY_BYTES_MAX = 65536
CAPTURE_EVERY_S = 30.0
"""Axes forget old motion, so a long gathering is captured piecewise."""


class Gathering:
    """Gathers chosen quantities every `divisor` servo cycles."""

    def __init__(
        self,
        sources: Mapping[str, Callable[[FloatArray], FloatArray]],
        clock: SimulationClock,
        settings: XpsSimulatorSettings,
    ) -> None:
        self._sources = sources
        self._clock = clock
        self._settings = settings
        self.mnemonics: tuple[str, ...] = ()
        self._run = 0
        self.reset()

    def reset(self) -> None:
        """Forget the data and end a gathering that runs."""
        self._run += 1
        self._wanted = 0
        self._rows: list[FloatArray] = []
        self._count = 0
        self._start_s = self._period_s = 0.0

    def configure(self, mnemonics: Sequence[str]) -> None:
        """Choose what to gather; -43 while running, -29 for a name it does not know."""
        if self.running():
            raise Refused(-43)
        if any(mnemonic not in self._sources for mnemonic in mnemonics):
            raise Refused(-29)
        self.mnemonics = tuple(mnemonics)
        self.reset()

    def run(self, points: int, divisor: int) -> None:
        """Start; -32 unconfigured, -43 while running, -17 not positive, -111 beyond the memory."""
        if not self.mnemonics:
            raise Refused(-32)
        if self.running():
            raise Refused(-43)
        if points < 1 or divisor < 1:
            raise Refused(-17)
        if points > self.capacity:
            raise Refused(-111)
        self.reset()
        self._wanted = points
        self._start_s = self._clock.now_s()
        self._period_s = divisor * self._settings.servo_period_s
        self._capture_later(self._run)

    def stop(self) -> None:
        """End early and keep what there is; -30 when not running."""
        if not self.running():
            raise Refused(-30)
        self._wanted = self._count

    def running(self) -> bool:
        """True until the last point is taken."""
        self._capture()
        return self._count < self._wanted

    @property
    def capacity(self) -> int:
        """Points that fit into the memory."""
        return self._settings.gathering_values_max // max(1, len(self.mnemonics))

    def count(self) -> int:
        """Points gathered so far."""
        self._capture()
        return self._count

    def lines(self, first: int, count: int) -> str:
        """`count` points from index `first`; -32 unconfigured, -17 not there, -3 if longer than a reply."""
        if not self.mnemonics:
            raise Refused(-32)
        if first < 0 or count < 1 or first + count > self.count():
            raise Refused(-17)
        # Pieces are joined when somebody asks, not at every capture.
        self._rows = [np.concatenate(self._rows)]
        rows = self._rows[0][first : first + count]
        # A row is at least two bytes: more rows would not fit into a reply anyway.
        text = "".join(";".join(map(format_number, row)) + "\n" for row in rows[: REPLY_BYTES_MAX // 2])
        if len(text) > REPLY_BYTES_MAX:
            raise Refused(-3)
        return text

    def _capture(self) -> None:
        if self._count == self._wanted:
            return
        # Rounding must not lose the point of this very instant.
        elapsed = int((self._clock.now_s() - self._start_s) / self._period_s + 1e-6) + 1
        due = np.arange(self._count, min(self._wanted, elapsed))
        if due.size:
            times_s: FloatArray = self._start_s + due.astype(np.float64) * self._period_s
            self._rows.append(np.column_stack([self._sources[m](times_s) for m in self.mnemonics]))
            self._count += due.size

    def _capture_later(self, run: int) -> None:
        def due() -> None:
            if run == self._run and self.running():
                self._capture_later(run)

        self._clock.call_at(self._clock.now_s() + CAPTURE_EVERY_S, due)
