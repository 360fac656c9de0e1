"""What holds for a whole campaign, as an NXentry: how it was set up, with what, and what came of it."""

from __future__ import annotations

import importlib.metadata
from dataclasses import asdict
from typing import Any

import h5py
import numpy as np

from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.item import item_of
from rigctl.campaign.recording import ChannelInfo
from rigctl.campaign.status import status_in
from rigctl.campaign.store.entries import RUN_ENDED
from rigctl.campaign.store.header_json import dumps, header_to_json
from rigctl.campaign.store.store import Store
from rigctl.core.units import unit_of_column
from rigctl.exchange.nexus.groups import ERRORS, ROW, Names, field, group, named_fields, note, plot, text
from rigctl.exchange.store_table import StoreTable

TOML, JSON, JSON_LINES = "application/toml", "application/json", "application/x-ndjson"

_FABRICATION = {"manufacturer": "vendor", "model": "model", "serial": "serial_number"}
"""Fields of NXfabrication by what is said of an item."""


def write_campaign(entry: h5py.Group, store: Store, table: StoreTable, result: MeasurementResult | None) -> None:
    """Fill the NXentry of a store; its plot is that of the table."""
    header = store.header
    field(entry, "title", header.title or store.path.name)
    field(entry, "experiment_identifier", store.path.name)
    field(entry, "experiment_description", header.experiment)
    field(entry, "start_time", header.started or None)
    ended = store.last_event(RUN_ENDED)
    field(entry, "end_time", ended.time if ended else None)
    program = field(entry, "program_name", "rigctl")
    assert program is not None
    program.attrs["version"] = header.versions.get("rigctl", "")
    _configuration(group(entry, "configuration", "NXcollection"), store)
    _instrument(group(entry, "instrument", "NXinstrument"), store)
    _sample(group(entry, "sample", "NXsample"), store)
    lines = "".join(f"{dumps(asdict(event))}\n" for event in store.events())
    note(entry, "events", lines, JSON_LINES, "what happened, marks of runs among it: a JSON object a line")
    if result is not None:
        _result(group(entry, "result", "NXprocess"), result)
    _table(entry, table)


def _configuration(configuration: h5py.Group, store: Store) -> None:
    header = store.header
    for name, content in (("rig", header.rig_toml), ("campaign", header.campaign_toml)):
        if content is not None:
            note(configuration, name, content, TOML, f"the {name} file as run, without its simulated world")
    note(configuration, "header", header_to_json(header), JSON, "all that the store says of itself")
    note(configuration, "status", dumps(status_in(store)), JSON, "how the campaign stood")
    constants = group(configuration, "constants", "NXparameters")
    named_fields(constants, header.constants, {name: unit_of_column(name) for name in header.constants})


def _instrument(instrument: h5py.Group, store: Store) -> None:
    field(instrument, "name", "rig of " + (store.header.title or store.path.name))
    names = Names(instrument.keys())
    for name, identity in store.identities().items():
        made = group(instrument, names.of(name), "NXfabrication")
        field(made, "model", str(identity.get("model", "")))
        field(made, "serial_number", str(identity.get("serial", "")))
        field(made, "identifier_firmware", str(identity.get("firmware", "")))
        field(made, "identifier_answer", str(identity.get("text", "")))
    for name, channel in store.header.channels.items():
        made = group(instrument, names.of(name), "NXsensor")
        field(made, "name", name)
        field(made, "type", channel.kind or None)
        _specification(group(made, "specification", "NXcollection"), channel)


def _specification(specification: h5py.Group, channel: ChannelInfo) -> None:
    units = dict.fromkeys(("noise_rms", "full_scale"), channel.unit) | dict.fromkeys(("latency_s", "clock_u_s"), "s")
    known = {name: each for name, each in asdict(channel).items() if each not in (None, "", {})}
    named_fields(specification, known, units)


def _sample(sample: h5py.Group, store: Store) -> None:
    """The item that was calibrated."""
    said = item_of(store).stated
    field(sample, "name", said.get("name") or "unnamed item")
    field(sample, "description", said.get("condition"))
    field(sample, "identifier_serial", said.get("serial"))
    if not said.keys().isdisjoint(_FABRICATION):
        made = group(sample, "fabrication", "NXfabrication")
        for key, name in _FABRICATION.items():
            field(made, name, said.get(key))


def _table(entry: h5py.Group, table: StoreTable) -> None:
    """The table of a store as NXdata along the number of its rows, the entry's plot where there is any number."""
    data = group(entry, "table", "NXdata")
    names, numbers = Names([ROW]), []
    for column in table.columns:
        name, unit = names.of(column.name), text(column.unit)
        if len(column.values) == 0:
            continue
        _named(data, name, column.values, unit, column.name)
        if column.u is not None:
            _named(data, name + ERRORS, column.u, unit, f"standard uncertainty of {column.name}")
        if isinstance(column.values, np.ndarray) and column.values.dtype == float:
            numbers.append((column.u is not None, name))
    if numbers:
        # What was measured before what was set.
        plot(data, None, next((name for has_u, name in numbers if has_u), numbers[0][1]))
        entry.attrs["default"] = "table"


def _named(parent: h5py.Group, name: str, value: Any, unit: str, long_name: str) -> None:
    made = field(parent, name, value, unit)
    assert made is not None
    made.attrs["long_name"] = text(long_name)


def _result(process: h5py.Group, result: MeasurementResult) -> None:
    field(process, "program", "rigctl")
    field(process, "version", importlib.metadata.version("rigctl"))
    quantities = group(process, "quantities", "NXparameters")
    names = Names()
    for each, u in zip(result.quantities, result.standard_uncertainty, strict=True):
        name = names.of(each.name)
        _named(quantities, name, each.value, text(each.unit), each.name)
        _named(quantities, name + ERRORS, float(u), text(each.unit), f"standard uncertainty of {each.name}")
        quantities[name].attrs["error"] = float(u)
    uncertainty = group(process, "uncertainty", "NXcollection")
    field(uncertainty, "method", result.method)
    field(uncertainty, "remarks", list(result.remarks) or None)
    field(uncertainty, "quantities", [each.name for each in result.quantities])
    field(uncertainty, "units", [each.unit for each in result.quantities])
    field(uncertainty, "covariance", result.covariance)
    field(uncertainty, "effective_dof", result.effective_dof)
    field(uncertainty, "coverage_factor_95", result.coverage_factor)
