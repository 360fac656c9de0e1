"""What each command does to the meter, and what a query answers.

Every command has a query, which is answered by numbers (User's Guide, Additional Query Commands), in the form that a
real meter has in the log of a public program: NRDGS? `1, 1`, APER? `200.000000E-03`, FUNC? `1, .1`.
"""

from __future__ import annotations

from collections.abc import Callable

from simulators.keysight_3458a.language import Command, Error, Refused, choice, coded, number, real, whole
from simulators.keysight_3458a.meter import RANGES_V, Meter, Setup
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings

EVENTS = {"AUTO": 1, "EXT": 2, "SGL": 3, "HOLD": 4, "SYN": 5}
"""Of TARM and TRIG."""
SAMPLE_EVENTS = {"AUTO": 1, "EXT": 2, "SYN": 5, "TIMER": 6}
FORMATS = {"ASCII": 1, "SINT": 2, "DINT": 3, "SREAL": 4, "DREAL": 5}
MEMORY = {"OFF": 0, "FIFO": 2}
AUTOMATIC = {"OFF": 0, "ON": 1, "ONCE": 2}
SWITCH = {"OFF": 0, "ON": 1}
KEPT = {"END": {**SWITCH, "ALWAYS": 2}, "INBUF": SWITCH, "FIXEDZ": SWITCH, "TBUFF": SWITCH}
"""Of no consequence here but that they are answered; off after switching on."""
LINE_HZ = 50.0
READINGS_MAX = 16_777_215
TEXTS = {
    Error.TRIGGER_TOO_FAST: "TRIGGER TOO FAST",
    Error.SYNTAX: "SYNTAX ERROR",
    Error.PARAMETER_UNDEFINED: "UNDEFINED PARAMETER RECEIVED",
    Error.PARAMETER_RANGE: "PARAMETER OUT OF RANGE",
    Error.MEMORY: "MEMORY ERROR",
}
IGNORED = frozenset({"NDIG", "DISP", "BEEP", "MATH", "OFORMAT", "LFREQ"})
"""Understood, and of no consequence here: replies are always in ASCII."""
Words = tuple[str, ...]


class Commands:
    """Carries them out, and keeps their errors."""

    def __init__(self, meter: Meter, settings: Meter3458ASimulatorSettings) -> None:
        self._meter = meter
        self._dialect = settings.dialect
        self._errors: set[Error] = set()
        self._kept = dict.fromkeys(KEPT, 0)
        self._handlers: dict[str, Callable[[Words], None]] = {
            "RESET": self._reset,
            "PRESET": self._preset,
            "TARM": self._arm,
            "TRIG": self._trigger,
            "NRDGS": self._readings,
            "TIMER": lambda words: meter.change(timer_s=number(words[0], 1e-5, 6000.0)),
            "DELAY": lambda words: meter.change(delay_s=max(number(words[0], -1.0, 6000.0), 0.0)),
            "DCV": self._volts,
            "RANGE": self._volts,
            "FUNC": self._function,
            "ARANGE": lambda words: meter.change(autorange=coded(words[0], AUTOMATIC) == "ON"),
            "APER": lambda words: meter.change(aperture_s=number(words[0], 500e-9, 1.0)),
            "NPLC": lambda words: meter.change(aperture_s=max(number(words[0], 0.0, 1000.0) / LINE_HZ, 500e-9)),
            "AZERO": lambda words: meter.change(autozero=coded(words[0], AUTOMATIC) == "ON"),
            "MFORMAT": lambda words: meter.change(memory_format=coded(words[0], FORMATS)),
            "MEM": self._memory,
            "EXTOUT": self._output,
        }
        self._queries: dict[str, Callable[[], str]] = {
            "ID": lambda: settings.identity,
            "ERRSTR": self._error,
            "MCOUNT": lambda: self._whole(meter.count()),
            "TARM": lambda: self._whole(EVENTS[self._armed()]),
            "TRIG": lambda: self._whole(EVENTS[meter.setup.trigger]),
            "NRDGS": lambda: f"{self._whole(meter.setup.readings)}, {SAMPLE_EVENTS[meter.setup.sample_event]}",
            "TIMER": lambda: real(meter.setup.timer_s),
            "DELAY": lambda: real(meter.setup.delay_s),
            "APER": lambda: real(meter.setup.aperture_s),
            "NPLC": lambda: real(meter.setup.aperture_s * LINE_HZ),
            "FUNC": lambda: f"{self._whole(1)}, {self._range()}",
            "RANGE": self._range,
            "ARANGE": lambda: self._whole(meter.setup.autorange),
            "AZERO": lambda: self._whole(meter.setup.autozero),
            "MEM": lambda: self._whole(MEMORY[meter.setup.memory]),
            "MFORMAT": lambda: self._whole(FORMATS[meter.setup.memory_format]),
            "OFORMAT": lambda: self._whole(FORMATS["ASCII"]),
            "ISCALE": lambda: real(1.0),
            "TEMP": lambda: "37.0",
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
        if command.keyword in KEPT:
            self._keep(command)
            return None
        handler = self._handlers.get(command.keyword)
        if handler is None:
            raise Refused(Error.SYNTAX)
        if not command.words and command.keyword not in ("RESET", "PRESET", "DCV"):
            raise Refused(Error.PARAMETER_UNDEFINED)
        handler(command.words)
        return None

    def _query(self, command: Command) -> str:
        if command.words:
            raise Refused(Error.SYNTAX)
        if command.keyword in KEPT:
            return self._whole(self._kept[command.keyword])
        if command.keyword not in self._queries:
            raise Refused(Error.SYNTAX)
        return self._queries[command.keyword]()

    def _keep(self, command: Command) -> None:
        codes = KEPT[command.keyword]
        # Without its parameter the last of them: END ALWAYS, INBUF ON.
        self._kept[command.keyword] = codes[coded(command.words[0], codes)] if command.words else max(codes.values())

    def _range(self) -> str:
        # Without the zero before the point.
        return f"{self._meter.setup.range_v:g}".removeprefix("0")

    def _whole(self, value: int) -> str:
        return f" {value:d}" if self._dialect.padded_numbers else f"{value:d}"

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

    def _reset(self, _: Words) -> None:
        self._meter.reset()
        self._kept = dict.fromkeys(KEPT, 0)

    def _trigger(self, words: Words) -> None:
        event = coded(words[0], EVENTS)
        if event == "SGL":
            self._meter.trigger_once()
        else:
            self._meter.change(trigger=event)

    def _preset(self, words: Words) -> None:
        coded(words[0] if words else "NORM", {"NORM": 1})
        self._meter.hold()
        self._meter.setup = Setup()

    def _arm(self, words: Words) -> None:
        event = coded(words[0], EVENTS)
        if event == "HOLD":
            self._meter.hold()
        else:
            self._meter.arm(event)

    def _readings(self, words: Words) -> None:
        event = coded(words[1], SAMPLE_EVENTS) if len(words) > 1 else "AUTO"
        self._meter.change(readings=whole(words[0], 1, READINGS_MAX), sample_event=event)

    def _volts(self, words: Words) -> None:
        if not words or words[0] in ("AUTO", "-1"):
            self._meter.change(autorange=True)
            return
        asked_v = number(words[0], -1.0, 1050.0)
        range_v = next((r for r in RANGES_V if abs(asked_v) <= r), RANGES_V[-1])
        self._meter.change(range_v=range_v, autorange=False)

    def _function(self, words: Words) -> None:
        coded(words[0], {"DCV": 1})
        self._volts(words[1:])

    def _memory(self, words: Words) -> None:
        if coded(words[0], MEMORY) == "FIFO":
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
