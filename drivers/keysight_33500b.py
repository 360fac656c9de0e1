"""Keysight (Agilent) 33500B waveform generators with two outputs, as a source of two slow voltages.

What is said and what comes back: docs/protocol-33500b.md. The generator bends what it cannot do to what it can,
tells so in its error queue, and goes on; hence the queue is read before an output is switched on, and the settings
are asked back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.keysight_33500b_examined import examined
from drivers.scpi import ScpiLink
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import InstrumentError, LimitError
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Channel, Identity
from rigctl.core.voltage_sources import Started, Waveform

MAKERS, MODELS = ("Keysight", "Agilent"), ("33510B", "33512B", "33520B", "33522B")
OUTPUTS = (1, 2)
OPEN_CIRCUIT_PEAK_V = 10.0
AMPLITUDE_MINIMUM_V = 1e-3
"""Half of the least peak-to-peak voltage into an open circuit."""
PERIOD_MINIMUM_S, PERIOD_MAXIMUM_S = 5e-6, 1e6
"""200 kHz, which a ramp has too, and 1 uHz."""
PHASE_MAXIMUM_DEG = 360.0
BURST_MAXIMUM = 100_000_000
"""Periods; as many last longer than anything that is recorded."""
ROUNDING, ROUNDING_V, ROUNDING_HZ, ROUNDING_DEG, ROUNDING_PERCENT = 1e-3, 1e-3, 1e-6, 0.1, 0.1
"""What the generator may round a setting by: relative, and in each unit on top."""
FUNCTIONS = {"constant": ("DC",), "sine": ("SIN",), "triangle": ("RAMP", "TRI")}
"""The word sent, and what else may be answered: TRI is a ramp of symmetry 50; what that is called no source tells."""


class SourceSettings(BaseModel):
    """What an operator may set: which column each output drives, and how far it may go."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    outputs: dict[str, int] = {"dm1_y_v": 1, "dm1_z_v": 2}
    limit_v: float = Field(default=5.0, gt=0.0, le=OPEN_CIRCUIT_PEAK_V)
    latency_s: float = 0.0
    link_timeout_s: float = Field(default=2.0, gt=0.0)

    @model_validator(mode="after")
    def _outputs_are_there_once(self) -> Self:
        numbers = list(self.outputs.values())
        if not numbers or not set(numbers) <= set(OUTPUTS) or len(set(numbers)) < len(numbers):
            raise ValueError("outputs must name 1, 2 or both, each once, as in { dm1_y_v = 1, dm1_z_v = 2 }")
        return self


