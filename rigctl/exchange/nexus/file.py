"""A store as a file of HDF5 by the conventions of NeXus, for programs that know these and nothing of this one.

/                     NXroot; its plot is that of the first valid run
/campaign             NXentry of the whole: title, times, and
    configuration     rig and campaign file, header, status, constants
    instrument        who answered, and an NXsensor for each channel
    sample            the item that was calibrated
    events            what happened, marks of runs among it
    table             NXdata: the store's table, what was measured with its uncertainties
    result            NXprocess: quantities with their uncertainties, covariance
/run_RUN_ID           NXentry of a run: times, and
    data              NXdata: the samples along t_s
    data_CHANNEL      the same of a channel that has a clock of its own
    settings          its conditions
    record            key, step, state, whether it is valid and why not
    instrument, sample    those of the campaign

No application definition of NeXus is of such measurements, so that no entry has a `definition`.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import h5py

from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.bundle.whole_hdf5 import Check, whole_hdf5
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.session.requests import is_running
from rigctl.campaign.session.rig_time import began_at
from rigctl.campaign.store.entries import RUN_ENDED
from rigctl.campaign.store.store import Store
from rigctl.core.clock import utc_now
from rigctl.core.errors import DamagedStore
from rigctl.core.units import unit_of_column
from rigctl.exchange.nexus.campaign import write_campaign
from rigctl.exchange.nexus.groups import Names, field, group, named_fields
from rigctl.exchange.nexus.samples import write_stream
from rigctl.exchange.store_table import StoreTable
from rigctl.exchange.streams import streams_of

CAMPAIGN = "campaign"
RECORD = ("key", "step", "state", "valid", "reason")


def write_nexus(store: Store, table: StoreTable, result: MeasurementResult | None, path: Path) -> None:
    """Write a store, with its table and, where there is one, its result, to a new file.

    `DataError` as `whole_hdf5`, `DamagedStore` for a run that is not as it was written.
    """
    with whole_hdf5(path) as (file, check):
        _root(file, path)
        write_campaign(group(file, CAMPAIGN, "NXentry"), store, table, result)
        _runs(file, store, check)


def _root(file: h5py.File, path: Path) -> None:
    file.attrs["NX_class"] = "NXroot"
    file.attrs["file_name"] = path.name
    file.attrs["file_time"] = utc_now()
    file.attrs["creator"] = "rigctl"
    file.attrs["creator_version"] = importlib.metadata.version("rigctl")
    file.attrs["HDF5_Version"] = h5py.version.hdf5_version
    file.attrs["h5py_version"] = h5py.version.version
    file.attrs["default"] = CAMPAIGN


def _runs(file: h5py.File, store: Store, check: Check) -> None:
    ends = {event.data["key"]: event for event in store.events(RUN_ENDED)}
    names, default = Names(file.keys()), ""
    for run in (*store.runs(), *_cut_off(store)):
        check()
        entry = group(file, names.of(f"run_{run.run_id}"), "NXentry")
        field(entry, "title", f"run {run.run_id} of {store.header.title or store.path.name}")
        field(entry, "entry_identifier", run.run_id)
        end = ends.get(run.key) if run.state == "finished" else None
        if end is not None:
            began = began_at(end, run.conditions.get("start_s"))
            field(entry, "start_time", began.isoformat(timespec="milliseconds") if began else None)
            field(entry, "end_time", end.time)
        conditions = run.conditions
        units = {name: unit_of_column(name) for name in conditions}
        named_fields(group(entry, "settings", "NXparameters"), conditions, units)
        record = group(entry, "record", "NXcollection")
        named_fields(record, {name: each for name, each in asdict(run).items() if name in RECORD}, {})
        for part in ("instrument", "sample"):
            entry[part] = h5py.SoftLink(f"/{CAMPAIGN}/{part}")
        try:
            plotted = _samples(entry, store, run)
        except DamagedStore as error:
            # The mend of damaged samples is to mark their run invalid: that has to help here too.
            if run.valid:
                raise
            field(record, "samples_left_out", str(error))
            continue
        if plotted and run.valid and not default:
            default = file.attrs["default"] = entry.name.removeprefix("/")


def _samples(entry: h5py.Group, store: Store, run: RunRecord) -> bool:
    """Write the samples of a run; whether there are any to plot."""
    names = Names(entry.keys())
    for stream in streams_of(store, run.run_id):
        name = names.of(f"data_{stream.channel}" if stream.channel else "data")
        if write_stream(entry, name, store, run.run_id, stream) and "default" not in entry.attrs:
            entry.attrs["default"] = name
    return "default" in entry.attrs


def _cut_off(store: Store) -> Iterable[RunRecord]:
    """Runs that were never finished; not the one that a campaign is at."""
    running = is_running(store.path)
    return (run for run in store.interrupted_runs() if run.state != "acquiring" or not running)
