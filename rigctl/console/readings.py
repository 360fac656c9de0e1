"""Instruments as the screen shows them: what is read of each, or what a campaign's store tells."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rigctl.console.store_view import StoreView
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
        # NaN is refused too in this form.
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


# Asked ten times a second for the same two files.
@lru_cache(maxsize=4)
def toml_of(text: str) -> dict[str, Any]:
    """A file kept in a store, which was checked when it was put there."""
    import tomllib  # none is read before the first paint

    return tomllib.loads(text)


def recorded_instruments(view: StoreView) -> list[InstrumentView]:
    """As the table of instruments shows them."""
    instruments = []
    state = "campaign" if view.alive else "recorded"
    for name, table in toml_of(view.rig_toml).get("instruments", {}).items():
        identity = view.identities.get(name, {})
        identity_text = " ".join(str(identity[key]) for key in ("model", "serial", "firmware") if identity.get(key))
        values = tuple(each for each in _recorded(view, table) if math.isfinite(each.value))
        driver, address = str(table["driver"]), str(table["address"])
        instruments.append(
            InstrumentView(name, str(table["role"]), driver, address, state, identity_text, values, "")
        )
    return instruments


def _recorded(view: StoreView, table: Mapping[str, Any]) -> list[Value]:
    conditions = view.runs[-1].conditions if view.runs else {}
    last = {name: float(values[-1]) for name, values in view.samples.items() if len(values)}
    role = table["role"]

    def of_run(label: str, column: str, unit: str) -> list[Value]:
        return [Value(label, float(conditions[column]), unit, view.run_ended_s)]

    def of_samples(label: str, column: str, unit: str) -> list[Value]:
        return [Value(label, last[column], unit, view.sampled_s)]

    # A run has one angle, or, on a platform, a sample of it at every edge.
    if role == "rotation" and "theta_deg" in conditions:
        return of_run("angle", "theta_deg", "deg")
    if role == "rotation" and "theta_deg" in last:
        return of_samples("angle", "theta_deg", "deg")
    if role == "thermometer" and "temperature_c" in conditions:
        return of_run("temperature", "temperature_c", "degC")
    if role == "linear" and "stage_x_mm" in last:
        return of_samples("position", "stage_x_mm", "mm")
    if (channel := table.get("channel", "accel_v")) in last and role in {"readout", "voltmeter"}:
        return of_samples("voltage", channel, "V")
    heads = [head for head in table.get("heads", {}) if head in last]
    return [value for head in heads for value in of_samples(head.removesuffix("_mm"), head, "mm")]


def simulated_here(view: StoreView) -> bool:
    """Whether all instruments of a store's rig lived in its campaign's process, and are gone with it."""
    tables = toml_of(view.rig_toml).get("instruments", {}).values()
    return all(str(table.get("address", "")).startswith("sim:") for table in tables)


def gain_of(view: StoreView) -> float:
    """V/(m/s2) of the sensor that is mounted; 1 where the rig file does not say."""
    try:
        rig, conditions = toml_of(view.rig_toml), view.runs[-1].conditions
        sensor = rig["package"]["axes"][conditions["axis"]]["sensor"][conditions["configuration"]]
        return float(sensor["gain_v_per_m_s2"])
    except (IndexError, KeyError, TypeError):
        return 1.0
