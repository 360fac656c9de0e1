"""What both generations of Keyence LK-G controllers do: who answers, modes, values now, the end of a storage.

There is no command that asks who answers. Each generation measures by a command that the other does not
know (`M1`, `MS,01`), and that tells them apart.

Source: Keyence, LK-G Series User's Manual, chapter 5 (RS-232C).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np

from drivers.keyence_examined import heads_and_line
from drivers.keyence_line import KeyenceLine, main_command
from drivers.keyence_setting import Setting, confirm
from drivers.keyence_settings import AVERAGES, Generation, KeyenceSettings
from drivers.keyence_values import parse_values
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkTimeout, WrongInstrument
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Channel, Identity, Reading

READINGS = 3
"""Of a current value, where a bit could turn: the middle one is taken."""


@dataclass(frozen=True)
class Progress:
    """Whether a storage runs, and how many values it has of each output used, at least."""

    running: bool
    stored: int


class KeyenceController:
    """A controller with its heads: `rigctl.core.interfaces.DisplacementMeter` but for how it records."""

    def __init__(self, name: str, settings: KeyenceSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.settings = settings
        self._dialect = settings.dialect
        self._clock = clock
        self._line = KeyenceLine(name, settings, connect, clock)
        # False as long as its settings may be open: it then refuses to measure.
        self._measuring = True

    def open(self) -> None:
        """Connect, return the controller to measuring and check its generation.

        Raises `WrongInstrument` when the other generation or something else answers.
        """
        with self._line.lock:
            if self._line.is_open:
                return
            self._line.open()
            try:
                self.identify()
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Disconnect; the controller goes on measuring. May be called twice."""
        self._line.close()

    def examine(self) -> Iterator[Finding]:
        """Connect and look at its heads, its line and its storage; an LK-G3001 stores a few values for it."""
        self.open()
        yield from heads_and_line(self.settings, self.displacements, guarded=self._line.guarded)
        yield from self._examine()

    def _examine(self) -> Iterator[Finding]:
        """What only this generation is asked."""
        raise NotImplementedError

    def identify(self) -> Identity:
        """The generation, known by the commands it understands; no serial number nor firmware can be asked.

        Raises `WrongInstrument` when the other generation or something else answers.
        """
        with self._line.lock:
            try:
                answer = self._greet(self._dialect)
            except InstrumentError as error:
                raise self._stranger(error) from error
            return Identity(self._dialect.model, "", "", answer)

    def channels(self) -> tuple[Channel, ...]:
        """One displacement in mm per head, in the order of the settings; averaging is part of its latency."""
        settings = self.settings
        averaged_s = 0.5e-6 * (settings.averaging - 1) * settings.sampling_us
        return tuple(
            Channel(name, "mm", "displacement", settings.latency_s - averaged_s, settings.range_mm)
            for name in self.settings.heads
        )

    def displacements(self) -> tuple[Reading, ...]:
        """The value of each head now [mm], in the order of the settings; NaN when there is none.

        Of three where a bit could turn the middle one, of a target that moves as well.
        """
        outputs = sorted(self.settings.heads.values())
        with self._line.lock:
            self._return_to_measuring()
            readings = [self._current(outputs) for _ in range(1 if self._line.guarded else READINGS)]
        values = dict(zip(outputs, np.median(readings, axis=0), strict=True))
        now_s = self._clock.now_s()
        return tuple(Reading(float(values[output]), "mm", now_s) for output in self.settings.heads.values())

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._line.confirm_in_step()

    def stop(self) -> None:
        """End a storage and return when the controller says so; measuring goes on. A `collect` that waits raises."""
        with self._line.urgently():
            with self._already_so(self._dialect):
                self._line.ask("AP")
            with self._already_so(self._dialect):  # with its settings open nothing is stored
                if self._progress().running:
                    raise InstrumentError(
                        f"{self.name}: it still stores after AP; stop it on its panel", instrument=self.name
                    )
            self._return_to_measuring()

    # Recording

    def _progress(self) -> Progress:
        """How far the storage is."""
        raise NotImplementedError

    def _require_fast(self, period_s: float) -> None:
        # Rounding of microseconds to seconds.
        if period_s < self.settings.sampling_us * 1e-6 * (1 - 1e-9):
            raise LimitError(
                f"{self.name}: edges {period_s:g} s apart, but a value only every "
                f"{self.settings.sampling_us:g} us; lower `sampling_us` or the rate"
            )

    def _measuring_settings(self) -> list[Setting]:
        dialect, settings = self._dialect, self.settings
        average = str(AVERAGES.index(settings.averaging))
        return [
            Setting("CA", (str(dialect.sampling_us.index(settings.sampling_us)),)),
            *(
                Setting("OC", (dialect.output(output), "0", average), named=(1, 2))
                for output in settings.heads.values()
            ),
        ]

    def _apply(self, settings: list[Setting]) -> None:
        """Write settings and read them back: the replies to `SW` do not say what was written."""
        with self._settings_open():
            for setting in settings:
                self._write(setting)
                confirm(self._line, setting)

    @contextmanager
    def _settings_open(self) -> Iterator[None]:
        """Settings are taken in communication mode; whatever happens there, it has to end in measuring."""
        try:
            self._mode("Q0", self._dialect)
            yield
        finally:
            # Left in communication mode it would refuse to measure.
            self._return_to_measuring()

    def _return_to_measuring(self) -> None:
        """Close settings that may have been left open; where this fails, the next use does it."""
        if not self._measuring:
            self._mode("R0", self._dialect)

    def _write(self, setting: Setting) -> None:
        # Another name: a turned bit has written another setting.
        if (reply := self._ask_when_ready(setting.written, self._dialect)) != setting.name.encode():
            raise self._line.bad(setting.written, reply, f"SW,{setting.name}")

    def _stored(
        self, output: int, samples: int, only_values: Callable[[bytes], bytes] = lambda text: text
    ) -> FloatArray:
        """The stored values of an output, which `only_values` takes out of the reply; `BadReply` if not `samples`."""
        command = f"AO,{self._dialect.output(output)}"
        text = self._line.ask(command, self.settings.readout_timeout_s)
        # Without parity a turned bit makes another number.
        if not self._line.guarded and self._line.ask(command, self.settings.readout_timeout_s) != text:
            raise BadReply(
                f"{self.name}: {command} gave other values when read twice; bits turn on the line: "
                "set even parity on the controller and parity=E in the address, and record again",
                instrument=self.name,
            )
        values = self._values(command, only_values(text))
        if len(values) != samples:
            raise BadReply(
                f"{self.name}: {command} gave {len(values)} values of {samples}; "
                "check the line (baud rate, flow control) and record again",
                instrument=self.name,
            )
        return values

    # Current values

    def _current(self, outputs: list[int]) -> FloatArray:
        command = self._dialect.measure(outputs)
        reply = self._line.ask_repeated(command)
        values = self._values(command, reply)
        if len(values) != len(outputs):
            raise self._line.bad(command, reply, f"{len(outputs)} values")
        return values

    def _values(self, command: str, text: bytes) -> FloatArray:
        try:
            return parse_values(text)
        except ValueError as error:
            raise self._line.bad(command, text, "values of 8 characters") from error

    # Modes and generations

    def _greet(self, dialect: Generation) -> str:
        """Return to measuring and ask for the first output as `dialect` has it; the whole reply."""
        self._mode("R0", dialect)
        command = dialect.measure([1])
        reply = self._ask_when_ready(command, dialect)
        return f"{main_command(command)},{reply.decode('ascii', 'replace')}"

    def _stranger(self, error: InstrumentError) -> InstrumentError:
        other = self.settings.other_dialect
        # Whether the other generation answers is only to make the message better.
        with suppress(InstrumentError, LinkTimeout):
            self._greet(other)
            return WrongInstrument(
                f"{self.name}: an {other.model} answers, not an {self._dialect.model}; "
                "correct `generation` or `address` in the rig file",
                instrument=self.name,
            )
        # Its own generation's error: the right controller, which has refused.
        if error.code in self._dialect.errors:
            return error
        return WrongInstrument(
            f"{self.name}: no {self._dialect.model} answers ({error}); correct `address` in the rig file",
            instrument=self.name,
        )

    def _mode(self, command: str, dialect: Generation) -> None:
        # Without a reply it may be in either.
        self._measuring = False
        with self._already_so(dialect):
            self._line.ask(command, self.settings.mode_timeout_s)
        self._measuring = command == "R0"

    @contextmanager
    def _already_so(self, dialect: Generation) -> Iterator[None]:
        """A change to the mode that the controller is in answers with a status error, which is harmless."""
        try:
            yield
        except InstrumentError as error:
            if error.code != dialect.status_error:
                raise

    def _ask_when_ready(self, command: str, dialect: Generation) -> bytes:
        """Ask until the change of mode, which may go on after its reply, is over."""
        deadline_s = self._clock.now_s() + self.settings.mode_timeout_s
        while True:
            try:
                return self._line.ask(command)
            except InstrumentError as error:
                if error.code != dialect.status_error or self._clock.now_s() >= deadline_s:
                    raise
            # A change of mode ends on the controller's own time; its reply comes before.
            self._clock.sleep_s(self.settings.poll_s)
