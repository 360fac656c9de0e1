"""When readings are taken and how they are read: TRIGger, SAMPle, READ?, FETCh?, R?, DATA, FORMat."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.core.arrays import FloatArray
from simulators.keysight_34465a.configuration import TIMER_MAXIMUM_S, Configuration
from simulators.keysight_34465a.measurement_commands import MeasurementCommands
from simulators.keysight_34465a.meter import NOT_A_NUMBER, Meter
from simulators.keysight_34465a.stored import stored
from simulators.scpi import Boolean, Choice, Command, Integer, Number, Pending, Reply, ScpiError, setting

COUNT_MAXIMUM = 1_000_000
READING_COUNT = Integer(1, 2_000_000, 2_000_000)
TRIGGER_SOURCE = Choice(("IMMediate", "EXTernal", "BUS"))
SLOPE = Choice(("POSitive", "NEGative"))


class AcquisitionCommands:
    """From the trigger to the readings on the wire."""

    def __init__(self, meter: Meter, measurement: MeasurementCommands) -> None:
        self._meter = meter
        self._measurement = measurement
        self._timer = Number(lambda: self._setup.timer_minimum_s, TIMER_MAXIMUM_S, 1.0, unit="S")
        self._fastest_timer = Number(lambda: self._setup.interval_s, TIMER_MAXIMUM_S, 1.0, unit="S")

    def table(self) -> tuple[Command, ...]:
        """Their commands."""
        return (*self._triggering(), *self._sampling(), *self._readout(), *self._format())

    @property
    def _setup(self) -> Configuration:
        return self._meter.configuration

    def _triggering(self) -> tuple[Command, ...]:
        triggers = Integer(1, COUNT_MAXIMUM, 1, infinity=True)
        delay = Number(0.0, TIMER_MAXIMUM_S, 0.0, unit="S")
        level = Number(-1000.0, 1000.0, 0.0, unit="V")
        return (
            Command("ABORt", self._meter.abort),
            Command("INITiate[:IMMediate]", self._meter.initiate),
            Command("*TRG", self._meter.trigger),
            *setting("TRIGger:SOURce", TRIGGER_SOURCE, *stored(self._meter, "trigger_source")),
            *setting("TRIGger:COUNt", triggers, *stored(self._meter, "trigger_count")),
            *setting("TRIGger:DELay", delay, self._delay_s, stored(self._meter, "trigger_delay_s")[1]),
            *setting(
                "TRIGger:DELay:AUTO",
                Boolean(),
                lambda: self._setup.trigger_delay_s is None,
                self._set_automatic_delay,
            ),
            *setting("TRIGger:SLOPe", SLOPE, *stored(self._meter, "trigger_slope")),
            *setting("TRIGger:LEVel", level, *stored(self._meter, "trigger_level_v")),
            *setting("OUTPut:TRIGger:SLOPe", SLOPE, *stored(self._meter, "output_slope")),
        )

    def _sampling(self) -> tuple[Command, ...]:
        _, ask_timer = setting("SAMPle:TIMer", self._timer, *stored(self._meter, "timer_s"))
        return (
            *setting("SAMPle:COUNt", Integer(1, COUNT_MAXIMUM, 1), *stored(self._meter, "sample_count")),
            *setting("SAMPle:COUNt:PRETrigger", Integer(0, 0, 0), lambda: 0, lambda _: None),
            *setting("SAMPle:SOURce", Choice(("IMMediate", "TIMer")), *stored(self._meter, "sample_source")),
            Command("SAMPle:TIMer", self._set_timer, 1),
            ask_timer,
        )

    def _delay_s(self) -> float:
        return self._setup.trigger_delay_s or 0.0

    def _set_automatic_delay(self, automatic: bool) -> None:
        self._meter.change()
        self._setup.trigger_delay_s = None if automatic else self._delay_s()

    def _set_timer(self, text: str) -> None:
        """MIN is the recommended minimum; a number may go down to the absolute one. Steps of 1 us."""
        value_s = self._timer.parse(text) if text[0].isalpha() else self._fastest_timer.parse(text)
        self._meter.change()
        self._setup.timer_s = round(value_s, 6)

    def _readout(self) -> tuple[Command, ...]:
        return (
            Command("READ?", self._read),
            Command("FETCh?", self._fetch),
            Command("R?", self._take_block, 0, 1),
            Command("DATA:REMove?", self._remove, 1, 1),
            Command("DATA:POINts?", self._points),
            Command("DATA:LAST?", self._last),
            Command("MEASure[:VOLTage]:DC?", self._measuring(self._measurement.configure_voltage), 0, 2),
            Command("MEASure:TEMPerature?", self._measuring(self._measurement.configure_temperature), 0, 4),
        )

    def _format(self) -> tuple[Command, ...]:
        order = stored(self._meter, "byte_order", measurement=False)
        return (
            Command("FORMat[:DATA]", self._set_format, 1, 1),
            Command("FORMat[:DATA]?", lambda: {"ASC": "ASC", "REAL": "REAL,64"}[self._setup.data_format]),
            *setting("FORMat:BORDer", Choice(("NORMal", "SWAPped")), *order),
        )

    def _measuring(self, configure: Callable[..., None]) -> Callable[..., Reply]:
        def measure(*parameters: str) -> Reply:
            configure(*parameters)
            return self._read()

        return measure

    def _read(self) -> Pending:
        # READ? would wait for a trigger that this client can no longer send.
        if self._setup.trigger_source == "BUS":
            raise ScpiError(-214)
        self._meter.initiate()
        return self._fetch()

    def _fetch(self) -> Pending:
        if self._meter.idle and not len(self._meter.memory):
            raise ScpiError(-230)
        return Pending(lambda: self._meter.idle, self._all_readings, self._meter.idle_s)

    def _all_readings(self) -> str | bytes:
        if not len(self._meter.memory):
            raise ScpiError(-230)
        return self._formatted(self._meter.memory.all())

    def _take_block(self, limit: str = "MAX") -> bytes:
        count = READING_COUNT.parse(limit)
        self._meter.advance()
        # Taken out, as FETCh? does not: so a client empties the memory while it fills.
        readings = self._meter.memory.take(int(count))
        return block(ascii_list(readings) if self._setup.data_format == "ASC" else self._binary(readings))

    def _remove(self, number: str, wait: str = "") -> Reply:
        count = int(READING_COUNT.parse(number))
        if wait and wait.upper() != "WAIT":
            raise ScpiError(-224)
        meter = self._meter

        def there() -> bool:
            meter.advance()
            return len(meter.memory) >= count

        def remove() -> str | bytes:
            if not there():
                raise ScpiError(-222)
            return self._formatted(meter.memory.take(count))

        if not wait:
            return remove()

        def wake_s() -> float:
            # Woken when enough readings are there, or when none will come any more.
            return min(meter.stored_s(count - len(meter.memory)), meter.idle_s())

        return Pending(lambda: there() or meter.idle, remove, wake_s)

    def _points(self) -> str:
        self._meter.advance()
        return f"{len(self._meter.memory):+d}"

    def _last(self) -> str:
        self._meter.advance()
        last = self._meter.memory.last
        if last is None:
            return f"{NOT_A_NUMBER:+.8E}"
        unit = "VDC" if self._setup.function == "VOLT" else self._setup.temperature_unit
        return f"{last:+.8E} {unit}"

    def _set_format(self, kind: str, length: str = "DEF") -> None:
        chosen = Choice(("ASCii", "REAL")).parse(kind)
        if chosen == "REAL" and length not in ("DEF", "64"):
            raise ScpiError(-224)
        self._setup.data_format = chosen

    def _formatted(self, readings: FloatArray) -> str | bytes:
        if self._setup.data_format == "ASC":
            return ascii_list(readings)
        return block(self._binary(readings))

    def _binary(self, readings: FloatArray) -> bytes:
        return readings.astype(">f8" if self._setup.byte_order == "NORM" else "<f8").tobytes()


def ascii_list(readings: FloatArray) -> bytes:
    """Readings as ASCII numbers, comma between."""
    return ",".join([f"{value:+.8E}" for value in readings.tolist()]).encode()


def block(payload: bytes) -> bytes:
    """An IEEE 488.2 definite-length block."""
    length = str(len(payload))
    return f"#{len(length)}{length}".encode() + payload
