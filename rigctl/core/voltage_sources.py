"""Sources of slow voltages, and the waveforms they give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.interfaces import Channel, Instrument


@dataclass(frozen=True)
class Waveform:
    """A voltage in time: `offset_v` + `amplitude_v` times a shape that runs from -1 to 1.

    Sine and triangle begin at `phase_deg` of their period: at 0 they pass the offset upwards, at 90 they are at the
    top.
    """

    shape: Literal["constant", "sine", "triangle"] = "constant"
    offset_v: float = 0.0
    amplitude_v: float = 0.0
    """Half of peak to peak."""
    period_s: float = math.inf
    phase_deg: float = 0.0

    @property
    def peak_v(self) -> float:
        """The largest magnitude it reaches."""
        return abs(self.offset_v) + abs(self.amplitude_v)

    def volts(self, elapsed_s: FloatArray) -> FloatArray:
        """The voltage at times since its start, same shape."""
        if self.shape == "constant":
            return np.full_like(elapsed_s, self.offset_v)
        turns = elapsed_s / self.period_s + self.phase_deg / 360.0
        if self.shape == "sine":
            return self.offset_v + self.amplitude_v * np.sin(2.0 * np.pi * turns)
        # A quarter of a period on, so that phase 0 passes the offset upwards as a sine does.
        return self.offset_v + self.amplitude_v * (1.0 - 4.0 * np.abs((turns + 0.25) % 1.0 - 0.5))


@dataclass(frozen=True)
class Started:
    """Waveforms as the instrument took them, by channel, and the rig time at which all of them began."""

    start_s: float
    waveforms: Mapping[str, Waveform]


@runtime_checkable
class VoltageSource(Instrument, Protocol):
    """Slow voltages on several outputs. `stop` disconnects them all."""

    def channels(self) -> tuple[Channel, ...]:
        """The outputs, as columns of a run; `full_scale` is the largest voltage that may be asked for."""

    def start(self, waveforms: Mapping[str, Waveform], lasting_s: float = math.inf) -> Started:
        """Set and connect every output and begin all waveforms at once; returns when they run.

        Sine and triangle end by themselves after whole periods that last for `lasting_s` at least, and stay where
        they began: nobody has to be there to stop them. A constant has no end. An output that is not named gives 0 V.
        May be called again at any time. `LimitError` for an unknown output or
        a waveform it cannot make, before a byte is sent; what the instrument rounded is in what is returned.
        """

    def require_running(self) -> None:
        """`InstrumentError` unless every output is connected, set as `start` returned it, and not at its end."""
