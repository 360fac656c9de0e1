"""Small CSV tables of a bundle (runs.csv, readings.csv, patterns.csv), with the line of every row."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rigctl.campaign.bundle.place import Place
from rigctl.campaign.recording import flaw_of_column
from rigctl.core.bounds import COLUMNS, LINE_CHARACTERS
from rigctl.core.errors import DataError
from rigctl.core.numbers import NotMeasurable, decimal, decimal_or_missing

_SHORTEST_LINE = 100
"""A row of many short lines counts as if they were longer: each takes its time."""


@dataclass(frozen=True)
class CsvTable:
    """Fields as text, stripped; `lines[i]` is where row i ends in the file."""

    place: Place
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    lines: Sequence[int]

    def column(self, name: str) -> list[str]:
        """The fields of one column."""
        index = self.header.index(name)
        return [row[index] for row in self.rows]

    def fields(self, name: str) -> Iterator[tuple[int, str]]:
        """The same, each with its line."""
        return zip(self.lines, self.column(name), strict=True)


def decode(place: Place, data: bytes) -> str:
    """UTF-8 text with `\\n` between lines, any byte order mark removed.

    `DataError` names the line that is not UTF-8, or is longer than any row.
    """
    try:
        # Spreadsheets put a byte order mark at the front, which would become part of the first column's name.
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise place.error(f"byte 0x{data[error.start]:02x} is not UTF-8; save it as UTF-8", line) from error
    # Looked for first, because both replacements copy a text of up to a gigabyte.
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    _require_short_lines(place, text)
    return text


def _require_short_lines(place: Place, text: str) -> None:
    at = 0
    while len(text) - at > LINE_CHARACTERS:
        # Jumps from bound to bound instead of line by line: few steps even for millions of short lines.
        end = text.rfind("\n", at, at + LINE_CHARACTERS + 1)
        if end < 0:
            raise place.error(
                f"longer than {LINE_CHARACTERS} characters; write a line for every row", text.count("\n", 0, at) + 1
            )
        at = end + 1


def rows_with_lines(place: Place, text: str, before: int = 0) -> Iterator[tuple[int, list[str]]]:
    """The rows that hold anything, as (line, fields), `before` lines above; `DataError` for broken quotes."""
    # A list, because `_lines` counts up in it what this loop sets back to 0 after every whole row.
    row_so_far = [0]
    reader = csv.reader(_lines(text, row_so_far), strict=True)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise place.error(f"{error}; mend the quotes", before + reader.line_num) from error
        row_so_far[0] = 0
        fields = [field.strip() for field in row]
        if any(fields):
            yield before + reader.line_num, fields


def _lines(text: str, row_so_far: list[int]) -> Iterator[str]:
    """Line by line: a quote that is never closed would make one row of the rest of the file."""
    at = 0
    while at < len(text):
        end = text.find("\n", at) + 1 or len(text)
        row_so_far[0] += max(end - at, _SHORTEST_LINE)
        if row_so_far[0] > 2 * LINE_CHARACTERS:
            raise csv.Error("a row that does not end")
        yield text[at:end]
        at = end


def check_header(place: Place, line: int, header: Sequence[str]) -> None:
    """`DataError` unless `header` names every column, each once, and at most `COLUMNS` of them."""
    if len(header) > COLUMNS:
        raise place.error(f"{len(header)} columns, but at most {COLUMNS} are read; leave out what nobody needs", line)
    # What a spreadsheet with a decimal comma writes, or one that is copied from.
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and separator in header[0]:
            raise place.error(f"fields are separated by {name}; save it with commas and decimal points", line)
    if all(is_number(name) for name in header):
        raise place.error("numbers where the header belongs; write the column names in the first line", line)
    for index, name in enumerate(header):
        if flaw := flaw_of_column(name):
            raise place.error(f"the name of column {index + 1} {flaw}; name it in the header", line)
        if name in header[:index]:
            raise place.error(f"column {name} is there twice; rename or remove one", line)


def is_number(text: str) -> bool:
    """Whether a field writes a number that can have been measured."""
    try:
        decimal(text)
    except ValueError:
        return False
    return True


def check_width(place: Place, line: int, fields: Sequence[str], header: Sequence[str]) -> None:
    """`DataError` unless the row has a field for every column."""
    if len(fields) != len(header):
        raise place.error(
            f"{len(fields)} fields where the header has {len(header)}; leave a missing value empty", line
        )


def read_table(place: Place, data: bytes, rows_max: int) -> CsvTable:
    """Parse a table; `DataError` for a missing or wrong header, ragged rows, broken quotes or encoding."""
    rows = rows_with_lines(place, decode(place, data))
    line, header = next(rows, (1, None))
    if header is None:
        raise place.error("empty; write the column names in the first line", line)
    check_header(place, line, header)
    kept: list[tuple[str, ...]] = []
    lines: list[int] = []
    for line, fields in rows:
        check_width(place, line, fields, header)
        if len(kept) == rows_max:
            raise place.error(f"more than {rows_max} rows; split the recording", line)
        kept.append(tuple(fields))
        lines.append(line)
    return CsvTable(place, tuple(header), kept, lines)


def numbers_or_text(table: CsvTable, name: str) -> tuple[list[float] | list[str], str | None]:
    """A column of the laboratory's own: numbers if it holds nothing else, otherwise text as it stands.

    The second is a remark on a column that looks like numbers spoilt by text, None if there is none. `DataError`
    for a number that cannot have been measured, such as `inf`.
    """
    fields = table.column(name)
    numbers: list[float] = []
    spoilt: list[int] = []
    beyond: list[int] = []
    for index, field in enumerate(fields):
        try:
            numbers.append(decimal_or_missing(field))
        except NotMeasurable:
            beyond.append(index)
        except ValueError:
            spoilt.append(index)
    if beyond and not spoilt:
        raise not_measurable(table.place, table.lines[beyond[0]], name, fields[beyond[0]])
    spoilt = sorted(spoilt + beyond)
    if not spoilt:
        return numbers, None
    # Where numbers are no majority the column is meant as text, and nothing is spoilt.
    if 2 * sum(not math.isnan(x) for x in numbers) <= len(fields):
        return fields, None
    first = spoilt[0]
    return fields, str(
        table.place.error(
            f"{fields[first]!r} makes column {name} one of text; leave a missing value empty",
            table.lines[first],
        )
    )


def not_measurable(place: Place, line: int, name: str, field: str) -> DataError:
    """The error for a number, such as `inf`, that no instrument can have given."""
    message = f"column {name} holds {field}, which nobody can have measured; mend it, or leave a missing value empty"
    return place.error(message, line)
