"""Any recording's runs as observables: each reduced once, as a stream, and kept in the store."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rigctl.analysis.lines import LineScan, ScannedRun, scanned
from rigctl.campaign.recording import KeepsReductions, RunRecord, RunSource
from rigctl.core.errors import DataError
from rigctl.experiments.sensing_axis.observe.kept_reduction import from_bytes, to_bytes
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_faces
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL, PooledNoise, ReducedRun, face_column, reduce_run

VERSION = 2
"""Of what is kept: counted up whenever reduction.py would give other numbers."""

_REFUSED = b"!"
_KEEP_EVERY = 64
_RUNS, _SCANS, _SCAN = "runs ", "scan ", "accel_v"

Progress = Callable[[int, int], None]
"""Told how many runs are reduced, of how many."""


@dataclass(frozen=True)
class Reduction:
    """The valid runs of a recording, reduced; `left_out` says by run_id, in a sentence, why one is not."""

    runs: tuple[RunObservables, ...]
    left_out: Mapping[str, str]


def reduced(source: RunSource) -> list[RunObservables]:
    """The observables of the valid runs that can be reduced; see `reduction` for those that cannot."""
    return list(reduction(source).runs)


def reduction(source: RunSource, lines_hz: Sequence[float] = (), progress: Progress | None = None) -> Reduction:
    """The observables of all valid runs, with steady lines at `lines_hz` fitted beside the harmonics.

    What a store keeps of earlier calls is used, what is new is kept, unless it is open for reading only.
    """
    faces = {face_column(head): face for head, face in recorded_faces(source.header).items()}
    records = [replace(r, conditions={**faces, **r.conditions}) for r in source.runs(valid_only=True)]
    noise, small, left_out = PooledNoise(), [], {}
    for record, run in _each(source, records, lines_hz, progress):
        if isinstance(run, str):
            left_out[record.run_id] = run
        else:
            noise.add(run)
            small.append(run.without_spectra())
    runs = []
    for run in small:
        try:
            runs.append(noise.observed(run))
        except DataError as error:
            left_out[run.run_id] = str(error)
    return Reduction(tuple(runs), left_out)


def recipe(lines_hz: Sequence[float]) -> str:
    """The name under which reductions with these lines are kept."""
    return " ".join(["sensing-axis", str(VERSION), *(repr(float(line)) for line in lines_hz)])


def line_scan(source: RunSource, lines_hz: Sequence[float] = (), progress: Progress | None = None) -> LineScan:
    """The scan for steady lines in the accelerometer's samples of the valid runs; see `rigctl.analysis.lines`.

    A store keeps it: runs marked since are taken out or put in by their samples alone.
    """
    kept = _Kept(source, recipe(lines_hz))
    records = {record.run_id: record for record in source.runs()}
    valid = {run_id for run_id, record in records.items() if record.valid}
    scan = kept.scan()
    missing = [run_id for run_id in records if run_id in valid and run_id not in scan.runs]
    gone = [run_id for run_id in scan.runs if run_id not in valid]
    for done, run_id in enumerate([*gone, *missing], start=1):
        _, part = _reduce(source, records[run_id], lines_hz)
        if run_id in valid:
            scan.add(run_id, _group(records[run_id]), part)
        else:
            scan.remove(run_id, part)
        if progress is not None:
            progress(done, len(gone) + len(missing))
    if gone or missing:
        kept.put_scan(scan)
    return scan


def _each(
    source: RunSource, records: Sequence[RunRecord], lines_hz: Sequence[float], progress: Progress | None
) -> Iterator[tuple[RunRecord, ReducedRun | str]]:
    """Every run reduced, or the sentence that says why it cannot be, in order; the scan grows with what is new."""
    kept = _Kept(source, recipe(lines_hz))
    scan: LineScan | None = None
    for done, record in enumerate(records, start=1):
        data = kept.get(record.run_id)
        if data is None:
            data, part = _reduce(source, record, lines_hz)
            if kept.keeps:
                scan = scan or kept.scan()
                if record.run_id not in scan.runs:
                    scan.add(record.run_id, _group(record), part)
                kept.put(record.run_id, data)
            if progress is not None:
                progress(done, len(records))
        yield record, _opened(data, record)
    kept.flush()
    if scan is not None:
        kept.put_scan(scan)


def _reduce(source: RunSource, record: RunRecord, lines_hz: Sequence[float]) -> tuple[bytes, ScannedRun | None]:
    try:
        samples = source.samples(record.run_id)
        run = reduce_run(record.run_id, record.conditions, samples, lines_hz, keep_residuals=True)
    except DataError as error:
        return _REFUSED + str(error).encode(), None
    left = run.residuals[ACCEL]
    return to_bytes(run), scanned(left.basis, left.values, run.channels[ACCEL].noise)


def _group(record: RunRecord) -> tuple[str, int]:
    """Whose noise a run shares, and in which half of them it is held out."""
    given = record.conditions
    return f"{given['axis']} {given['configuration']}", zlib.crc32(record.run_id.encode()) & 1


def _opened(data: bytes, record: RunRecord) -> ReducedRun | str:
    if data.startswith(_REFUSED):
        return data[len(_REFUSED) :].decode()
    return from_bytes(data, record.run_id, record.conditions)


class _Kept:
    """What a store keeps by a recipe; nothing for a recording in memory, nothing new when open for reading."""

    def __init__(self, source: RunSource, recipe: str) -> None:
        self._store = source if isinstance(source, KeepsReductions) else None
        self._recipe = recipe
        self._names = self._store.reduced_names(_RUNS + recipe) if self._store else set()
        self._new: dict[str, bytes] = {}

    @property
    def keeps(self) -> bool:
        return self._store is not None and not self._store.readonly

    def get(self, run_id: str) -> bytes | None:
        return self._store.reduction(_RUNS + self._recipe, run_id) if self._store and run_id in self._names else None

    def put(self, run_id: str, data: bytes) -> None:
        self._new[run_id] = data
        if len(self._new) >= _KEEP_EVERY:
            self.flush()

    def flush(self) -> None:
        if self._store is not None and self._new:
            self._store.keep_reductions(_RUNS + self._recipe, self._new)
            self._new = {}

    def scan(self) -> LineScan:
        """The scan as kept; an empty one when there is none."""
        if self._store is None or _SCAN not in self._store.reduced_names(_SCANS + self._recipe):
            return LineScan()
        return LineScan.from_bytes(self._store.reduction(_SCANS + self._recipe, _SCAN) or b"")

    def put_scan(self, scan: LineScan) -> None:
        if self._store is not None and self.keeps:
            self._store.keep_reductions(_SCANS + self._recipe, {_SCAN: scan.to_bytes()})
