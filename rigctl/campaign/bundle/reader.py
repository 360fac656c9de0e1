"""A bundle, run by run: what its files say, checked, in the words of `rigctl.campaign.recording`."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.campaign.bundle.checks import check_own_clock, check_samples
from rigctl.campaign.bundle.csv_table import CsvTable, is_number, numbers_or_text, read_table
from rigctl.campaign.bundle.files import HEADER_FILE, BundleFiles
from rigctl.campaign.bundle.recording_toml import parse_toml, read_header
from rigctl.campaign.bundle.sample_file import (
    SUFFIXES,
    SampleFile,
    read_own_clock_file,
    read_sample_file,
)
from rigctl.campaign.layout import Field, Layout, face, flag, layout_of, number
from rigctl.campaign.recording import (
    READINGS,
    ImportReport,
    RunRecord,
    TableFlaw,
    flaw_of_run_id,
    own_clocks,
    time_column,
)
from rigctl.core.arrays import FloatArray
from rigctl.core.bounds import RUNS, TABLE_BYTES, TABLE_ROWS, TOML_BYTES
from rigctl.core.errors import DataError
from rigctl.core.numbers import is_missing
from rigctl.core.readings import VALID, excluded_rows, flaw_of_stamps, pasted_rows, row_label, seconds_of_stamps
from rigctl.core.units import doubt_of_constant

RunWithSamples = tuple[RunRecord, Mapping[str, FloatArray]]

PATTERN_COLUMNS = ("pattern", "period_s", "dwell_index", "sign_cos_theta", "start_s", "stop_s")
STEP = "import"
READINGS_FILE = "readings.csv"


class BundleReader:
    """Reads one bundle once: `header` at once, `runs` one after the other, then `report`."""

    def __init__(self, files: BundleFiles) -> None:
        self._files = files
        self._warnings: list[str] = []
        self._invalid: list[tuple[str, str]] = []
        self._count = 0
        self._lines: Sequence[int] = ()
        self.header = read_header(
            files.place(HEADER_FILE), files.read(HEADER_FILE, TOML_BYTES, "a bundle says there what it holds")
        )
        self._layout = layout_of(self.header.experiment)
        if (free := own_clocks(self.header)) and not (self._layout and self._layout.own_clocks):
            raise files.place(HEADER_FILE).error(
                f"[channels.{free[0]}] clock: a {self.header.experiment} recording has one clock; leave it out"
            )
        if self._layout is not None and self._layout.patterns and "patterns.csv" in files.names:
            patterns = _read_patterns(
                read_table(files.place("patterns.csv"), files.read("patterns.csv", TABLE_BYTES), TABLE_ROWS)
            )
            self.header = replace(self.header, extra={**self.header.extra, "patterns": patterns})

    @property
    def report(self) -> ImportReport:
        """What was found; complete when all of `runs` has been read."""
        return ImportReport(self._count, tuple(self._invalid), tuple(self._warnings))

    def runs(self) -> Iterator[RunWithSamples]:
        """Every run with its samples; `DataError` for the first thing that cannot be accepted."""
        runs = self._readings() if self._layout is None else self._measured(self._layout)
        for record, samples in runs:
            self._count += 1
            if not record.valid:
                self._invalid.append((record.run_id, record.reason))
            yield record, samples

    def warn(self, remarks: Sequence[str]) -> None:
        """Lines that the report is to have as well."""
        self._warnings += remarks

    def located(self, error: DataError) -> DataError:
        """What was found when the readings were tried, with the file of this bundle and the line."""
        if not isinstance(error, TableFlaw):
            return DataError(f"{self._files.path}: {error}")
        if error.keys:
            place = self._files.place(HEADER_FILE)
            return place.error(
                error.said, parse_toml(place, self._files.read(HEADER_FILE, TOML_BYTES)).line_of(error.keys)
            )
        return self._files.place(READINGS_FILE).error(
            error.said, None if error.row is None else self._lines[error.row]
        )

    def _measured(self, layout: Layout) -> Iterator[RunWithSamples]:
        data = self._files.read("runs.csv", TABLE_BYTES, "add it, one row per run")
        table = read_table(self._files.place("runs.csv"), data, RUNS)
        rows = _run_rows(table, layout, self._warnings)
        self._require_own_files(table, {run_id for run_id, _ in rows})
        self._warn_of_the_header(layout)
        # Collected on the way: that no run file has a channel is known only after the last one.
        seen: set[str] = set()
        for line, (run_id, conditions) in zip(table.lines, rows, strict=True):
            if layout.patterns:
                self._require_dwells(table, line, conditions)
            file = read_sample_file(self._files, run_id, line)
            record = self._checked(layout, run_id, conditions, file)
            columns = {**file.columns, **self._own_clocks(layout, record, file, line)}
            seen.update(columns)
            yield record, columns
        self._warn_of_strangers({run_id for run_id, _ in rows}, seen)

    def _require_own_files(self, table: CsvTable, run_ids: set[str]) -> None:
        """No file of a channel's own samples is that of another run as well."""
        for run_id in run_ids:
            for name in own_clocks(self.header):
                if f"{run_id}.{name}" in run_ids:
                    raise table.place.error(
                        f"run {run_id}.{name} has the file of channel {name} of run {run_id}; give it another run_id"
                    )

    def _own_clocks(self, layout: Layout, record: RunRecord, file: SampleFile, line: int) -> dict[str, FloatArray]:
        """The channels of a run that have clocks of their own, each with its times."""
        columns: dict[str, FloatArray] = {}
        for name in own_clocks(self.header):
            if name in file.columns:
                own = f"runs/{record.run_id}.{name}.csv"
                raise file.place.error(f"{name} has a clock of its own; move it with its times to {own}")
            found = read_own_clock_file(self._files, record.run_id, name, line)
            if found is None:
                continue
            info, period_s = self.header.channels[name], layout.period_of(record.conditions)
            if record.valid:
                remarks = check_own_clock(found, name, info, period_s).remarks
                self._warnings += [f"{found.place.file}: {remark}" for remark in remarks]
            columns |= {name: found.columns[name], time_column(name): found.columns["t_s"]}
        return columns

    def _checked(self, layout: Layout, run_id: str, row: Mapping[str, Any], file: SampleFile) -> RunRecord:
        conditions = {name: value for name, value in row.items() if name not in {"valid", "reason"}}
        # A missing `valid` is NaN, which means valid.
        declared = row.get("valid", True) is not False
        findings = check_samples(
            layout, conditions, file, self.header.channels, self.header.constants, declared_valid=declared
        )
        # An exported reason already contains the findings; they must not be appended again at each round trip.
        given = str(row.get("reason", ""))
        reasons = [given] if given else [] if declared else ["marked invalid in runs.csv"]
        reasons += [finding for finding in (*findings.invalid, *findings.remarks) if finding not in given]
        self._warnings += [f"{file.place.file}: {remark}" for remark in findings.remarks]
        valid = declared and not findings.invalid
        return RunRecord(run_id, run_id, STEP, conditions, valid, "; ".join(reasons))

    def _readings(self) -> Iterator[RunWithSamples]:
        place = self._files.place(READINGS_FILE)
        table = read_table(
            place, self._files.read(READINGS_FILE, TABLE_BYTES, "add it, one row per reading"), TABLE_ROWS
        )
        if not table.rows:
            raise place.error("no readings; add a row per reading", 1)
        self._lines = table.lines
        samples: dict[str, FloatArray] = {}
        texts: dict[str, list[str]] = {}
        for name in table.header:
            if name == VALID:
                samples[name] = np.array(_values(table, name, Field(_counts)), dtype=np.float64)
                continue
            values, remark = numbers_or_text(table, name)
            self._warnings += [remark] if remark else []
            # Text columns go with the conditions, because samples are 64-bit floats and nothing else.
            if values and isinstance(values[0], float):
                samples[name] = np.array(values, dtype=np.float64)
            else:
                texts[name] = table.column(name)
                if flaw := flaw_of_stamps(texts[name]):
                    row, why = flaw
                    mend = "mend it, or leave a missing value empty"
                    self._warnings.append(
                        str(place.error(f"{why}, makes column {name} one of text; {mend}", table.lines[row]))
                    )
        self._require_question(table, samples)
        excluded = excluded_rows(samples, texts)
        self._invalid += [(row_label(row), reason) for row, reason in excluded.items()]
        self._warn_of_pasted_rows(samples, texts, list(excluded))
        self._warn_of_absent(table.header, "is no column of readings.csv")
        yield RunRecord(READINGS, READINGS, STEP, texts), samples

    def _warn_of_pasted_rows(
        self, samples: Mapping[str, FloatArray], texts: Mapping[str, list[str]], excluded: Sequence[int]
    ) -> None:
        assert self.header.table is not None
        response = self.header.table.response
        rows = np.setdiff1d(np.flatnonzero(np.isfinite(samples[response])), excluded)
        others: list[list[Any]] = [values[rows].tolist() for name, values in samples.items() if name != response]
        others += [[text[row] for row in rows.tolist()] for text in texts.values()]
        copies, originals = pasted_rows(samples[response][rows], others)
        if len(copies):
            pairs = [
                f"{row_label(rows[copy])} is {row_label(rows[of])}"
                for copy, of in zip(copies, originals, strict=True)
            ]
            shown = ", ".join(pairs[:3]) + (f" and {len(pairs) - 3} more" if len(pairs) > 3 else "")
            self._warnings.append(
                f"readings.csv: {len(copies)} rows stand in it twice, more than repeats allow ({shown}); they count"
                " once"
            )

    def _require_question(self, table: CsvTable, samples: Mapping[str, FloatArray]) -> None:
        spec = self.header.table
        assert spec is not None
        for key, name, numeric in (
            ("response", spec.response, True),
            ("order", spec.order, True),
            ("block", spec.block, False),
            ("sigma", spec.sigma, True),
            *(("batch", name, False) for name in spec.batch),
        ):
            if name is None:
                continue
            _require_columns(table, [name], f", which [table] {key} names")
            # A column of time stamps is text here and becomes seconds when it is analysed.
            if numeric and name not in samples and seconds_of_stamps(table.column(name)) is None:
                if flaw := flaw_of_stamps(table.column(name)):
                    row, why = flaw
                    raise table.place.error(
                        f"column {name} holds {why}; mend it, or leave a missing value empty", table.lines[row]
                    )
                line, text = next((n, t) for n, t in table.fields(name) if not (is_missing(t) or is_number(t)))
                raise table.place.error(
                    f"column {name} holds {text!r}, but [table] {key} needs numbers; leave a missing value empty",
                    line,
                )

    def _require_dwells(self, table: CsvTable, line: int, conditions: Mapping[str, Any]) -> None:
        if conditions["pattern"] != "custom":
            return
        patterns = self.header.extra.get("patterns")
        if patterns is None:
            raise table.place.error("a custom pattern, but no patterns.csv; add it, one row per dwell", line)
        period_s = conditions["modulation_period_s"]
        periods = [
            period for name, period in zip(patterns["pattern"], patterns["period_s"], strict=True) if name == "custom"
        ]
        if not any(math.isclose(period, period_s, rel_tol=1e-9) for period in periods):
            raise table.place.error(
                f"patterns.csv has no dwells of pattern custom with period_s {period_s:g}; add them", line
            )

    def _warn_of_the_header(self, layout: Layout) -> None:
        place = self._files.place(HEADER_FILE)
        for name, value in self.header.constants.items():
            if doubt := doubt_of_constant(name, value):
                self._warnings.append(str(place.error(f"[constants] {name} {doubt}")))
        for name, doubt in layout.doubt_of_constants(self.header.constants):
            self._warnings.append(str(place.error(f"[constants] {name} {doubt}")))
        for name in layout.constants:
            if name not in self.header.constants:
                self._warnings.append(str(place.error(f"[constants] has no {name}; add it before you fit")))

    def _warn_of_strangers(self, run_ids: set[str], columns: set[str]) -> None:
        known = run_ids | {f"{run_id}.{name}" for run_id in run_ids for name in own_clocks(self.header)}
        for name in sorted(self._files.names):
            suffix = next((s for s in SUFFIXES if name.endswith(s)), None)
            if name.startswith("runs/") and suffix and name[5 : -len(suffix)] not in known:
                self._warnings.append(str(self._files.place(name).error("not in runs.csv, left out")))
        self._warn_of_absent(columns, "is a column of no run file")

    def _warn_of_absent(self, columns: Collection[str], said: str) -> None:
        """What recording.toml describes and no file has: a unit that nobody finds under its name."""
        place = self._files.place(HEADER_FILE)
        for kind, names in (("channels", self.header.channels), ("lasers", self.header.lasers)):
            for name in names:
                if name not in columns:
                    self._warnings.append(str(place.error(f"[{kind}.{name}] {said}")))


