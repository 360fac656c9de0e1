"""DATAACQ of an Ensemble: the encoder latched at every trigger edge, read from the controller's registers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.aerotech_axis import AsciiAxis
from drivers.aerotech_commands import Commands
from drivers.aerotech_settings import StageSettings
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.errors import EdgesMissing, InstrumentError, LimitError

COUNTED_MAX = 16
"""Of a record that is short by some positions of more than these, nobody waits for how many came."""

NOT_WRITTEN = -(1 << 31)
"""Marks a register: the lowest number it holds, farther out than any stage of this precision goes."""


class PositionCapture:
    """One record at a time, as whole counts in the controller's integer registers (IGLOBAL).

    Successive reads go on where the last ended, or begin anew (`capture_read`). Before each read the last register
    is marked, so that a controller with fewer points cannot pass old values off as new.
    """

    def __init__(self, name: str, settings: StageSettings, wire: AsciiAxis, clock: Clock) -> None:
        self._name = name
        self._settings = settings
        self._wire = wire
        self._clock = clock
        self._armed = 0
        self._commands: Commands | None = None
        self._registers: int | None = None

    def provide(self, registers: int) -> None:
        """How many integer registers the controller says it has."""
        self._registers = registers

    def longest_record(self, period_s: float) -> int:
        """Most positions of one record; `LimitError` when the capture is not that fast."""
        s = self._settings
        if period_s < s.capture_period_min_s:
            raise LimitError(
                f"{self._name}: cannot capture every {period_s:g} s; "
                f"the shortest period is {s.capture_period_min_s:g} s"
            )
        return min(s.capture_points_max, self._one_read()) if s.capture_read == "restarts" else s.capture_points_max

    def arm(self, samples: int, period_s: float, commands: Callable[[], Commands]) -> None:
        """Clear and wait for `samples` edges, `period_s` apart; `commands` is asked once they are known to fit."""
        capacity = self.longest_record(period_s)
        if not 1 <= samples <= capacity:
            raise LimitError(
                f"{self._name}: cannot capture {samples} positions, at most {capacity}; record for a shorter time or "
                "at a longer period, or raise the controller's GlobalIntegers (its parameter 124)"
            )
        self._commands = commands()
        self._commands.arm(samples)
        self._armed = samples

    def end(self) -> None:
        """Wait for no more edges."""
        if self._armed and self._commands is not None:
            # Forgotten first: a stop that comes while OFF is under way must not send it a second time.
            self._armed = 0
            self._commands.end()

    def counts(self) -> FloatArray:
        """The encoder at every edge, in counts; `InstrumentError` when edges were missed."""
        samples, self._armed = self._armed, 0
        if not samples or self._commands is None:
            raise InstrumentError(f"{self._name}: no capture is armed; arm it before the run", instrument=self._name)
        # The last edge was seen by the pacing instrument; the position of this one is latched `latency_s` later.
        if self._settings.latency_s > 0.0:
            self._clock.sleep_s(self._settings.latency_s)
        counts: list[int] = []
        while len(counts) < samples:
            count = min(self._one_read(), samples - len(counts))
            read = self._read(self._commands, count)
            if read is None:
                raise self._too_few(self._commands, len(counts), count, samples)
            counts += read
        return np.array(counts, dtype=np.float64)

    def _one_read(self) -> int:
        """How many positions one read brings; what the settings say before the controller was asked."""
        s = self._settings
        there = s.capture_points_max if self._registers is None else self._registers - s.capture_register_first
        return max(min(there, s.capture_registers or there), 0)

    def _read(self, commands: Commands, count: int) -> list[int] | None:
        """The next so many; None when they are not all there."""
        first = self._settings.capture_register_first
        last = first + count - 1
        self._wire.tell(f"IGLOBAL({last}) = {NOT_WRITTEN}")
        if not commands.read(first, count):
            return None
        counts = self._wire.ask_whole_numbers([f"IGLOBAL({register})" for register in range(first, last + 1)])
        return None if counts[-1] == NOT_WRITTEN else counts

    def _too_few(self, commands: Commands, already: int, count: int, samples: int) -> EdgesMissing:
        came = self._counted(commands, samples)
        short = f"{came} came" if came is not None else f"points {already + 1} to {already + count} are not all there"
        return EdgesMissing(
            f"{self._name}: fewer positions captured than the {samples} armed for ({short}); "
            "check the trigger line and capture_trigger, and collect after the last edge",
            instrument=self._name,
            came=came,
            armed=samples,
        )

    def _counted(self, commands: Commands, samples: int) -> int | None:
        """How many positions there are, where that is soon found out by asking for fewer and fewer."""
        if samples > COUNTED_MAX or self._settings.capture_read != "restarts":
            return None
        return next((count for count in range(samples - 1, 0, -1) if self._read(commands, count) is not None), 0)
