"""The LK-G5000: it stores one value per edge of its TIMING input."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.keyence_controller import KeyenceController, Progress
from drivers.keyence_examined import timing_input
from drivers.keyence_setting import Setting
from drivers.numbers import whole
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import EdgesMissing, InstrumentError, LimitError
from rigctl.core.findings import Finding

BY_TIMING_INPUT = 10
"""The storage cycle (SW,CF) that takes one value per edge of the TIMING input."""


@dataclass(frozen=True)
class _Armed:
    samples: int
    period_s: float


class Lkg5000(KeyenceController):
    """A controller that records on the rig's trigger edges: a `rigctl.core.interfaces.PacedRecorder` besides."""

    _armed: _Armed | None = None

    def _examine(self) -> Iterator[Finding]:
        yield from timing_input(self.settings)

    def longest_record(self, period_s: float) -> int:
        """Most values per head of one storage; `LimitError` when the controller samples more slowly than that."""
        self._require_fast(period_s)
        pulse_s = self.settings.timing_pulse_s
        # Between two pulses the input has to be seen to be off, for as long as on.
        if pulse_s is not None and 2.0 * pulse_s > period_s * (1 + 1e-9):
            raise LimitError(
                f"{self.name}: edges {period_s:g} s apart, but pulses of {pulse_s:g} s at its TIMING input "
                "(`timing_pulse_s`); lower the rate, or shorten the stretcher's pulse"
            )
        return self.settings.samples_max

    def arm(self, samples: int, period_s: float) -> None:
        """Set up and start a storage of one value per head and edge of the TIMING input.

        Raises `LimitError` when the controller cannot store that many, or samples more slowly than the
        edges come; `InstrumentError` when it refuses a setting, `BadReply` when one is read back as another (it is
        then measuring again).
        """
        longest = self.longest_record(period_s)
        if not 1 <= samples <= longest:
            raise LimitError(
                f"{self.name}: {samples} samples of {len(self.settings.heads)} heads; "
                f"the storage holds 1 to {longest}, record fewer"
            )
        outputs = [self._dialect.output(output) for output in self.settings.heads.values()]
        with self._line.lock:
            # Nothing counts as armed while its settings are changed.
            self._armed = None
            self._apply(
                [
                    *self._measuring_settings(),
                    Setting("CF", (f"{samples:07d}", f"{BY_TIMING_INPUT:02d}")),
                    *(Setting("OK", (output, "1"), named=(1,)) for output in outputs),
                ]
            )
            # AQ empties the storage, AS starts it: old values must not be read as new ones.
            self._ask_when_ready("AQ", self._dialect)
            self._line.ask("AS")
            self._armed = _Armed(samples, period_s)

    def collect(self) -> FloatArray:
        """Wait for the last edge and read the stored values: shape (samples, heads), mm, NaN without a value.

        Raises `InstrumentError` when no edge has come for a while, or the storage was stopped, before all
        edges were stored.
        """
        armed = self._armed
        if armed is None:
            raise InstrumentError(f"{self.name}: nothing to collect; call arm first", instrument=self.name)
        progress = self._await_edges(armed)
        if progress.running:
            # Edges did not come: left running, it would store edges of the next run.
            self.stop()
        if progress.stored < armed.samples:
            why = "then no more came" if progress.running else "then the storage was stopped"
            short = self.settings.timing_pulse_s is None and not progress.stored
            mend = (
                "a multimeter's pulse of 2 us is too short for the TIMING input: put a stretcher between, and its "
                "pulse into `timing_pulse_s`"
                if short
                else "check the wire to the TIMING input and that the pacing instrument ran to its end"
            )
            raise EdgesMissing(
                f"{self.name}: {progress.stored} of {armed.samples} trigger edges came, {why}; {mend}",
                instrument=self.name,
                came=progress.stored,
                armed=armed.samples,
            )
        columns: list[FloatArray] = []
        for output in self.settings.heads.values():
            if columns:  # the values' reply does not say whose they are: the status in between keeps them apart
                self._progress()
            columns.append(self._stored(output, armed.samples))
        return np.column_stack(columns)

    def edges_seen(self) -> int:
        """How many values of every output are stored."""
        return self._progress().stored

    def _await_edges(self, armed: _Armed) -> Progress:
        # Two periods on top: slow edges are no missing ones.
        patience_s = self.settings.edge_timeout_s + 2 * armed.period_s
        progress = self._progress()
        last_edge_s = self._clock.now_s()
        while progress.running and progress.stored < armed.samples:
            if self._clock.now_s() - last_edge_s > patience_s:
                break
            missing_s = (armed.samples - progress.stored) * armed.period_s
            # As long as the missing edges take at least, but no longer than ten polls, so that a stop is soon seen.
            self._clock.sleep_s(min(max(missing_s, self.settings.poll_s), 10 * self.settings.poll_s))
            before, progress = progress, self._progress()
            if progress.stored > before.stored:
                last_edge_s = self._clock.now_s()
        return progress

    def _progress(self) -> Progress:
        reply = self._line.ask("AN")
        try:
            running, *counts = (whole(field) for field in reply.decode("latin-1").split(","))
            # All outputs are stored by one trigger; while one is being written the counts may differ by one.
            return Progress(running == 1, min(counts[output - 1] for output in self.settings.heads.values()))
        except (ValueError, IndexError) as error:
            raise self._line.bad("AN", reply, "a status and a count per output") from error