class Keysight33500B:
    """Two outputs into high impedance (`VoltageSource`)."""

    def __init__(self, name: str, settings: SourceSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.settings = settings
        self._clock = clock
        self._link = ScpiLink(name, connect, settings.link_timeout_s)
        self._prepared = False
        self._running: Mapping[str, Waveform] = {}
        self._lasting_s = self._ends_s = math.inf
        self._bursting = False

    def open(self) -> None:
        """Connect, make sure it is a 33500B with two outputs, and clear its errors; the outputs stay as they are."""
        self._prepared = False
        self._link.open(MAKERS, MODELS)
        # Errors of other clients stand in the queue and would be taken for ours.
        self._link.configure("*CLS")

    def examine(self) -> Iterator[Finding]:
        """Connect and look at its errors, which are emptied, and its outputs, which stay as they are."""
        identity = self._link.open(MAKERS, MODELS)
        yield from examined(identity.firmware, self.settings.outputs, self._link, self._link.errors())

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._link.close()

    def identify(self) -> Identity:
        """Ask the generator who it is."""
        return self._link.identify(MAKERS, MODELS)

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._link.confirm_in_step()

    def stop(self) -> None:
        """Disconnect both outputs and return when the generator says so; what they are set to stays set."""
        with self._link.urgently():
            self._link.send(*(f"OUTP{number} OFF" for number in OUTPUTS))
            on = [number for number in OUTPUTS if self._link.query_whole(f"OUTP{number}?")]
        if on:
            raise InstrumentError(f"{self.name}: output {on[0]} is still on; pull its cable", instrument=self.name)

    def channels(self) -> tuple[Channel, ...]:
        """The outputs in the order of the rig file."""
        s = self.settings
        return tuple(Channel(name, "V", "voltage", s.latency_s, s.limit_v) for name in s.outputs)

    def start(self, waveforms: Mapping[str, Waveform], lasting_s: float = math.inf) -> Started:
        """Set every output, an unnamed one to 0 V, and begin all waveforms at once.

        For `lasting_s` sine and triangle are bursts of whole periods, which end whatever becomes of us. The first
        time after `open` the generator is reset, which takes away what somebody else has left running.
        """
        wanted = {name: waveforms.get(name, Waveform()) for name in self.settings.outputs}
        self.check(waveforms)
        if not self._prepared:
            self._link.configure("*RST", "*CLS", "UNIT:ANGL DEG")
            self._prepared, self._bursting = True, False
        for name, waveform in wanted.items():
            number = self.settings.outputs[name]
            # The load first: the generator reckons all voltages for it, and for 50 ohm they would be twice as high.
            # A constant has no burst, and what is set while one waits is told as a conflict.
            ended = (f"SOUR{number}:BURS:STAT OFF",) if self._bursting else ()
            output = f"OUTP{number}:LOAD INF", f"OUTP{number}:POL NORM"
            self._link.configure(*output, *ended, *_settings(number, waveform, lasting_s))
            # Only once its settings are taken without an error: the outputs are never on with what was not asked for.
            self._link.send(f"OUTP{number} ON")
        asked_s = self._clock.now_s()
        # Both outputs begin their period now; switched on one after the other they are some ms apart.
        self._bursting = math.isfinite(lasting_s) and any(each.shape != "constant" for each in wanted.values())
        self._link.configure("*TRG" if self._bursting else "PHAS:SYNC")
        # Half-way between question and reply, as for any reading: the error is at most half the exchange.
        start_s = 0.5 * (asked_s + self._clock.now_s())
        self._lasting_s = lasting_s
        self._running = {name: self._as_taken(name, waveform) for name, waveform in wanted.items()}
        self._ends_s = start_s + min(
            (_cycles(each, lasting_s) * each.period_s for each in self._running.values() if each.shape != "constant"),
            default=math.inf,
        )
        return Started(start_s, self._running)

    def require_running(self) -> None:
        """`InstrumentError` unless every output is on and set as `start` returned it: a power cut ends both.

        Also where a burst has come to its end.
        """
        if self._clock.now_s() >= self._ends_s:
            raise InstrumentError(
                f"{self.name}: its waveforms were to last for {self._lasting_s:g} s and are over; record sooner",
                instrument=self.name,
            )
        for name, waveform in self._running.items():
            number = self.settings.outputs[name]
            if not self._link.query_whole(f"OUTP{number}?"):
                raise InstrumentError(
                    f"{self.name}: output {number} ({name}) is off; was its power off, or did somebody stop it?",
                    instrument=self.name,
                )
            # Somebody may have set it otherwise at the panel.
            self._as_taken(name, waveform)

    def check(self, waveforms: Mapping[str, Waveform]) -> None:
        """`LimitError` for an unknown output or a waveform it cannot make. Sends nothing."""
        for name, waveform in waveforms.items():
            if name not in self.settings.outputs:
                known = ", ".join(self.settings.outputs)
                raise LimitError(f"{self.name}: there is no output '{name}'; there are {known}")
            if fault := self._fault(waveform):
                raise LimitError(f"{self.name}: {name}: {fault}")

    def _fault(self, waveform: Waveform) -> str:
        """What is wrong with a waveform; empty when it can be made."""
        # In this form NaN is refused.
        if not waveform.peak_v <= self.settings.limit_v:
            return f"{waveform.peak_v:g} V asked for, beyond the limit of {self.settings.limit_v:g} V (limit_v)"
        if waveform.shape == "constant":
            return ""
        if not PERIOD_MINIMUM_S <= waveform.period_s <= PERIOD_MAXIMUM_S:
            return (
                f"a period of {waveform.period_s:g} s; possible are {PERIOD_MINIMUM_S:g} s to {PERIOD_MAXIMUM_S:g} s"
            )
        if not waveform.amplitude_v >= AMPLITUDE_MINIMUM_V:
            return (
                f"an amplitude of {waveform.amplitude_v:g} V; at least {AMPLITUDE_MINIMUM_V:g} V, "
                "and a phase of 180 deg where it should be negative"
            )
        if not abs(waveform.phase_deg) <= PHASE_MAXIMUM_DEG:
            return f"a phase of {waveform.phase_deg:g} deg; possible are -360 to 360 deg"
        return ""

    def _as_taken(self, name: str, waveform: Waveform) -> Waveform:
        """The waveform with the numbers that the generator gives back."""
        number = self.settings.outputs[name]
        source = f"SOUR{number}"
        self._require_taken(f"{source}:FUNC?", *FUNCTIONS[waveform.shape])
        self._require_taken(f"OUTP{number}:POL?", "NORM")
        if waveform.shape == "constant":
            return Waveform("constant", self._taken(f"{source}:VOLT:OFFS?", waveform.offset_v, ROUNDING_V))
        if waveform.shape == "triangle":
            self._taken(f"{source}:FUNC:RAMP:SYMM?", 50.0, ROUNDING_PERCENT)
        # Steps of 1 uHz: 60 min becomes 59.95 min, and what is recorded must be what was made.
        frequency_hz = self._taken(f"{source}:FREQ?", 1.0 / waveform.period_s, ROUNDING_HZ)
        if not frequency_hz > 0.0:
            raise self._link.bad_reply(f"{source}:FREQ?", f"{frequency_hz:g}", "a frequency")
        # The generator counts peak to peak, procedures in amplitudes.
        amplitude_v = 0.5 * self._taken(f"{source}:VOLT?", 2.0 * waveform.amplitude_v, ROUNDING_V)
        offset_v = self._taken(f"{source}:VOLT:OFFS?", waveform.offset_v, ROUNDING_V)
        phase = "BURS:PHAS?" if math.isfinite(self._lasting_s) else "PHAS?"
        phase_deg = self._taken(f"{source}:{phase}", waveform.phase_deg, ROUNDING_DEG)
        return Waveform(waveform.shape, offset_v, amplitude_v, 1.0 / frequency_hz, phase_deg)

    def _require_taken(self, query: str, *words: str) -> None:
        if (reply := self._link.query(query)) not in words:
            raise self._link.bad_reply(query, reply, f"{' or '.join(words)}, as it was set without an error")

    def _taken(self, query: str, asked: float, rounding: float) -> float:
        """What the generator made of a setting: no more than rounding it, as its error queue is empty."""
        value = self._link.query_number(query)
        if abs(value - asked) > rounding + ROUNDING * abs(asked):
            raise self._link.bad_reply(query, f"{value:g}", f"about {asked:g}, as it was set without an error")
        return value


def _cycles(waveform: Waveform, lasting_s: float) -> float:
    """Whole periods that last so long at least."""
    return min(math.ceil(lasting_s / waveform.period_s), BURST_MAXIMUM) if math.isfinite(lasting_s) else math.inf


def _settings(number: int, waveform: Waveform, lasting_s: float) -> tuple[str, ...]:
    """In the generator's order: limits depend on the function, and an old offset may leave no room for what comes."""
    source = f"SOUR{number}"
    function = f"{source}:FUNC {FUNCTIONS[waveform.shape][0]}"
    offset = f"{source}:VOLT:OFFS {waveform.offset_v:.6f}"
    if waveform.shape == "constant":
        return function, offset
    begins = f"{waveform.phase_deg:.6f}"
    end = (
        (
            f"{source}:PHAS 0",
            f"{source}:BURS:MODE TRIG",
            f"{source}:BURS:NCYC {_cycles(waveform, lasting_s):.0f}",
            f"{source}:BURS:PHAS {begins}",
            f"TRIG{number}:SOUR BUS",
            f"{source}:BURS:STAT ON",
        )
        if math.isfinite(lasting_s)
        else (f"{source}:PHAS {begins}",)
    )
    symmetry = (f"{source}:FUNC:RAMP:SYMM 50",) if waveform.shape == "triangle" else ()
    return (
        f"{source}:VOLT:OFFS 0",
        function,
        f"{source}:FREQ {1.0 / waveform.period_s:.9E}",
        *symmetry,
        f"{source}:VOLT:UNIT VPP",
        f"{source}:VOLT {2.0 * waveform.amplitude_v:.6f}",
        offset,
        *end,
    )


DRIVER = DriverDeclaration(
    "keysight-33500b",
    contract=1,
    roles=dict.fromkeys(("source", "spare"), Use(SourceSettings, Keysight33500B)),
    simulator="simulators.keysight_33500b.declaration:SIMULATOR",
    port=5025,
)
