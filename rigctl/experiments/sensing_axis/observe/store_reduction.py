"""Any recording's runs as observables: each reduced once, as a stream, and kept in the store."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from rigctl.analysis.clock_fit import ClockFit
from rigctl.analysis.kept import Kept, LeftOut, Packed, Progress, Recipe, Reduction, each_reduced
from rigctl.analysis.line_scan import LineScan, ScannedRun, scanned
from rigctl.analysis.noise import NoisePool, Spectrum
from rigctl.campaign.recording import Header, RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_faces
from rigctl.experiments.sensing_axis.observe.reduction import (
    ACCEL,
    PooledNoise,
    ReducedChannel,
    ReducedRun,
    face_column,
    reduce_with_residuals,
)

VERSION = 4
"""Of what is kept: counted up whenever reduction.py would give other numbers."""

_SCAN_VERSION = 5
"""The same of scans, whenever line_scan.py would, or runs were in other halves."""

_SCAN = "accel_v"

Samples = Mapping[str, FloatArray]


def reduction(
    source: RunSource, lines_hz: Sequence[float] = (), progress: Progress | None = None
) -> Reduction[RunObservables]:
    """The observables of all valid runs, with steady lines at `lines_hz` fitted beside the harmonics.

    What a store keeps of earlier calls is used, what is new is kept, unless it is open for reading only.
    """
    noise = PooledNoise()
    runs: list[ReducedRun | LeftOut] = []
    for run in _each_run(source, lines_hz, progress):
        if isinstance(run, ReducedRun):
            noise.add(run)
            # Spectra of thousands of runs do not fit into memory; the pool has taken what it needs of them.
            runs.append(run.without_spectra())
        else:
            runs.append(run)
    return Reduction.of(_observed(noise, run) for run in runs)


def spectra_left(source: RunSource, lines_hz: Sequence[float] = ()) -> dict[str, Spectrum]:
    """What is left in the samples of all valid runs beside the harmonics and these lines, pooled, by channel."""
    pools: dict[str, NoisePool] = {}
    for run in _each_run(source, lines_hz, None):
        if isinstance(run, ReducedRun):
            for name, channel in run.channels.items():
                pools.setdefault(name, NoisePool()).add(channel.noise)
    return {name: pool.spectrum for name, pool in pools.items()}


def _each_run(
    source: RunSource, lines_hz: Sequence[float], progress: Progress | None
) -> Iterator[ReducedRun | LeftOut]:
    """Every valid run with its spectra, reduced now or before, in the order in which they were measured."""
    faces = {face_column(head): face for head, face in recorded_faces(source.header).items()}
    # What a run says of its faces goes before what the header says of all.
    records = [replace(r, conditions={**faces, **r.conditions}) for r in source.runs(valid_only=True)]
    # The pool's sums are rounded, and an effect that is all but absorbed tells in which order they were taken.
    records.sort(key=_start_s)
    scan = _GrowingScan(Kept(source, scan_recipe(lines_hz)))

    def make(record: RunRecord) -> Packed:
        samples = source.samples(record.run_id)
        try:
            run, residuals = reduce_with_residuals(
                record.run_id, record.conditions, samples, lines_hz, source.header.channels
            )
        except DataError:
            # Remembered all the same: else its samples would be read again at every question.
            scan.add(record, samples, lambda: None)
            raise
        scan.add(record, samples, lambda: scanned(residuals.basis, residuals.values, run.channels[ACCEL].noise))
        return packed(run)

    yield from each_reduced(Kept(source, recipe(lines_hz)), records, make, unpacked, progress)
    scan.keep()


def line_scan(source: RunSource, lines_hz: Sequence[float] = ()) -> LineScan:
    """The scan for steady lines in the accelerometer's samples of the valid runs; see `rigctl.analysis.line_scan`.

    A store keeps it: runs marked since are taken out or put in by their samples alone.
    """
    kept = Kept(source, scan_recipe(lines_hz))
    records = {record.run_id: record for record in source.runs()}
    valid = {run_id for run_id, record in records.items() if record.valid}
    scan = _opened(kept)
    missing = [run_id for run_id in records if run_id in valid and run_id not in scan.runs]
    gone = [run_id for run_id in scan.runs if run_id not in valid]
    for run_id in (*gone, *missing):
        samples = source.samples(run_id)
        part = _scanned(source.header, records[run_id], samples, lines_hz)
        if run_id in valid:
            scan.add(run_id, _group(records[run_id], samples), part)
        else:
            scan.remove(run_id, part)
    if gone or missing:
        kept.put(_SCAN, scan.packed())
    return scan


def recipe(lines_hz: Sequence[float]) -> Recipe:
    """By which runs with these lines are reduced."""
    return Recipe("runs sensing-axis", VERSION, tuple(map(float, lines_hz)))


def scan_recipe(lines_hz: Sequence[float]) -> Recipe:
    """By which the scan for further lines is made."""
    return replace(recipe(lines_hz), name="scan sensing-axis", version=_SCAN_VERSION)


class _GrowingScan:
    """The scan that a store keeps, with the runs that are reduced now; not even opened where none is."""

    def __init__(self, kept: Kept) -> None:
        self._kept = kept
        self._scan: LineScan | None = None

    def add(self, record: RunRecord, samples: Samples, part: Callable[[], ScannedRun | None]) -> None:
        """Add a run that has just been reduced, where the scan can be kept."""
        if self._kept.writable:
            self._scan = self._scan or _opened(self._kept)
            if record.run_id not in self._scan.runs:
                self._scan.add(record.run_id, _group(record, samples), part())

    def keep(self) -> None:
        """Keep it with what was added."""
        if self._scan is not None:
            self._kept.put(_SCAN, self._scan.packed())


def _opened(kept: Kept) -> LineScan:
    return kept.get(_SCAN, LineScan.unpacked) or LineScan()


def _scanned(header: Header, record: RunRecord, samples: Samples, lines_hz: Sequence[float]) -> ScannedRun | None:
    try:
        run, left = reduce_with_residuals(record.run_id, record.conditions, samples, lines_hz, header.channels)
    except DataError:
        return None
    return scanned(left.basis, left.values, run.channels[ACCEL].noise)


def _observed(noise: PooledNoise, run: ReducedRun | LeftOut) -> RunObservables | LeftOut:
    try:
        return run if isinstance(run, LeftOut) else noise.observed(run)
    except DataError as error:
        return LeftOut(run.run_id, str(error))


def _start_s(record: RunRecord) -> float:
    start_s = float(record.conditions.get("start_s", np.inf))
    return start_s if np.isfinite(start_s) else np.inf


def _group(record: RunRecord, samples: Samples) -> tuple[str, int]:
    """Whose noise a run shares, and in which half of them it is held out."""
    given = record.conditions
    # By what was read, not by the name, which means nothing: a run stays in its half whichever others there are.
    half = zlib.crc32(np.ascontiguousarray(samples[ACCEL]).tobytes()) & 1
    return f"{given['axis']} {given['configuration']}", half


def packed(run: ReducedRun) -> Packed:
    """What cannot be read from runs.csv: everything but the conditions; spectra in single precision."""
    channels = run.channels.values()
    head = {
        "frequency_hz": run.frequency_hz,
        "duration_s": run.duration_s,
        "bins": {name: each.noise.weight.size for name, each in run.channels.items()},
        "clocks": {name: asdict(each.clock) for name, each in run.channels.items() if each.clock},
    }
    spectra = [np.stack([each.noise.frequency_hz, each.noise.psd, each.noise.weight]) for each in channels]
    arrays = {
        "motion_m": run.motion_m,
        "amplitudes": np.stack([np.concatenate([each.value, each.lines]) for each in channels]),
        "variances": np.stack([np.stack([each.variance_factor, each.floor]) for each in channels]),
        # Noise is known to per cents, and spectra are most of what is kept.
        "noise": np.concatenate(spectra, axis=1).astype(np.float32),
    }
    return Packed(head, arrays)


def unpacked(kept: Packed, record: RunRecord) -> ReducedRun:
    """The run that `packed` was given, with the conditions it has now."""
    head, arrays = kept.head, kept.arrays
    ends = np.cumsum(list(head["bins"].values()))[:-1]
    spectra = np.split(arrays["noise"].astype(np.float64), ends, axis=1)
    clocks = {name: ClockFit(**each) for name, each in head["clocks"].items()}
    channels = {
        name: ReducedChannel(
            value[: HARMONICS + 1], Spectrum(*spectrum), factor, floor, value[HARMONICS + 1 :], clocks.get(name)
        )
        for name, value, (factor, floor), spectrum in zip(
            head["bins"], arrays["amplitudes"], arrays["variances"], spectra, strict=True
        )
    }
    return ReducedRun(
        record.run_id,
        dict(record.conditions),
        head["frequency_hz"],
        head["duration_s"],
        arrays["motion_m"],
        channels,
    )
