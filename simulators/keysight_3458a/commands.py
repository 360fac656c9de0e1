"""What each command does to the meter."""

from __future__ import annotations

from collections.abc import Callable

from simulators.keysight_3458a.language import Command, Error, Refused, choice, number, whole
from simulators.keysight_3458a.meter import BYTES, Meter, Setup
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings

RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
EVENTS = ("AUTO", "EXT", "SGL", "HOLD", "SYN")
"""Of TARM and TRIG; a query answers with their number, from 1."""
READINGS_MAX = 16_777_215
TEXTS = {
    Error.TRIGGER_TOO_FAST: "TRIGGER TOO FAST",
    Error.SYNTAX: "SYNTAX ERROR",
    Error.PARAMETER_UNDEFINED: "UNDEFINED PARAMETER RECEIVED",
    Error.PARAMETER_RANGE: "PARAMETER OUT OF RANGE",
    Error.MEMORY: "MEMORY ERROR",
}
IGNORED = frozenset({"END", "INBUF", "TBUFF", "NDIG", "DISP", "BEEP", "MATH", "FIXEDZ", "OFORMAT"})
"""Understood, and of no consequence here: replies are always in ASCII."""
Words = tuple[str, ...]


class Commands:
    """Carries them out, and keeps their errors."""

    def __init__(self, meter: Meter, settings: Meter3458ASimulatorSettings) -> None:
        self._meter = meter
        self._dialect = settings.dialect
        self._errors: set[Error] = set()
        self._handlers: dict[str, Callable[[Words], None]] = {
            "RESET": lambda _: meter.reset(),
            "PRESET": self._preset,
            "TARM": self._arm,
            "TRIG": lambda words: meter.change(trigger=choice(words[0], *EVENTS)),
            "NRDGS": self._readings,
            "TIMER": lambda words: meter.change(timer_s=number(words[0], 1e-5, 6000.0)),
            "DELAY": lambda words: meter.change(delay_s=max(number(words[0], -1.0, 6000.0), 0.0)),
            "DCV": self._volts,
            "APER": lambda words: meter.change(aperture_s=number(words[0], 500e-9, 1.0)),
            "AZERO": lambda words: meter.change(autozero=choice(words[0], "ON", "OFF", "ONCE") == "ON"),
            "MFORMAT": lambda words: meter.change(memory_format=choice(words[0], *BYTES)),
            "MEM": self._memory,
            "EXTOUT": self._output,
        }
        self._queries: dict[str, Callable[[], str]] = {
            "ID": lambda: settings.identity,
            "ERRSTR": self._error,
            "MCOUNT": lambda: self._whole(meter.count()),
            "TARM": lambda: self._whole(EVENTS.index(self._armed()) + 1),
            "TRIG": lambda: self._whole(EVENTS.index(meter.setup.trigger) + 1),
        }

    def execute(self, command: Command | Refused) -> str | None:
        """Its reply; errors are kept until they are asked for."""
        try:
            if isinstance(command, Refused):
                raise command
            return self._query(command) if command.query else self._do(command)
        except Refused as refused:
            self._errors.add(refused.error)
            return None

    def reading(self, value: float) -> str:
        """As ASCII output has it."""
        return f"{value:+.9E}"

    def _do(self, command: Command) -> str | None:
        if command.keyword == "RMEM":
            return self._recall(command.words)
        if command.keyword in IGNORED:
            return None
        handler = self._handlers.get(command.keyword)
        if handler is None:
            raise Refused(Error.SYNTAX)
        if not command.words and command.keyword not in ("RESET", "PRESET"):
            raise Refused(Error.PARAMETER_UNDEFINED)
        handler(command.words)
        return None

    def _query(self, command: Command) -> str:
        if command.keyword not in self._queries or command.words:
            raise Refused(Error.SYNTAX)
        return self._queries[command.keyword]()

    def _whole(self, value: int) -> str:
        return f" {value}" if self._dialect.padded_numbers else str(value)

    def _error(self) -> str:
        self._meter.advance()
        if self._meter.too_fast:
            self._meter.too_fast = False
            self._errors.add(Error.TRIGGER_TOO_FAST)
        if not self._errors:
            return '0,"NO ERROR"'
        error = min(self._errors)
        self._errors.remove(error)
        code = 1 << error if self._dialect.error_numbers == "bits" else 100 + error
        return f'{code},"{TEXTS[error]}"'

    def _armed(self) -> str:
        self._meter.advance()
        return self._meter.setup.arm

    def _preset(self, words: Words) -> None:
        choice(words[0] if words else "NORM", "NORM")
        self._meter.hold()
        self._meter.setup = Setup()

    def _arm(self, words: Words) -> None:
        event = choice(words[0], *EVENTS)
        if event == "HOLD":
            self._meter.hold()
        else:
            self._meter.arm(event)

    def _readings(self, words: Words) -> None:
        event = choice(words[1], "AUTO", "TIMER", "EXT", "SYN") if len(words) > 1 else "AUTO"
        self._meter.change(readings=whole(words[0], 1, READINGS_MAX), sample_event=event)

    def _volts(self, words: Words) -> None:
        asked_v = number(words[0], -1.0, 1050.0)
        self._meter.change(range_v=next((r for r in RANGES_V if abs(asked_v) <= r), RANGES_V[-1]))

    def _memory(self, words: Words) -> None:
        if choice(words[0], "FIFO", "OFF") == "FIFO":
            self._meter.store_anew()
        else:
            self._meter.change(memory="OFF")

    def _output(self, words: Words) -> None:
        event = choice(words[0], "OFF", "ICOMP", "RCOMP", "ONCE", "APER", "BCOMP", "SRQ")
        choice(words[1] if len(words) > 1 else "NEG", "NEG", "POS")
        self._meter.change(output=event)

    def _recall(self, words: Words) -> str:
        there = self._meter.count()
        first = whole(words[0], 1, READINGS_MAX) if words else 1
        count = whole(words[1], 1, READINGS_MAX) if len(words) > 1 else 1
        if first + count - 1 > there:
            raise Refused(Error.MEMORY)
        # Recalling stops what is being stored.
        self._meter.change(memory="OFF")
        values = self._meter.recalled(first, count)
        ordered = values if self._dialect.recall_order == "newest first" else values[::-1]
        return ",".join(map(self.reading, ordered))
