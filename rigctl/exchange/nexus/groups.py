"""Groups, fields and names as NeXus has them, on h5py."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

import h5py
import numpy as np

_TEXT = h5py.string_dtype()
_INTEGERS = range(-(2**63), 2**63)
_NOT_IN_NAMES = re.compile(r"[^a-zA-Z0-9_]|^(?=[0-9]|$)")

ERRORS = "_errors"
"""Behind the name of a field: its standard uncertainties, of the same shape."""

ROW = "row"
"""The axis of columns that have no times."""


def group(parent: h5py.Group, name: str, kind: str) -> h5py.Group:
    """A new group of a NeXus class."""
    made = parent.create_group(name, track_order=True)
    made.attrs["NX_class"] = kind
    return made


def field(parent: h5py.Group, name: str, value: Any, unit: str = "") -> h5py.Dataset | None:
    """A new field, with its unit; None, and no field, where the value is None.

    Texts, numbers and arrays of either are written as they are, all else as JSON.
    """
    if value is None:
        return None
    made = parent.create_dataset(name, data=_storable(value))
    if unit:
        made.attrs["units"] = unit
    return made


def _storable(value: Any) -> Any:
    if isinstance(value, str):
        return np.array(text(value), dtype=_TEXT)
    # NeXus has no booleans in HDF5 but whole numbers.
    if isinstance(value, bool | np.bool_):
        return np.int8(value)
    if isinstance(value, int) and value in _INTEGERS:
        return np.int64(value)
    if isinstance(value, float):
        return value
    if isinstance(value, np.ndarray):
        return value.astype(np.int8) if value.dtype == bool else value
    if isinstance(value, list) and all(each is None or isinstance(each, str) for each in value):
        return np.array([text(each or "") for each in value], dtype=_TEXT)
    if isinstance(value, list) and all(isinstance(each, int | float) for each in value):
        return np.array(value, dtype=float)
    return _storable(json.dumps(value))


def text(value: str) -> str:
    """A text as HDF5 can hold it: without zero bytes, at which it would end, and in UTF-8."""
    return value.replace("\0", "␀").encode("utf-8", "replace").decode()


def note(parent: h5py.Group, name: str, content: str, kind: str, description: str) -> None:
    """An NXnote: a file of text with its MIME type and SHA-256."""
    made = group(parent, name, "NXnote")
    field(made, "type", kind)
    field(made, "description", description)
    content = text(content)
    field(made, "data", content)
    field(made, "checksum", hashlib.sha256(content.encode()).hexdigest())
    field(made, "algorithm", "SHA-256")


def plot(data: h5py.Group, axis: str | None, signal: str) -> None:
    """Say that columns of one length are to be plotted along the field `axis`, the number of the row without one."""
    if axis is None:
        axis = ROW
        data.create_dataset(ROW, data=np.arange(1, len(data[signal]) + 1)).attrs["long_name"] = ROW
    data.attrs["axes"], data.attrs[f"{axis}_indices"], data.attrs["signal"] = [axis], 0, signal
    # A dimension scale too: what knows netCDF and not NeXus, such as xarray, takes the axis for a coordinate.
    scale = data[axis]
    scale.make_scale(axis)
    for dataset in data.values():
        if dataset != scale:
            dataset.dims[0].attach_scale(scale)


class Names:
    """Names as every reader of NeXus takes them: letters of ASCII, digits not in front, _; each given once.

    NeXus allows dots too; nexusformat does not.
    """

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def of(self, name: str) -> str:
        """A name that is free, with that of its uncertainties, and as much like `name` as can be."""
        plain = _NOT_IN_NAMES.sub("_", name)
        number, free = 1, plain
        while not self._taken.isdisjoint({free, free + ERRORS}):
            number += 1
            free = f"{plain}_{number}"
        self._taken |= {free, free + ERRORS}
        return free


def named_fields(parent: h5py.Group, values: Mapping[str, Any], units: Mapping[str, str]) -> None:
    """A field for each value, called as NeXus allows; `long_name` is the name it really has where that differs."""
    names = Names(parent.keys())
    for name, value in values.items():
        called = names.of(name)
        made = field(parent, called, value, units.get(name, ""))
        if made is not None and called != name:
            made.attrs["long_name"] = text(name)