def _run_rows(table: CsvTable, layout: Layout, warnings: list[str]) -> list[tuple[str, dict[str, Any]]]:
    """The run_id and the other columns of every row of runs.csv."""
    _require_columns(table, ["run_id", *(name for name, field in layout.fields.items() if field.required)])
    run_ids = _run_ids(table)
    columns = {name: _column(table, name, layout, warnings) for name in table.header if name != "run_id"}
    rows = [{name: values[i] for name, values in columns.items()} for i in range(len(run_ids))]
    for line, row in zip(table.lines, rows, strict=True):
        if flaw := layout.flaw_of_run(row):
            raise table.place.error(flaw, line)
    return list(zip(run_ids, rows, strict=True))


def _run_ids(table: CsvTable) -> list[str]:
    seen: dict[str, int] = {}
    for line, run_id in table.fields("run_id"):
        if flaw := flaw_of_run_id(run_id):
            raise table.place.error(f"run_id {run_id!r} {flaw}; give the run another", line)
        if run_id in seen:
            raise table.place.error(
                f"run_id {run_id} is in line {seen[run_id]} already; give every run its own", line
            )
        seen[run_id] = line
    return list(seen)


def _column(table: CsvTable, name: str, layout: Layout, warnings: list[str]) -> list[Any]:
    field = layout.fields.get(name)
    if name.startswith("laser_") and name.endswith("_face"):
        field = Field(face, missing="")
    if name == "reason":
        return table.column(name)
    if field is not None:
        return _values(table, name, field)
    values, remark = numbers_or_text(table, name)
    warnings += [remark] if remark else []
    return list(values)


