"""Keyence LK-G triangulation lasers: the LK-G3001 and the LK-G5000 controllers, serial or Ethernet.

There is no command that asks who answers. Each generation measures by a command that the other does not
know (`M1`, `MS,01`), and that tells them apart.

Source: Keyence, LK-G Series User's Manual, chapter 5 (RS-232C).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np

from drivers.keyence_line import KeyenceLine, main_command
from drivers.keyence_settings import AVERAGES, Generation, KeyenceSettings
from drivers.keyence_values import parse_values
from drivers.numbers import whole
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import USUAL_BAUD, DriverDeclaration, Use
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkTimeout, WrongInstrument
from rigctl.core.interfaces import Channel, Identity, Reading

__all__ = ["KeyenceLkg", "KeyenceSettings"]

BY_TIMING_INPUT = 10
"""The storage cycle (SW,CF) that takes one value per edge of the TIMING input."""


@dataclass(frozen=True)
class _Armed:
    samples: int
    period_s: float


@dataclass(frozen=True)
class _Progress:
    running: bool
    stored: int


class KeyenceLkg:
    """A controller with its heads; implements `rigctl.core.interfaces.DisplacementMeter` for both generations."""

    def __init__(self, name: str, settings: KeyenceSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.settings = settings
        self._dialect = settings.dialect
        self._clock = clock
        self._line = KeyenceLine(name, settings, connect, clock)
        self._armed: _Armed | None = None

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
        """One displacement in mm per head, in the order of the settings."""
        return tuple(
            Channel(name, "mm", "displacement", self.settings.latency_s, self.settings.range_mm)
            for name in self.settings.heads
        )

    def longest_record(self, period_s: float) -> int:
        """Most values per head of one storage; `LimitError` when the controller samples more slowly than that."""
        # Rounding of microseconds to seconds.
        if period_s < self.settings.sampling_us * 1e-6 * (1 - 1e-9):
            raise LimitError(
                f"{self.name}: edges {period_s:g} s apart, but a value only every "
                f"{self.settings.sampling_us:g} us; lower `sampling_us` or the rate"
            )
        return self.settings.samples_max

    def arm(self, samples: int, period_s: float) -> None:
        """Set up and start a storage of one value per head and edge of the TIMING input.

        Raises `LimitError` when the controller cannot store that many, or samples more slowly than the
        edges come; `InstrumentError` when it refuses a setting (it is then measuring again).
        """
        self._check_limits(samples, period_s)
        with self._line.lock:
            # Nothing counts as armed while its settings are changed.
            self._armed = None
            self._apply(self._storage_settings(samples))
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
            raise InstrumentError(
                f"{self.name}: {progress.stored} of {armed.samples} trigger edges came, {why}; "
                "check the wire to the TIMING input and that the pacing instrument ran to its end",
                instrument=self.name,
            )
        columns: list[FloatArray] = []
        for output in self.settings.heads.values():
            if columns:  # the values' reply does not say whose they are: the status in between keeps them apart
                self._progress()
            columns.append(self._stored(output, armed))
        return np.column_stack(columns)

    def displacements(self) -> tuple[Reading, ...]:
        """The value of each head now [mm], in the order of the settings; NaN when there is none."""
        outputs = sorted(self.settings.heads.values())
        values = dict(zip(outputs, self._current(outputs), strict=True))
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

    # Recording

    def _check_limits(self, samples: int, period_s: float) -> None:
        longest = self.longest_record(period_s)
        if not 1 <= samples <= longest:
            raise LimitError(
                f"{self.name}: {samples} samples of {len(self.settings.heads)} heads; "
                f"the storage holds 1 to {longest}, record fewer"
            )

    def _storage_settings(self, samples: int) -> list[str]:
        dialect, settings = self._dialect, self.settings
        outputs = [dialect.output(output) for output in settings.heads.values()]
        average = AVERAGES.index(settings.averaging)
        commands = [f"SW,CA,{dialect.sampling_us.index(settings.sampling_us)}"]
        commands += [f"SW,OC,{output},0,{average}" for output in outputs]
        commands += [f"SW,CF,{samples:07d},{BY_TIMING_INPUT:02d}"]
        if dialect.selects_stored_outputs:
            commands += [f"SW,OK,{output},1" for output in outputs]
        return commands

    def _apply(self, commands: list[str]) -> None:
        self._mode("Q0", self._dialect)
        try:
            for command in commands:
                self._ask_when_ready(command, self._dialect)
        finally:
            # Left in communication mode it would refuse to measure.
            self._mode("R0", self._dialect)

    def _await_edges(self, armed: _Armed) -> _Progress:
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

    def _progress(self) -> _Progress:
        reply = self._line.ask("AN")
        try:
            running, *counts = (whole(field) for field in reply.decode("latin-1").split(","))
            # All outputs are stored by one trigger; while one is being written the counts may differ by one.
            return _Progress(running == 1, min(counts[output - 1] for output in self.settings.heads.values()))
        except (ValueError, IndexError) as error:
            raise self._line.bad("AN", reply, "a status and a count per output") from error

    def _stored(self, output: int, armed: _Armed) -> FloatArray:
        command = f"AO,{self._dialect.output(output)}"
        text = self._line.ask(command, self.settings.readout_timeout_s)
        # Without parity a turned bit makes another number.
        if not self._line.guarded and self._line.ask(command, self.settings.readout_timeout_s) != text:
            raise BadReply(
                f"{self.name}: {command} gave other values when read twice; bits turn on the line: "
                "set even parity on the controller and parity=E in the address, and record again",
                instrument=self.name,
            )
        values = self._values(command, text)
        if len(values) != armed.samples:
            raise BadReply(
                f"{self.name}: {command} gave {len(values)} values of {armed.samples}; "
                "check the line (baud rate, flow control) and record again",
                instrument=self.name,
            )
        return values

    # Current values

    def _current(self, outputs: list[int]) -> FloatArray:
        command = self._dialect.measure(outputs)
        reply = self._line.ask(command)
        fields = reply.split(b",")
        if len(fields) < len(outputs):
            raise self._line.bad(command, reply, f"{len(outputs)} values")
        # The LK-G5000 puts the number of the output before its value.
        return self._values(command, b",".join(fields[-len(outputs) :]))

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
        with self._already_so(dialect):
            self._line.ask(command, self.settings.mode_timeout_s)

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


_ROLES = dict.fromkeys(("displacement", "spare"), Use(KeyenceSettings, KeyenceLkg))

LKG3001 = DriverDeclaration(
    "keyence-lkg3001",
    contract=1,
    roles=_ROLES,
    simulator="simulators.keyence_lkg.declaration:LKG3001",
    implied={"generation": "lkg3001"},
    serial_baud=USUAL_BAUD,
)
LKG5000 = DriverDeclaration(
    "keyence-lkg5000",
    contract=1,
    roles=_ROLES,
    simulator="simulators.keyence_lkg.declaration:LKG5000",
    implied={"generation": "lkg5000"},
)
