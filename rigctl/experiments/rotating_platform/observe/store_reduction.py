"""Any recording's modulated runs as cells: each reduced once, as a stream, and kept in the store."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rigctl.analysis.kept import Kept, Packed, Progress, Recipe, Reduction, each_reduced
from rigctl.analysis.line_scan import FoundLine
from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.cutter import cells_of
from rigctl.experiments.rotating_platform.observe.line_spectra import Spectra, spectra
from rigctl.experiments.rotating_platform.observe.lines import line_amplitudes, refined, without_lines
from rigctl.experiments.rotating_platform.observe.patterns import MODULATED
from rigctl.experiments.rotating_platform.observe.recorded import COMMANDS, Chains, chains, guards_of
from rigctl.experiments.rotating_platform.observe.recorded_turns import check_turns

VERSION = 14
"""Of what is kept: counted up whenever cutter.py would give other numbers."""

_SCAN_VERSION = 16
"""The same of scans, whenever line_spectra.py would."""


@dataclass(frozen=True)
class PlatformRun:
    """A modulated run: its conditions and its cells."""

    run_id: str
    conditions: Mapping[str, Any]
    cells: Cells

    @property
    def guards_s(self) -> dict[str, float]:
        """What its table masks after and before each turn (`recorded.guards_of`)."""
        return guards_of(self.conditions)


@runtime_checkable
class InChunks(Protocol):
    """A source that gives a run's samples piece by piece."""

    def sample_chunks(self, run_id: str) -> Iterable[Columns]:
        """Successive stretches of all columns of a run."""


def recipe(lines_hz: Sequence[float] = ()) -> Recipe:
    """By which runs with these lines taken off are reduced."""
    return Recipe("rotating-platform", VERSION, tuple(map(float, lines_hz)), compressed=True)


def reduction(
    source: RunSource, lines_hz: Sequence[float] = (), progress: Progress | None = None
) -> Reduction[PlatformRun]:
    """The cells of all valid modulated runs, steady lines at `lines_hz` taken off them.

    What a store keeps of earlier calls is used, what is new is kept.
    """
    believed = chains(source.header)
    kept = Kept(source, recipe(lines_hz))
    records = [r for r in source.runs(valid_only=True) if r.conditions["pattern"] in MODULATED]

    def make(record: RunRecord) -> Packed:
        return _cells(source, record, believed, lines_hz).packed()

    found = Reduction.of(each_reduced(kept, records, make, _unpacked, progress))
    # The samples have just been read: what is asked of them next is worked out at once (decision 016).
    if kept.added:
        scan(source, found.runs, lines_hz)
    return found


def contents_of(run: PlatformRun) -> list[float]:
    """By which runs are put in order: when they began, then what was read first."""
    return [run.conditions.get("start_s", math.nan), *run.cells.sums[:1].ravel()]


def chunks_of(source: RunSource, run_id: str) -> Iterable[Columns]:
    """A run's samples in pieces, where the source gives them so."""
    return source.sample_chunks(run_id) if isinstance(source, InChunks) else [source.samples(run_id)]


def _commanded(chunks: Iterable[Columns], conditions: Mapping[str, Any]) -> Iterator[Columns]:
    """The chunks, with the command as runs.csv tells it where the samples do not: level, sine or triangle."""
    level = conditions.get("v_z_v", 0.0)
    volts = float(level) if isinstance(level, int | float) and math.isfinite(level) else 0.0
    period_s = float(conditions.get("external_period_s", math.nan))
    begins_s: float | None = None
    for chunk in chunks:
        if COMMANDS["z"] in chunk or not chunk["t_s"].size:
            yield chunk
            continue
        begins_s = float(chunk["t_s"][0]) if begins_s is None else begins_s
        turns = (chunk["t_s"] - begins_s) / period_s
        yield {**chunk, COMMANDS["z"]: volts * _course(str(conditions.get("external")), turns)}


def _course(external: str, turns: FloatArray) -> FloatArray:
    """An external signal of amplitude 1, by turns of it since it began."""
    if external == "sine":
        return np.asarray(np.sin(2.0 * np.pi * turns))
    if external == "triangle":
        # As a sine: nil and rising at the start.
        return np.asarray(4.0 * np.abs((turns - 0.25) % 1.0 - 0.5) - 1.0)
    return np.ones(turns.size)


def samples_of(source: RunSource, run: PlatformRun, lines_hz: Sequence[float]) -> Iterator[Columns]:
    """A run's samples in pieces, lines taken off; nothing is read before the first is asked for."""
    if not lines_hz:
        yield from _commanded(chunks_of(source, run.run_id), run.conditions)
        return
    believed = chains(source.header)
    sizes = line_amplitudes(samples_of(source, run, ()), believed, run.cells, lines_hz)
    yield from without_lines(samples_of(source, run, ()), believed, lines_hz, sizes)


def records_of(source: RunSource, pattern: str) -> list[RunRecord]:
    """The valid runs of a pattern that is not modulated: flips, scans, noise records."""
    return [record for record in source.runs(valid_only=True) if record.conditions["pattern"] == pattern]


def column_of(source: RunSource, run_id: str, name: str) -> FloatArray:
    """A column of a run, whole."""
    return np.concatenate([chunk[name] for chunk in chunks_of(source, run_id)])


def scan(source: RunSource, runs: Sequence[PlatformRun], lines_hz: Sequence[float]) -> Spectra:
    """The scan for further lines in what the fits of all periods leave."""
    in_order = Reduction(tuple(runs), {}).sorted_by(contents_of).runs
    samples = {run.run_id: (run.cells, samples_of(source, run, lines_hz)) for run in in_order}
    kept = Kept(source, Recipe("scan rotating-platform", _SCAN_VERSION, tuple(map(float, lines_hz))))
    return spectra(kept, samples, chains(source.header))


def refined_line(
    source: RunSource, runs: Sequence[PlatformRun], lines_hz: Sequence[float], line: FoundLine
) -> tuple[FoundLine, str]:
    """A line of the scan with the frequency at which all runs together show it most; its size where it shows best.

    And in which channel that is.
    """
    samples = [(run.cells, samples_of(source, run, lines_hz)) for run in runs]
    longest_s = max(run.cells.periods * run.cells.period_s for run in runs)
    frequency_hz, sizes = refined(samples, chains(source.header), line.frequency_hz, 0.5 / longest_s)
    channel = max(sizes, key=lambda each: sizes[each][0] / sizes[each][1])
    amplitude, sigma = sizes[channel]
    return replace(line, frequency_hz=frequency_hz, amplitude=amplitude, sigma=sigma), channel


def _unpacked(kept: Packed, record: RunRecord) -> PlatformRun:
    return PlatformRun(record.run_id, record.conditions, Cells.unpacked(kept))


def _cells(source: RunSource, record: RunRecord, believed: Chains, lines_hz: Sequence[float]) -> Cells:
    given = record.conditions

    def cells(chunks: Iterable[Columns]) -> Cells:
        return cells_of(
            chunks,
            believed,
            float(given["modulation_period_s"]),
            float(given["sample_rate_hz"]),
            **guards_of(given),
        )

    try:
        found = cells(_commanded(chunks_of(source, record.run_id), given))
        if lines_hz:
            # A second pass: how large a line is shows in what the fits of the first have left.
            found = cells(samples_of(source, PlatformRun(record.run_id, given, found), lines_hz))
        check_turns(found, str(given["pattern"]), float(given["modulation_period_s"]))
    except DataError as error:
        raise DataError(f"run {record.run_id}: {error}") from error
    return found
