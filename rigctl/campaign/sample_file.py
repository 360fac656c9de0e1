"""The samples of one run as a file: .csv, .csv.gz or .npz in, .csv or .npz out; 64-bit floats bit for bit."""

from __future__ import annotations

import csv
import gzip
import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.campaign.bundle_files import BundleFiles, Place
from rigctl.campaign.csv_table import check_header, check_width, decode, rows_with_lines
from rigctl.campaign.recording import flaw_of_column
from rigctl.core.numbers import MAGNITUDE_MAX, NotMeasurable, decimal_or_missing, measurable
from rigctl.errors import DataError
from rigctl.interfaces import FloatArray

SUFFIXES = (".csv", ".csv.gz", ".npz")
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class SampleFile:
    """The columns of a run, each of shape (samples,), and where they were read."""

    place: Place
    columns: Mapping[str, FloatArray]
    text: str | None

    def line_of(self, sample: int) -> int | None:
        """The line of the file that holds `sample`; None where there are no lines."""
        if self.text is None:
            return None
        for index, (line, _) in enumerate(rows_with_lines(self.place, self.text)):
            if index == sample + 1:
                return line
        return None

    def where(self, sample: int) -> str:
        """The same in words."""
        line = self.line_of(sample)
        return f"sample {sample + 1}" if line is None else f"line {line}"

    def error(self, message: str, sample: int) -> DataError:
        """A `DataError` about one sample; `message` says what is wrong and the mend."""
        return DataError(f"{self.place.file}, {self.where(sample)}: {message}")


def read_sample_file(files: BundleFiles, run_id: str, row: int) -> SampleFile:
    """The samples of a run; `row` is its line in runs.csv.

    `DataError` when there is no file or more than one, or it holds anything but columns of numbers of equal length.
    """
    found = [name for suffix in SUFFIXES if (name := f"runs/{run_id}{suffix}") in files.names]
    runs = files.place("runs.csv")
    if not found:
        raise runs.error(f"runs/{run_id}.csv is missing; add it, or remove run {run_id}", row)
    if len(found) > 1:
        raise runs.error(f"run {run_id} has both {' and '.join(found)}; remove all but one", row)
    (name,) = found
    place, data = files.place(name), files.read(name)
    if name.endswith(".npz"):
        return SampleFile(place, _read_npz(place, data), None)
    if name.endswith(".gz"):
        data = _unzipped(place, data)
    text = decode(place, data)
    return SampleFile(place, _read_csv(place, text), text)


def _unzipped(place: Place, data: bytes) -> bytes:
    try:
        return gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise place.error(f"not a readable gzip file ({error}); compress it again") from error


def _read_csv(place: Place, text: str) -> dict[str, FloatArray]:
    line, header = next(rows_with_lines(place, text), (1, None))
    if header is None:
        raise place.error("empty; write the column names in the first line", line)
    check_header(place, line, header)
    values = _fast(text, line, len(header))
    if values is None:
        values = _careful(place, text, header)
    return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(header)}


def _fast(text: str, header_line: int, width: int) -> FloatArray | None:
    """All numbers at once; None where a field is missing or wrong, which `_careful` sorts out."""
    body = "".join(text.split("\n", header_line)[header_line:])
    if not body.strip():
        return np.empty((0, width))
    try:
        values = np.loadtxt(io.StringIO(body), dtype=np.float64, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape[1] == width and measurable(values) else None


def _careful(place: Place, text: str, header: list[str]) -> FloatArray:
    rows = rows_with_lines(place, text)
    next(rows)
    values: list[list[float]] = []
    for line, fields in rows:
        check_width(place, line, fields, header)
        try:
            values.append([decimal_or_missing(field) for field in fields])
        except ValueError:
            raise _text_among_numbers(place, line, fields, header) from None
    return np.array(values, dtype=np.float64).reshape(-1, len(header))


def _text_among_numbers(place: Place, line: int, fields: list[str], header: list[str]) -> Exception:
    for name, field in zip(header, fields, strict=True):
        try:
            decimal_or_missing(field)
        except NotMeasurable:
            return place.error(
                f"column {name} holds {field}, which nobody can have measured; mend it, or leave a missing value empty",
                line,
            )
        except ValueError:
            return place.error(
                f"column {name} holds {field!r}, not a number; leave a missing value empty or write nan", line
            )
    raise AssertionError(fields)


def _read_npz(place: Place, data: bytes) -> dict[str, FloatArray]:
    mend = "write it with numpy.savez, one array per column"
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise place.error(f"not readable arrays of numbers ({error}); {mend}") from error
    if not arrays:
        raise place.error(f"no arrays in it; {mend}")
    for name, array in arrays.items():
        if flaw := flaw_of_column(name):
            raise place.error(f"the name of column {name!r} {flaw}; {mend}")
        if array.ndim != 1 or array.dtype.kind not in "fiub":
            raise place.error(f"column {name} is {array.ndim}-dimensional {array.dtype}; {mend}")
    for name, array in arrays.items():
        if not measurable(array):
            at = int(np.argmax(~(np.abs(array) <= MAGNITUDE_MAX) & ~np.isnan(array)))
            raise place.error(
                f"sample {at + 1} of column {name} is {array[at]:g}, which nobody can have measured;"
                " mend it, or write nan for a missing value"
            )
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise place.error(f"columns differ in length ({listed}); {mend}")
    return {name: array.astype(np.float64) for name, array in arrays.items()}


def csv_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """The columns, of equal length, as CSV whose numbers read back bit for bit; NaN is `nan`."""
    header = io.StringIO()
    csv.writer(header, lineterminator="").writerow(columns)
    fields = [map(float.__repr__, column.tolist()) for column in columns.values()]
    lines = [header.getvalue(), *map(",".join, zip(*fields, strict=True)), ""]
    return "\n".join(lines).encode()


def npz_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """The columns as numpy.savez writes them, whatever they are called; the same columns give the same bytes."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, column in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, column, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_TIME), array.getvalue())
    return data.getvalue()
