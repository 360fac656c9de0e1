"""Instruments as the screen shows them, and what is read of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rigctl.core.interfaces import (
    DisplacementMeter,
    Instrument,
    LinearStage,
    Reading,
    RotationStage,
    Thermometer,
    Voltmeter,
)
from rigctl.core.numbers import decimal


@dataclass(frozen=True)
class Value:
    """A reading as shown: `taken_s` on this computer's monotonic clock."""

    label: str
    value: float
    unit: str
    taken_s: float


@dataclass(frozen=True)
class Limits:
    """Where a stage may go."""

    low: float
    high: float
    unit: str
    speed: float

    def refusal(self, value: float) -> str:
        """Why a stage is not sent to `value`; empty when it may go there."""
        if self.low <= value <= self.high:
            return ""
        return f"{value:g} {self.unit} is outside {self.low:g} .. {self.high:g} {self.unit}"

    def refusal_of(self, text: str) -> str:
        """The same of a position as it was typed."""
        try:
            return self.refusal(decimal(text.strip()))
        except ValueError:
            return f"'{text}' is not a number; write {self.unit}, such as {self.high / 2:g}"

    def __str__(self) -> str:
        return f"{self.low:g} .. {self.high:g} {self.unit}, up to {self.speed:g} {self.unit}/s"


@dataclass(frozen=True)
class InstrumentView:
    """An instrument at one moment; `state` is connecting, ready, moving, homing, stopped, silent or lost."""

    name: str
    role: str
    driver: str
    address: str
    state: str
    identity: str
    values: tuple[Value, ...]
    error: str
    limits: Limits | None = None


@dataclass(frozen=True)
class Strip:
    """The last values of one quantity; times are seconds before now, so at most 0."""

    name: str
    ago_s: Any
    values: Any


def limits_of(instrument: Instrument) -> Limits | None:
    """Of a stage; None for what cannot be moved."""
    if isinstance(instrument, RotationStage):
        turn = instrument.limits
        return Limits(turn.angle_min_deg, turn.angle_max_deg, "deg", turn.speed_deg_s)
    if isinstance(instrument, LinearStage):
        travel = instrument.limits
        return Limits(travel.position_min_mm, travel.position_max_mm, "mm", travel.speed_mm_s)
    return None


def readings_of(instrument: Instrument) -> Iterator[tuple[str, Reading]]:
    """What an instrument reads now, by label."""
    if isinstance(instrument, RotationStage):
        yield "angle", instrument.angle()
    elif isinstance(instrument, LinearStage):
        yield "position", instrument.position()
    elif isinstance(instrument, DisplacementMeter):
        names = [channel.name for channel in instrument.channels()]
        yield from zip(names, instrument.displacements(), strict=True)
    elif isinstance(instrument, Thermometer):
        yield "temperature", instrument.temperature()
    elif isinstance(instrument, Voltmeter):
        yield "voltage", instrument.voltage()
