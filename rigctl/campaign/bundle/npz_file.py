"""The samples of a run as .npz: what each array is to be is read, and bounded, before any of it."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import BinaryIO, cast

import numpy as np

from rigctl.campaign.bundle.place import Place
from rigctl.campaign.bundle.unpacking import UNREADABLE, open_zip
from rigctl.campaign.recording import flaw_of_column
from rigctl.core.arrays import FloatArray
from rigctl.core.bounds import COLUMNS, RUN_VALUES, SAMPLES
from rigctl.core.numbers import MAGNITUDE_MAX, measurable

_ZIP_TIME = (1980, 1, 1, 0, 0, 0)
_MEND = "write it with numpy.savez, one array per column"


def read_npz(place: Place, file: BinaryIO) -> dict[str, FloatArray]:
    """The columns, of equal length; `DataError` for anything but arrays of real numbers in one dimension."""
    with open_zip(place, file, COLUMNS, _MEND) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        if not members:
            raise place.error(f"no arrays in it; {_MEND}")
        try:
            shapes = {_column_of(place, member): _announced(place, archive, member) for member in members}
            _require_equal(place, shapes)
            return {_column_of(place, member): _values(place, archive, member) for member in members}
        except (MemoryError, *UNREADABLE) as error:
            raise place.error(f"not readable arrays of numbers ({error or 'out of memory'}); {_MEND}") from error


def _column_of(place: Place, member: zipfile.ZipInfo) -> str:
    name = member.filename.removesuffix(".npy")
    if flaw := flaw_of_column(name):
        raise place.error(f"the name of column {name!r} {flaw}; {_MEND}")
    return name


def _announced(place: Place, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    """The number of samples, from the first bytes."""
    with archive.open(member) as opened:
        file = cast("BinaryIO", opened)
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    name = _column_of(place, member)
    if len(shape) != 1 or dtype.kind not in "fiub" or dtype.itemsize > 8:
        raise place.error(f"column {name} is {len(shape)}-dimensional {dtype}; {_MEND}")
    if not 0 <= shape[0] <= SAMPLES:
        raise place.error(f"column {name} has {shape[0]} samples, but at most {SAMPLES} are read; split the run")
    if shape[0] * dtype.itemsize > member.file_size:
        raise place.error(f"column {name} promises {shape[0]} samples and holds fewer; {_MEND}")
    return shape[0]


def _require_equal(place: Place, shapes: Mapping[str, int]) -> None:
    if sum(shapes.values()) > RUN_VALUES:
        raise place.error(
            f"{sum(shapes.values())} numbers in one run, but at most {RUN_VALUES} are read; split the run"
        )
    if len(set(shapes.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in shapes.items())
        raise place.error(f"columns differ in length ({listed}); {_MEND}")


def _values(place: Place, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> FloatArray:
    with archive.open(member) as file:
        values = np.lib.format.read_array(cast("BinaryIO", file), allow_pickle=False).astype(np.float64, copy=False)
        if file.read(1):
            raise ValueError("bytes after the last sample")
    if not measurable(values):
        at = int(np.argmax(np.abs(np.nan_to_num(values, nan=0.0)) > MAGNITUDE_MAX))
        raise place.error(
            f"sample {at + 1} of column {_column_of(place, member)} is {values[at]:g},"
            " which nobody can have measured; mend it, or write nan for a missing value"
        )
    return values


def npz_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """The columns as numpy.savez writes them, whatever they are called; the same columns give the same bytes."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, column in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, column, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_TIME), array.getvalue())
    return data.getvalue()
