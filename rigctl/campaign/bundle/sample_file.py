"""The samples of one run as a file: .csv, .csv.gz or .npz in, .csv or .npz out; 64-bit floats bit for bit.

What each array of an .npz is to be is read, and bounded, before any of it.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import BinaryIO, cast

import numpy as np

from rigctl.campaign.bundle.csv_table import check_header, check_width, decode, not_measurable, rows_with_lines
from rigctl.campaign.bundle.files import BundleFiles
from rigctl.campaign.bundle.place import Place
from rigctl.campaign.bundle.unpacking import UNREADABLE, gunzipped, open_zip
from rigctl.campaign.recording import flaw_of_column
from rigctl.core.arrays import FloatArray
from rigctl.core.bounds import COLUMNS, NPZ_BYTES, RUN_TEXT_BYTES, RUN_VALUES, SAMPLES
from rigctl.core.errors import DataError
from rigctl.core.numbers import MAGNITUDE_MAX, NotMeasurable, decimal_or_missing, measurable

# The earliest time a .zip can say. Always the same one, so that equal runs give equal files.
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)
_MEND = "write it with numpy.savez, one array per column"


def read_npz(place: Place, file: BinaryIO) -> dict[str, FloatArray]:
    """The columns, of equal length; `DataError` for anything but arrays of real numbers in one dimension."""
    with open_zip(place, file, COLUMNS, _MEND) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        if not members:
            raise place.error(f"no arrays in it; {_MEND}")
        try:
            # All headers before any data: what the arrays come to is known before memory is taken for them.
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
        # Version 3 differs from 2 only in the field names of structured types, and these are refused below.
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    name = _column_of(place, member)
    # Complex, extended precision and objects do not fit into 64-bit floats.
    if len(shape) != 1 or dtype.kind not in "fiub" or dtype.itemsize > 8:
        raise place.error(f"column {name} is {len(shape)}-dimensional {dtype}; {_MEND}")
    if not 0 <= shape[0] <= SAMPLES:
        raise place.error(f"column {name} has {shape[0]} samples, but at most {SAMPLES} are read; split the run")
    # A header may promise gigabytes for a few bytes; the array would be allocated before that is noticed.
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
    # Not numpy.savez: it takes columns as keyword arguments, and one called `file` would clash with its own.
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, column in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, column, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_TIME), array.getvalue())
    return data.getvalue()


SUFFIXES = (".csv", ".csv.gz", ".npz")
_PIECE = 1 << 22
_SHORTEN = "write it as .npz, or split the run"


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
    found = _file_of(files, run_id, row)
    if found is None:
        raise files.place("runs.csv").error(f"runs/{run_id}.csv is missing; add it, or remove run {run_id}", row)
    return found


def read_own_clock_file(files: BundleFiles, run_id: str, channel: str, row: int) -> SampleFile | None:
    """The samples of a channel that has a clock of its own, with their times; None where the run has none.

    `DataError` as of `read_sample_file`, and when there are other columns in it than `t_s` and the channel.
    """
    found = _file_of(files, f"{run_id}.{channel}", row)
    if found is not None and set(found.columns) != {"t_s", channel}:
        raise found.place.error(
            f"holds the columns {', '.join(found.columns)}; write t_s and {channel}",
            1 if found.text is not None else None,
        )
    return found


def _file_of(files: BundleFiles, name: str, row: int) -> SampleFile | None:
    names = [full for suffix in SUFFIXES if (full := f"runs/{name}{suffix}") in files.names]
    if not names:
        return None
    # Nothing says which of two files holds the samples.
    if len(names) > 1:
        raise files.place("runs.csv").error(f"run {name} has both {' and '.join(names)}; remove all but one", row)
    return _read(files, names[0])


def _read(files: BundleFiles, name: str) -> SampleFile:
    place = files.place(name)
    if name.endswith(".npz"):
        with files.open(name, NPZ_BYTES, shorten="split the run") as file:
            return SampleFile(place, read_npz(place, file), None)
    data = files.read(name, RUN_TEXT_BYTES, shorten=_SHORTEN)
    if name.endswith(".gz"):
        data = gunzipped(place, data, RUN_TEXT_BYTES, _SHORTEN)
    text = decode(place, data)
    # Up to a gigabyte, which the parser's arrays can use.
    del data
    return SampleFile(place, read_csv(place, text), text)


def read_csv(place: Place, text: str) -> dict[str, FloatArray]:
    """The columns of a table of numbers under a header; `DataError` for anything else."""
    line, header = next(rows_with_lines(place, text), (1, None))
    if header is None:
        raise place.error("empty; write the column names in the first line", line)
    check_header(place, line, header)
    # A file with a header and no rows still has its columns.
    pieces = [np.empty((0, len(header)))]
    for before, piece in _pieces(text, line):
        values = _fast(piece, len(header))
        pieces.append(_careful(place, piece, before, header) if values is None else values)
    samples = sum(len(piece) for piece in pieces)
    if samples > SAMPLES or samples * len(header) > RUN_VALUES:
        raise place.error(f"{samples} samples of {len(header)} columns are too many; split the run")
    return {name: np.concatenate([piece[:, i] for piece in pieces]) for i, name in enumerate(header)}


def _pieces(text: str, header_line: int) -> Iterator[tuple[int, str]]:
    """What follows the header, cut between lines, each piece with the number of lines before it.

    Piece by piece, because numbers take less room than their text; at once where a quoted field may hold a line end.
    """
    before, at = header_line, 0
    for _ in range(header_line):
        at = text.find("\n", at) + 1 or len(text)
    longest = len(text) if text.find('"', at) >= 0 else _PIECE
    while at < len(text):
        end = text.find("\n", at + longest) + 1 or len(text)
        piece = text[at:end]
        yield before, piece
        before, at = before + piece.count("\n"), end


def _fast(text: str, width: int) -> FloatArray | None:
    """All numbers at once; None where a field is missing or wrong, which `_careful` sorts out."""
    if not text.strip():
        return np.empty((0, width))
    try:
        # A `#` in a field is no comment: it would silently shorten the row.
        values = np.loadtxt(io.StringIO(text), dtype=np.float64, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    # numpy reads `inf`, which the grammar of numbers does not: the slow way finds where it stands.
    return values if values.shape[1] == width and measurable(values) else None


def _careful(place: Place, text: str, before: int, header: list[str]) -> FloatArray:
    values: list[list[float]] = []
    for line, fields in rows_with_lines(place, text, before):
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
            return not_measurable(place, line, name, field)
        except ValueError:
            return place.error(
                f"column {name} holds {field!r}, not a number; leave a missing value empty or write nan", line
            )
    raise AssertionError(fields)


def csv_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """The columns, of equal length, as CSV whose numbers read back bit for bit; NaN is `nan`."""
    return csv_header(columns) + csv_rows(columns.values())


def csv_header(names: Iterable[str]) -> bytes:
    """The first line of a table with these columns."""
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(names)
    return header.getvalue().encode()


def csv_rows(columns: Iterable[FloatArray]) -> bytes:
    """The lines below it."""
    # The shortest text that reads back as the same 64-bit float.
    fields = [map(float.__repr__, column.tolist()) for column in columns]
    return "".join(f"{line}\n" for line in map(",".join, zip(*fields, strict=True))).encode()
