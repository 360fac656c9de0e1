"""The LK-G3001: it stores by its own clock, and says by its replies in which form it wants to be asked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drivers.keyence_controller import KeyenceController, Progress
from drivers.keyence_examined import own_clock
from drivers.keyence_storage import CYCLES, FORMS, MANUAL, Status, StorageForm, status_of, values_of
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import InstrumentError, LimitError, WrongInstrument
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Channel, OwnClockRecord

LEAD_S = 5.0
"""How long before the first edge it may start [s of the wall clock], while the other instruments are set up."""

_TRIED = 100
"""Values of a storage that is made to see what it stores."""

LOOKS = 4, 40
"""Looks at a storage's status that bound the time of its first value, at least and at most."""

_REFUSALS = ("00", "20", "21", "22")
"""Errors that say that a command is not written like that: command, length, parameter count, parameter."""


@dataclass(frozen=True)
class _Begun:
    samples: int
    """Values that the rig's edges last for."""
    cycle_s: float
    start_s: float = math.nan
    start_u_s: float = math.nan


class Lkg3001(KeyenceController):
    """A controller that records on its own clock: a `rigctl.core.interfaces.FreeRecorder` besides."""

    _form: StorageForm | None = None
    _status_by_output = True
    _begun: _Begun | None = None

    def open(self) -> None:
        """As of every controller; then find out how it wants its storage set up, by storing a few values.

        Raises `WrongInstrument` where it accepts none of the forms.
        """
        with self._line.lock:
            if self._line.is_open:
                return
            super().open()
            try:
                if self._form is None:
                    self._form = self._accepted_form()
            except BaseException:
                self.close()
                raise

    def _examine(self) -> Iterator[Finding]:
        period_s = 0.01
        longest_s = self.longest_record(period_s) * period_s
        settings = self._known_form().settings(self._outputs, self.settings.samples_max, 0)
        storage = " and ".join(setting.written for setting in settings)
        yield from own_clock(storage, self.settings.samples_max, longest_s, self.settings.start_u_s)

    def channels(self) -> tuple[Channel, ...]:
        """As of every controller, on a clock of its own."""
        return tuple(replace(channel, clock_u_s=self.settings.start_u_s) for channel in super().channels())

    def longest_record(self, period_s: float) -> int:
        """Edges that one storage lasts for; `LimitError` when the controller samples more slowly than they come."""
        self._require_fast(period_s)
        _, cycle_s = self._cycle(period_s)
        return int((self.settings.samples_max * cycle_s - LEAD_S) / period_s)

    def prepare(self, samples: int, period_s: float) -> None:
        """Set up a storage of all heads that lasts for `samples` edges `period_s` apart and a little longer.

        Raises `LimitError` when the controller cannot store that many, or samples more slowly than that;
        `InstrumentError` when it refuses a setting, `BadReply` when one is read back as another (it is then measuring
        again).
        """
        longest = self.longest_record(period_s)
        if not 1 <= samples <= longest:
            raise LimitError(
                f"{self.name}: {samples} samples {period_s:g} s apart; the storage lasts for 1 to {longest}, "
                "record fewer"
            )
        cycle, cycle_s = self._cycle(period_s)
        needed = math.ceil(samples * period_s / cycle_s)
        with self._line.lock:
            self._begun = None
            form = self._known_form()
            # Too many cost nothing: it is ended, and read, when the edges have come.
            fast = self._clock.speed if math.isfinite(self._clock.speed) else 1.0
            count = min(needed + math.ceil(max(fast, 1.0) * LEAD_S / cycle_s), self.settings.samples_max)
            self._apply([*self._measuring_settings(), *form.settings(self._outputs, count, cycle)])
            # Old values must not be read as new ones.
            self._ask_when_ready("AQ", self._dialect)
            self._begun = _Begun(needed, cycle_s)

    def begin(self) -> None:
        """Start the storage, and see when it has begun.

        Raises `InstrumentError` when nothing was prepared, no value is stored, or the line is too slow to see when.
        """
        with self._line.lock:
            begun = self._require_begun()
            self._line.ask("AS")
            low_s, high_s = self._first_value(begun.cycle_s)
            # Where the counts contradict each other they come in blocks: it is as uncertain as they are.
            width_s = abs(high_s - low_s) + (begun.cycle_s if high_s < low_s else 0.0)
            # Uniform between the bounds.
            start_u_s = width_s / math.sqrt(12.0)
            if start_u_s > self.settings.start_u_s:
                self.stop()
                raise InstrumentError(
                    f"{self.name}: the time of its first value is known to {1e3 * start_u_s:.3g} ms only, "
                    f"{1e3 * self.settings.start_u_s:g} ms are wanted; use a faster line, or raise start_u_s",
                    instrument=self.name,
                )
            self._begun = _Begun(begun.samples, begun.cycle_s, 0.5 * (low_s + high_s), start_u_s)

    def finish(self) -> OwnClockRecord:
        """End the storage and read its values: rows in mm, NaN without a value.

        Raises `InstrumentError` when it was stopped before the edges' time was over.
        """
        with self._line.lock:
            begun = self._require_begun()
            self._begun = None
            self.stop()
            columns = [self._read_out(output) for output in self.settings.heads.values()]
            stored = min(map(len, columns))
            if stored < begun.samples:
                raise InstrumentError(
                    f"{self.name}: {stored} of {begun.samples} values were stored, then the storage was stopped; "
                    "is somebody at its panel?",
                    instrument=self.name,
                )
            values = np.column_stack([column[:stored] for column in columns])
            return OwnClockRecord(begun.start_s, begun.start_u_s, begun.cycle_s, values)

    # Status and values, in whichever form

    @property
    def _outputs(self) -> frozenset[int]:
        return frozenset(self.settings.heads.values())

    def _progress(self) -> Progress:
        found = [self._status(output) for output in self.settings.heads.values()]
        return Progress(any(each.running for each in found), min(each.stored for each in found))

    def _status(self, output: int) -> Status:
        reply = self._status_reply(output)
        try:
            return status_of(output, reply, by_output=self._status_by_output)
        except ValueError as error:
            raise self._line.bad("AN", reply, "a status and a count per output") from error

    def _status_reply(self, output: int) -> bytes:
        if self._status_by_output:
            try:
                return self._line.ask(f"AN,{output}")
            except InstrumentError as error:
                if error.code not in _REFUSALS:
                    raise
            reply = self._line.ask("AN")
            self._status_by_output = False
            return reply
        return self._line.ask("AN")

    def _read_out(self, output: int) -> FloatArray:
        # The values' reply need not say whose they are: the status in between keeps those of two outputs apart.
        return self._stored(output, self._status(output).stored, lambda text: values_of(output, text))

    # When it began

    def _first_value(self, cycle_s: float) -> tuple[float, float]:
        """Bounds of the rig time of the first value: each count was true at some time between question and answer."""
        low_s, high_s, looks = -math.inf, math.inf, 0
        deadline_s = self._clock.now_s() + self.settings.link_timeout_s
        while not self._is_bounded(low_s, high_s, looks):
            asked_s = self._clock.now_s()
            stored = self._status(min(self._outputs)).stored
            answered_s = self._clock.now_s()
            low_s = max(low_s, asked_s - stored * cycle_s)
            if stored:
                high_s = min(high_s, answered_s - (stored - 1) * cycle_s)
                looks += 1
            elif asked_s > deadline_s:
                raise InstrumentError(
                    f"{self.name}: no value was stored in {self.settings.link_timeout_s:g} s after AS; see {MANUAL}",
                    instrument=self.name,
                )
            # At other parts of a cycle every time: the bounds close in.
            self._clock.sleep_s((1.0 + 1.0 / LOOKS[0]) * cycle_s)
        return low_s, high_s

    def _is_bounded(self, low_s: float, high_s: float, looks: int) -> bool:
        wanted_s = self.settings.start_u_s * math.sqrt(12.0)
        return looks >= LOOKS[0] and (high_s - low_s <= wanted_s or looks >= LOOKS[1])

    def _require_begun(self) -> _Begun:
        if self._begun is None:
            raise InstrumentError(f"{self.name}: nothing prepared; call prepare first", instrument=self.name)
        return self._begun

    def _cycle(self, period_s: float) -> tuple[int, float]:
        """The number and the length [s] of the slowest storage cycle that is not slower than the edges."""
        sampling_s = 1e-6 * self.settings.sampling_us
        number = max(n for n, cycles in enumerate(CYCLES) if cycles * sampling_s <= period_s * (1 + 1e-9))
        return number, CYCLES[number] * sampling_s

    # The form of its storage

    def _known_form(self) -> StorageForm:
        if self._form is None:
            self._form = self._accepted_form()
        return self._form

    def _accepted_form(self) -> StorageForm:
        """The first form in which the controller stores what it is asked to."""
        left = list(FORMS)
        while left:
            form = self._first_not_refused(left)
            if form is None:
                break
            if self._stores_the_outputs():
                return form
            # The number of another target: only forms with other numbers are worth trying.
            wrong = form.targets[self._outputs]
            left = [each for each in left if each.targets[self._outputs] != wrong]
        raise WrongInstrument(
            f"{self.name}: it stores nothing of the outputs in `heads` in any of the forms known; has each of them a "
            f"head? See {MANUAL}, and mend FORMS in drivers/keyence_storage.py",
            instrument=self.name,
        )

    def _first_not_refused(self, forms: list[StorageForm]) -> StorageForm | None:
        with self._settings_open():
            for form in forms:
                try:
                    # Not read back: what is stored tells.
                    for setting in form.settings(self._outputs, _TRIED, 0):
                        self._write(setting)
                except InstrumentError as error:
                    if error.code not in _REFUSALS:
                        raise
                else:
                    return form
            return None

    def _stores_the_outputs(self) -> bool:
        """True when a storage set up just now counts values of all outputs used."""
        self._ask_when_ready("AQ", self._dialect)
        self._line.ask("AS")
        deadline_s, filled = self._clock.now_s() + self.settings.link_timeout_s, False
        try:
            while True:
                # An output may have been asked before it stored anything: what is asked from now on tells for good.
                last = filled or self._clock.now_s() > deadline_s
                try:
                    stored = [self._status(output).stored for output in sorted(self._outputs)]
                except InstrumentError as error:
                    if error.code not in _REFUSALS:
                        raise
                    return False
                if all(stored):
                    return True
                if last:
                    return False
                filled = max(stored) >= _TRIED
                self._clock.sleep_s(self.settings.poll_s)
        finally:
            self.stop()
