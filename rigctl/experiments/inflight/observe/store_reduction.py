"""Any recording's runs, each reduced once and kept in the store."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

import numpy as np

from rigctl.analysis.kept import Kept, Packed, Progress, Recipe, Reduction, each_reduced
from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.grid import Grid
from rigctl.experiments.inflight.observe.reduction import BetweenLines, ReducedRun, ReducedStretch, reduce_run
from rigctl.experiments.inflight.observe.series import Amplitudes, without_pulses
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, Line, session_of

RECIPE = Recipe("inflight-calibration", 14)
"""Its version is counted up whenever reduction.py or model/residual_samples.py would give other numbers."""


def reduction(source: RunSource, progress: Progress | None = None) -> Reduction[ReducedRun]:
    """All valid runs.

    What a store keeps is used, what is new is kept unless it is open for reading only.

    `DataError` when the recording does not say how long an orbit takes.
    """
    orbit_period_s = orbit_period_of(source)

    def make(record: RunRecord) -> Packed:
        samples = source.samples(record.run_id)
        return packed(reduce_run(record.run_id, record.conditions, samples, orbit_period_s))

    records = [each for each in source.runs(valid_only=True) if each.conditions.get("session") not in EQUIVALENCE]
    runs = each_reduced(Kept(source, RECIPE), records, make, unpacked, progress)
    return Reduction.of(runs)


def reduced_without(source: RunSource, run: ReducedRun, pulses_s: FloatArray) -> ReducedRun:
    """A run reduced again without the samples that pulses beginning at `pulses_s` cover; kept like the others."""

    def make() -> Packed:
        samples = without_pulses(source.samples(run.run_id), pulses_s)
        again = reduce_run(run.run_id, run.conditions, samples, orbit_period_of(source))
        # Models with and without the pulses are compared on the same data.
        halves = tuple(after.at(before.lines) for after, before in zip(again.halves, run.halves, strict=True))
        return packed(replace(again, halves=halves, remarks=run.remarks))

    # By the pulses themselves: other pulses make another reduction of the same run.
    return kept_by(source, "without", pulses_s.tobytes()).once(run.run_id, make, lambda kept: unpacked(kept, run))


def orbit_period_of(source: RunSource) -> float:
    """From the recording's constants."""
    period_s = float(source.header.constants.get("orbit_period_s", math.nan))
    if not period_s > 0.0:
        raise DataError("recording.toml: [constants] has no orbit_period_s; add how long an orbit takes")
    return period_s


def kept_by(source: RunSource, what: str, depends_on: bytes) -> Kept:
    """What is kept of runs that depends on something besides their own samples."""
    return Kept(source, replace(RECIPE, settings=(what, f"{zlib.crc32(depends_on):08x}")))


def packed(run: ReducedRun) -> Packed:
    """Everything but the conditions; amplitudes bit for bit, thinned columns to single precision."""
    stretches = (run.whole, *run.halves)
    head = {
        "orbit_period_s": run.session.orbit_period_s,
        "sample_period_s": run.session.sample_period_s,
        "remarks": run.remarks,
        "columns": list(run.coarse.columns),
        "stretches": [
            {
                "start_s": each.start_s,
                "stop_s": each.stop_s,
                "lines": [[line.harmonic, line.orbital] for line in each.lines],
                "mean_square": each.amplitudes.mean_square,
                "apart": each.amplitudes.apart,
            }
            for each in stretches
        ],
    }
    columns = np.array(list(run.coarse.columns.values()))
    levels = np.nanmean(np.where(run.coarse.present, columns, np.nan), axis=1)
    arrays = {
        "t_s": run.coarse.t_s,
        "present": run.coarse.present,
        "f_hz": run.between.f_hz,
        "bins": run.between.bins,
        "levels": levels,
        # What varies needs six digits; a thermometer's 290 K would use them up.
        "coarse": (columns - levels[:, None]).astype(np.float32),
        **{f"table_{place}": each.amplitudes.table for place, each in enumerate(stretches)},
        **{f"spread_{place}": each.spread for place, each in enumerate(stretches)},
        **({} if run.whole.fast is None else {"fast": run.whole.fast}),
    }
    return Packed(head, arrays)


def unpacked(kept: Packed, run: RunRecord | ReducedRun) -> ReducedRun:
    """The run that `packed` was given, with the conditions it has now."""
    head, arrays = kept.head, kept.arrays
    whole, *halves = (
        ReducedStretch(
            each["start_s"],
            each["stop_s"],
            tuple(Line(*line) for line in each["lines"]),
            Amplitudes(arrays[f"table_{place}"], each["mean_square"], each["apart"]),
            arrays[f"spread_{place}"],
        )
        for place, each in enumerate(head["stretches"])
    )
    varying = np.where(arrays["present"], arrays["coarse"].astype(np.float64) + arrays["levels"][:, None], 0.0)
    columns = dict(zip(head["columns"], varying, strict=True))
    return ReducedRun(
        run.run_id,
        session_of(run.run_id, run.conditions, head["orbit_period_s"], head["sample_period_s"]),
        dict(run.conditions),
        replace(whole, fast=arrays.get("fast")),
        tuple(halves),
        BetweenLines(arrays["f_hz"], arrays["bins"]),
        Grid(arrays["t_s"], columns, arrays["present"]),
        tuple(head["remarks"]),
    )
