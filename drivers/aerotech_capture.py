"""DATAACQ of an Ensemble: the encoder latched at every trigger edge, read from the controller's registers."""

from __future__ import annotations

import numpy as np

from drivers.aerotech_ascii import FAULT
from drivers.aerotech_axis import AsciiAxis
from drivers.aerotech_settings import EnsembleSettings
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError, LimitError

NOT_WRITTEN = -(1 << 31)
"""Marks a register: the lowest number it holds, farther out than any stage of this precision goes."""


class PositionCapture:
    """One record at a time, as whole counts in the controller's integer registers (IGLOBAL).

    Successive reads go on where the last ended, or begin anew (`capture_read`). Before each read the last register
    is marked, so that a controller with fewer points cannot pass old values off as new.
    """

    def __init__(self, name: str, settings: EnsembleSettings, wire: AsciiAxis, clock: Clock) -> None:
        self._name = name
        self._settings = settings
        self._wire = wire
        self._clock = clock
        self._armed = 0
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

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart."""
        s = self._settings
        capacity = self.longest_record(period_s)
        if not 1 <= samples <= capacity:
            raise LimitError(
                f"{self._name}: cannot capture {samples} positions, at most {capacity}; record for a shorter time or "
                "at a longer period, or raise the controller's GlobalIntegers (its parameter 124)"
            )
        self._wire.tell(f"DATAACQ {s.axis} INPUT {s.capture_input}")
        self._wire.tell(f"DATAACQ {s.axis} TRIGGER {s.capture_trigger}")
        self._wire.tell(f"DATAACQ {s.axis} ON {samples}")
        self._armed = samples

    def end(self) -> None:
        """Wait for no more edges."""
        if self._armed:
            # Forgotten first: a stop that comes while OFF is under way must not send it a second time.
            self._armed = 0
            # Switching it off does no harm when given twice.
            self._wire.insist(f"DATAACQ {self._settings.axis} OFF")

    def counts(self) -> FloatArray:
        """The encoder at every edge, in counts; `InstrumentError` when edges were missed."""
        samples, self._armed = self._armed, 0
        if not samples:
            raise InstrumentError(f"{self._name}: no capture is armed; arm it before the run", instrument=self._name)
        # The last edge was seen by the pacing instrument; the position of this one is latched `latency_s` later.
        if self._settings.latency_s > 0.0:
            self._clock.sleep_s(self._settings.latency_s)
        counts: list[int] = []
        while len(counts) < samples:
            counts += self._read(min(self._one_read(), samples - len(counts)), len(counts), samples)
        return np.array(counts, dtype=np.float64)

    def _one_read(self) -> int:
        """How many positions one read brings; what the settings say before the controller was asked."""
        s = self._settings
        there = s.capture_points_max if self._registers is None else self._registers - s.capture_register_first
        return max(min(there, s.capture_registers or there), 0)

    def _read(self, count: int, already: int, samples: int) -> list[int]:
        first = self._settings.capture_register_first
        last = first + count - 1
        self._wire.tell(f"IGLOBAL({last}) = {NOT_WRITTEN}")
        command = f"DATAACQ {self._settings.axis} READ {first}, {count}"
        answer = self._wire.link.tell(command)
        # `#` although the axis has no fault: the read itself cannot be done, for want of points.
        if answer.status == FAULT and not self._wire.fault_word():
            raise self._too_few(already, count, samples)
        self._wire.succeed(command, answer)
        counts = self._wire.ask_whole_numbers([f"IGLOBAL({register})" for register in range(first, last + 1)])
        if counts[-1] == NOT_WRITTEN:
            raise self._too_few(already, count, samples)
        return counts

    def _too_few(self, already: int, count: int, samples: int) -> InstrumentError:
        return InstrumentError(
            f"{self._name}: fewer positions captured than the {samples} armed for "
            f"(points {already + 1} to {already + count} are not all there); "
            "check the trigger line and capture_trigger, and collect after the last edge",
            instrument=self._name,
        )
