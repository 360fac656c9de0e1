"""Any recording's runs, each reduced once and kept in the store."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from rigctl.campaign.recording import KeepsReductions, RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.reduction import VERSION, ReducedRun, from_bytes, reduce_run, to_bytes

RECIPE = f"inflight-calibration {VERSION}"
_REFUSED = b"!"

Progress = Callable[[int, int], None]
"""Told how many runs are reduced, of how many."""


@dataclass(frozen=True)
class Reduction:
    """The valid runs of a recording, reduced; `left_out` says by run_id, in a sentence, why one is not."""

    runs: tuple[ReducedRun, ...]
    left_out: Mapping[str, str]


def reduction(source: RunSource, progress: Progress | None = None) -> Reduction:
    """All valid runs; what a store keeps is used, what is new is kept unless it is open for reading only.

    `DataError` when the recording does not say how long an orbit takes.
    """
    orbit_period_s = orbit_period_of(source)
    kept = source if isinstance(source, KeepsReductions) else None
    known = kept.reduced_names(RECIPE) if kept else set()
    records = source.runs(valid_only=True)
    runs, left_out = [], {}
    for done, record in enumerate(records, start=1):
        data = kept.reduction(RECIPE, record.run_id) if kept and record.run_id in known else None
        if data is None:
            data = _reduced(source, record, orbit_period_s)
            if kept and not kept.readonly:
                kept.keep_reductions(RECIPE, {record.run_id: data})
            if progress is not None:
                progress(done, len(records))
        if data.startswith(_REFUSED):
            left_out[record.run_id] = data[len(_REFUSED) :].decode()
        else:
            runs.append(from_bytes(data, record.run_id, record.conditions))
    return Reduction(tuple(runs), left_out)


def reduced_without(
    source: RunSource,
    run: ReducedRun,
    pulses_s: FloatArray,
    samples: Callable[[ReducedRun], Mapping[str, FloatArray]],
    orbit_period_s: float,
) -> ReducedRun:
    """A run reduced again without what pulses cover; `samples` gives them masked. Kept like the others."""
    kept = source if isinstance(source, KeepsReductions) else None
    recipe = f"{RECIPE} without {zlib.crc32(pulses_s.tobytes()):08x}"
    data = kept.reduction(recipe, run.run_id) if kept and run.run_id in kept.reduced_names(recipe) else None
    if data is None:
        found = reduce_run(run.run_id, run.conditions, samples(run), orbit_period_s)
        data = to_bytes(replace(found, remarks=run.remarks))
        if kept and not kept.readonly:
            kept.keep_reductions(recipe, {run.run_id: data})
    return from_bytes(data, run.run_id, run.conditions)


def orbit_period_of(source: RunSource) -> float:
    """From the recording's constants."""
    period_s = float(source.header.constants.get("orbit_period_s", math.nan))
    if not period_s > 0.0:
        raise DataError("recording.toml: [constants] has no orbit_period_s; add how long an orbit takes")
    return period_s


def _reduced(source: RunSource, record: RunRecord, orbit_period_s: float) -> bytes:
    try:
        run = reduce_run(record.run_id, record.conditions, source.samples(record.run_id), orbit_period_s)
    except DataError as error:
        return _REFUSED + str(error).encode()
    return to_bytes(run)
