"""Any recording's runs as observables: each reduced once, as a stream, and kept in the store."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.campaign.store import Store
from rigctl.errors import DataError
from rigctl.experiments.sensing_axis.kept_reduction import from_bytes, to_bytes
from rigctl.experiments.sensing_axis.observables import RunObservables
from rigctl.experiments.sensing_axis.recorded import recorded_faces
from rigctl.experiments.sensing_axis.reduction import PooledNoise, ReducedRun, face_column, reduce_run

VERSION = 1
"""Of what is kept: counted up whenever reduction.py would give other numbers."""

_REFUSED = b"!"
_KEEP_EVERY = 64

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


def _each(
    source: RunSource, records: Sequence[RunRecord], lines_hz: Sequence[float], progress: Progress | None
) -> Iterator[tuple[RunRecord, ReducedRun | str]]:
    """Every run reduced, or the sentence that says why it cannot be, in order."""
    kept = _Kept(source, recipe(lines_hz))
    for done, record in enumerate(records, start=1):
        data = kept.get(record.run_id)
        if data is None:
            data = _reduce(source, record, lines_hz)
            kept.put(record.run_id, data)
            if progress is not None:
                progress(done, len(records))
        yield record, _opened(data, record)
    kept.flush()


def _reduce(source: RunSource, record: RunRecord, lines_hz: Sequence[float]) -> bytes:
    try:
        samples = source.samples(record.run_id)
        return to_bytes(reduce_run(record.run_id, record.conditions, samples, lines_hz))
    except DataError as error:
        return _REFUSED + str(error).encode()


def _opened(data: bytes, record: RunRecord) -> ReducedRun | str:
    if data.startswith(_REFUSED):
        return data[len(_REFUSED) :].decode()
    return from_bytes(data, record.run_id, record.conditions)


class _Kept:
    """What a store keeps by a recipe; nothing for a recording in memory."""

    def __init__(self, source: RunSource, recipe: str) -> None:
        self._store = source if isinstance(source, Store) else None
        self._recipe = recipe
        self._names = self._store.reduced_names(recipe) if self._store else set()
        self._new: dict[str, bytes] = {}

    def get(self, name: str) -> bytes | None:
        return self._store.reduction(self._recipe, name) if self._store and name in self._names else None

    def put(self, name: str, data: bytes) -> None:
        if self._store is None or self._store.readonly:
            return
        self._new[name] = data
        if len(self._new) >= _KEEP_EVERY:
            self.flush()

    def flush(self) -> None:
        if self._store is not None and self._new:
            self._store.keep_reductions(self._recipe, self._new)
            self._new = {}
