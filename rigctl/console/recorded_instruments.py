"""The instruments of a rig as a campaign's store tells: identity, and the last value of each that was recorded."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from rigctl.console.readings import InstrumentView, Value
from rigctl.console.store_view import StoreView


@lru_cache(maxsize=4)
def toml_of(text: str) -> dict[str, Any]:
    """A file kept in a store, which was checked when it was put there."""
    return tomllib.loads(text)


def recorded_instruments(view: StoreView) -> list[InstrumentView]:
    """As the table of instruments shows them."""
    found = []
    state = "campaign" if view.alive else "recorded"
    for name, table in toml_of(view.rig_toml).get("instruments", {}).items():
        identity = view.identities.get(name, {})
        who = " ".join(str(identity[key]) for key in ("model", "serial", "firmware") if identity.get(key))
        values = tuple(
            Value(label, value, unit, view.sampled_s)
            for label, value, unit in _recorded(view, table)
            if math.isfinite(value)
        )
        driver, address = str(table["driver"]), str(table["address"])
        found.append(InstrumentView(name, str(table["role"]), driver, address, state, who, values, ""))
    return found


def _recorded(view: StoreView, table: Mapping[str, Any]) -> list[tuple[str, float, str]]:
    conditions = view.runs[-1].conditions if view.runs else {}
    last = {name: float(values[-1]) for name, values in view.samples.items() if len(values)}
    role = table["role"]
    if role == "rotation" and ("theta_deg" in conditions or "theta_deg" in last):
        return [("angle", float(conditions.get("theta_deg", last.get("theta_deg", math.nan))), "deg")]
    if role == "thermometer" and "temperature_c" in conditions:
        return [("temperature", float(conditions["temperature_c"]), "degC")]
    if role == "linear" and "stage_x_mm" in last:
        return [("position", last["stage_x_mm"], "mm")]
    if (channel := table.get("channel", "accel_v")) in last and role in {"readout", "voltmeter"}:
        return [("voltage", last[channel], "V")]
    return [(head, last[head], "mm") for head in table.get("heads", {}) if head in last]


def gain_of(view: StoreView) -> float:
    """V/(m/s2) of the sensor that is mounted; 1 where the rig file does not say."""
    try:
        rig, conditions = toml_of(view.rig_toml), view.runs[-1].conditions
        sensor = rig["package"]["axes"][conditions["axis"]]["sensor"][conditions["configuration"]]
        return float(sensor["gain_v_per_m_s2"])
    except (IndexError, KeyError, TypeError):
        return 1.0
