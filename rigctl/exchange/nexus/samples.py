"""The samples of a run as NXdata, block by block."""

from __future__ import annotations

import hashlib
from itertools import chain

import h5py

from rigctl.campaign.store.store import Store
from rigctl.exchange.nexus.groups import ERRORS, ROW, Names, group, plot, text
from rigctl.exchange.streams import BLOCK, Stream, blocks, noise_of, unit_of


def write_stream(entry: h5py.Group, name: str, store: Store, run_id: str, stream: Stream) -> bool:
    """Make an NXdata group `name` of the columns of a stream; whether there is anything to plot in it.

    Each column has the SHA-256 of its 64-bit floats, little-endian, and HDF5's own Fletcher-32 in every chunk.
    `DamagedStore`, and no such group, where they are not as they were written.
    """
    samples = blocks(store, run_id, stream)
    first = next(samples, None)
    data = group(entry, name, "NXdata")
    names = Names([ROW])
    fields = {column: names.of(column) for column in stream.columns}
    sums = {column: hashlib.sha256() for column in stream.columns}
    made: dict[str, h5py.Dataset] = {}
    for block in chain([first] if first else [], samples):
        for column, values in block.items():
            little = values.astype("<f8", copy=False)
            sums[column].update(little.data)
            if column in made:
                length = len(made[column])
                made[column].resize((length + len(little),))
                made[column][length:] = little
            else:
                # The first block is the longest.
                made[column] = data.create_dataset(
                    fields[column], data=little, maxshape=(None,), chunks=(len(little),), fletcher32=True
                )
    for column, dataset in made.items():
        dataset.attrs["long_name"] = text(column)
        dataset.attrs["sha256"] = sums[column].hexdigest()
        if unit := unit_of(store.header.channels, column):
            dataset.attrs["units"] = text(unit)
        _errors(data, dataset, fields[column], noise_of(store.header.channels, column))
    if made:
        plot(data, fields[stream.time] if stream.time else None, fields[_signal(store, stream)])
    return bool(made)


def _errors(data: h5py.Group, dataset: h5py.Dataset, name: str, noise: float | None) -> None:
    """The standard uncertainty of every sample: one number, as the fill value of chunks that are never written."""
    if noise is None:
        return
    made = data.create_dataset(
        name + ERRORS, shape=dataset.shape, dtype="<f8", chunks=(min(BLOCK, len(dataset)),), fillvalue=noise
    )
    made.attrs["long_name"] = f"standard uncertainty of {dataset.attrs['long_name']}"
    if "units" in dataset.attrs:
        made.attrs["units"] = dataset.attrs["units"]


def _signal(store: Store, stream: Stream) -> str:
    """The column to be plotted: what is calibrated, else the first channel that is described, else any but time."""
    columns = [name for name in stream.columns if name != stream.time] or list(stream.columns)
    described = [name for name in store.header.channels if name in columns]
    calibrated = [name for name in described if store.header.channels[name].kind == "accelerometer"]
    return next(iter((*calibrated, *described, *columns)))