def _counts(text: str) -> bool:
    """1 or 0, or what a spreadsheet makes of them."""
    try:
        return flag({"true": "1", "false": "0"}.get(text.lower(), text))
    except ValueError:
        raise ValueError("1 or 0, or give a column that says anything else another name") from None


def _values(table: CsvTable, name: str, field: Field) -> list[Any]:
    values: list[Any] = []
    for line, text in table.fields(name):
        missing = is_missing(text)
        if missing and field.required:
            raise table.place.error(f"{name} is missing; write it", line)
        try:
            values.append(field.missing if missing else field.parse(text))
        except ValueError as expected:
            raise table.place.error(f"{name} is {text!r}; write {expected}", line) from None
    return values


def _read_patterns(table: CsvTable) -> dict[str, list[Any]]:
    """The columns of patterns.csv: a dwell per row."""
    _require_columns(table, PATTERN_COLUMNS)
    columns: dict[str, list[Any]] = {"pattern": table.column("pattern")}
    columns |= {name: _values(table, name, Field(number, required=True)) for name in PATTERN_COLUMNS[1:]}
    for line, sign, start, stop, period in zip(
        table.lines, *(columns[name] for name in ("sign_cos_theta", "start_s", "stop_s", "period_s")), strict=True
    ):
        if sign not in {1.0, -1.0}:
            raise table.place.error(f"sign_cos_theta is {sign:g}; write +1 or -1", line)
        if not 0 <= start < stop <= period:
            raise table.place.error(
                f"a dwell from {start:g} to {stop:g} s does not lie in a period of {period:g} s; mend its times",
                line,
            )
    return {**columns, **{n: table.column(n) for n in table.header if n not in PATTERN_COLUMNS}}


def _require_columns(table: CsvTable, names: Iterable[str], named_by: str = "") -> None:
    for name in names:
        if name not in table.header:
            near = difflib.get_close_matches(name, table.header, n=1)
            mend = f"rename {near[0]}" if near else f"add it (there are {', '.join(table.header)})"
            raise table.place.error(f"column {name} is missing{named_by}; {mend}", 1)
