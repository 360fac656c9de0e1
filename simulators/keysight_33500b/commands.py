"""The generator's commands: per output SOURce<n> and OUTPut<n>, and those of the whole instrument."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from simulators.keysight_33500b import resting
from simulators.keysight_33500b.output import (
    AMPLITUDE_MINIMUM_VPP,
    FREQUENCY_MINIMUM_HZ,
    PEAK_V,
    Output,
)
from simulators.keysight_33500b.panel import panel_commands
from simulators.keysight_33500b.settings import GeneratorSettings
from simulators.scpi import Boolean, Choice, Command, Number, ScpiError

FUNCTION = Choice(("SINusoid", "RAMP", "TRIangle", "DC"))
PHASE = Number(-360.0, 360.0, 0.0, unit="DEG")
CYCLES = Number(1.0, 1e8, 1.0)
POLARITY = Choice(("NORMal", "INVerted"))
TRIGGER = Choice(("IMMediate", "EXTernal", "TIMer", "BUS"))
PERCENT = Number(0.0, 100.0, 100.0)
LOAD = Number(1.0, 10e3, 50.0, unit="OHM")


class Commands:
    """Sets outputs by number; a number out of range, which is clipped, is told in the queue afterwards."""

    def __init__(self, outputs: Mapping[int, Output], settings: GeneratorSettings) -> None:
        self._outputs = outputs
        self._settings = settings

    def table(self) -> tuple[Command, ...]:
        """Their commands."""
        return (
            Command("*IDN?", lambda: self._settings.identity),
            Command("*RST", self._reset),
            Command("*TST?", lambda: "+0"),
            Command("UNIT:ANGLe", lambda text: _only("DEGree", text), 1),
            Command("UNIT:ANGLe?", lambda: "DEG"),
            Command("[SOURce<n>:]PHASe:SYNChronize", self._synchronise),
            *self._shape(),
            *self._levels(),
            *self._connector(),
            *self._bursts(),
            *panel_commands(),
            *resting.commands(self._output),
        )

    def _shape(self) -> tuple[Command, ...]:
        return (
            *self._pair(
                "[SOURce<n>:]FUNCtion",
                lambda output: output.course.function,
                lambda output, text: output.set_function(FUNCTION.parse(text)),
            ),
            *self._number(
                "[SOURce<n>:]FUNCtion:RAMP:SYMMetry",
                lambda _: PERCENT,
                lambda output: 100.0 * output.course.symmetry,
                lambda output, per_cent: output.change(symmetry=0.01 * per_cent),
            ),
            *self._number(
                "[SOURce<n>:]FREQuency",
                lambda output: Number(FREQUENCY_MINIMUM_HZ, output.frequency_maximum_hz(), 1e3, unit="HZ"),
                lambda output: output.course.frequency_hz,
                Output.set_frequency,
            ),
            *self._number(
                "[SOURce<n>:]PHASe[:ADJust]",
                lambda _: PHASE,
                lambda output: output.course.phase_deg,
                lambda output, phase_deg: output.change(phase_deg=phase_deg),
            ),
        )

    def _levels(self) -> tuple[Command, ...]:
        return (
            *self._number(
                "[SOURce<n>:]VOLTage",
                lambda output: Number(
                    output.scale * AMPLITUDE_MINIMUM_VPP, output.scale * 2.0 * PEAK_V, output.scale * 0.2, unit="VPP"
                ),
                lambda output: output.scale * output.course.amplitude_vpp,
                lambda output, amplitude_vpp: output.set_amplitude(amplitude_vpp / output.scale),
            ),
            *self._number(
                "[SOURce<n>:]VOLTage:OFFSet",
                _offsets,
                lambda output: output.scale * output.course.offset_v,
                lambda output, offset_v: output.change(offset_v=offset_v / output.scale),
            ),
            *self._number(
                "[SOURce<n>:]VOLTage:HIGH",
                lambda output: Number(
                    output.scale * (output.course.levels_v[0] + AMPLITUDE_MINIMUM_VPP),
                    output.scale * PEAK_V,
                    output.scale * 0.1,
                    unit="V",
                ),
                lambda output: output.scale * output.course.levels_v[1],
                lambda output, high_v: output.set_levels(output.course.levels_v[0], high_v / output.scale),
            ),
            *self._number(
                "[SOURce<n>:]VOLTage:LOW",
                lambda output: Number(
                    -output.scale * PEAK_V,
                    output.scale * (output.course.levels_v[1] - AMPLITUDE_MINIMUM_VPP),
                    -output.scale * 0.1,
                    unit="V",
                ),
                lambda output: output.scale * output.course.levels_v[0],
                lambda output, low_v: output.set_levels(low_v / output.scale, output.course.levels_v[1]),
            ),
            *self._pair("[SOURce<n>:]VOLTage:UNIT", lambda _: "VPP", lambda _, text: _only("VPP", text)),
        )

    def _connector(self) -> tuple[Command, ...]:
        return (
            *self._pair(
                "OUTPut<n>[:STATe]",
                lambda output: str(int(output.course.on)),
                lambda output, text: output.change(on=Boolean().parse(text)),
            ),
            *self._pair("OUTPut<n>:LOAD", _load, _set_load),
            *self._pair(
                "OUTPut<n>:POLarity",
                lambda output: "INV" if output.course.inverted else "NORM",
                lambda output, text: output.change(inverted=POLARITY.parse(text) == "INV"),
            ),
        )

    def _bursts(self) -> tuple[Command, ...]:
        return (
            Command("*TRG", self._fire),
            *self._pair(
                "TRIGger<n>:SOURce",
                lambda output: output.course.trigger,
                lambda output, text: output.change(trigger=_simulated(TRIGGER.parse(text))),
            ),
            *self._pair(
                "[SOURce<n>:]BURSt:STATe",
                lambda output: str(int(output.course.burst)),
                lambda output, text: output.set_burst(Boolean().parse(text)),
            ),
            *self._number(
                "[SOURce<n>:]BURSt:NCYCles",
                lambda _: CYCLES,
                lambda output: output.course.burst_cycles,
                lambda output, cycles: output.change(burst_cycles=float(round(cycles))),
            ),
            *self._number(
                "[SOURce<n>:]BURSt:PHASe",
                lambda _: PHASE,
                lambda output: output.course.burst_phase_deg,
                lambda output, phase_deg: output.change(burst_phase_deg=phase_deg),
            ),
        )

    def _pair(
        self, header: str, get: Callable[[Output], str], put: Callable[[Output, str], None]
    ) -> tuple[Command, Command]:
        return (
            Command(header, lambda number, text: put(self._output(number), text), 1),
            Command(header + "?", lambda number: get(self._output(number))),
        )

    def _number(
        self,
        header: str,
        kind: Callable[[Output], Number],
        get: Callable[[Output], float],
        put: Callable[[Output, float], None],
    ) -> tuple[Command, Command]:
        def set_clipped(number: int, text: str) -> None:
            output = self._output(number)
            value, limit = kind(output).clip(text)
            put(output, value)
            # Set first and told afterwards: the generator bends a setting and goes on.
            if limit:
                raise ScpiError(-222, f"value clipped to {limit} limit")

        def query(number: int, *which: str) -> str:
            output = self._output(number)
            return _sent(kind(output).limit(which[0]) if which else get(output))

        return Command(header, set_clipped, 1), Command(header + "?", query, 0, 1)

    def _output(self, number: int) -> Output:
        if number not in self._outputs:
            raise ScpiError(-114)
        return self._outputs[number]

    def _fire(self) -> None:
        if not any(output.course.burst for output in self._outputs.values()):
            raise ScpiError(-211)
        for output in self._outputs.values():
            output.fire()

    def _reset(self) -> None:
        for output in self._outputs.values():
            output.reset()

    # Both outputs, whichever the header names: their phases are to be those that were set.
    def _synchronise(self, _: int) -> None:
        for output in self._outputs.values():
            output.synchronise()


def _offsets(output: Output) -> Number:
    largest_v = output.scale * output.offset_maximum_v()
    return Number(-largest_v, largest_v, 0.0, unit="V")


def _load(output: Output) -> str:
    # SCPI's number for infinity.
    return _sent(output.load_ohm if math.isfinite(output.load_ohm) else 9.9e37)


def _set_load(output: Output, text: str) -> None:
    output.load_ohm = math.inf if text.upper() in ("INF", "INFINITY") else LOAD.parse(text)


def _simulated(trigger: str) -> str:
    if trigger not in ("IMM", "BUS"):
        raise ScpiError(-221, "not simulated")
    return trigger


def _only(word: str, text: str) -> None:
    """-224 for every other word."""
    Choice((word,)).parse(text)


def _sent(value: float) -> str:
    return f"{value:+.14E}"
