"""What a recording is in memory, wherever it came from: our own rig, or another laboratory's bundle.

Two things hold one: a `Recording` (all samples in memory) and a `rigctl.campaign.store.store.Store` (samples on
disk). Both are a `RunSource`, so what reads runs does not care which it has been given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

from rigctl.campaign.table_constants import TableConstant, TableConstants, flaw_of_constants
from rigctl.core.errors import DataError

if TYPE_CHECKING:
    from rigctl.core.arrays import FloatArray

READINGS = "readings"
"""The run that holds the readings of a `table` recording: numbers as samples, text columns as conditions."""

MAX_RUN_ID_BYTES = 200


class TableFlaw(DataError):
    """What a table asks and its readings cannot answer; `said` is what and the mend.

    `keys` lead to it in recording.toml; without any it is in readings.csv, in the row of the index `row` where one is
    given.
    """

    def __init__(self, said: str, keys: tuple[str, ...] = (), row: int | None = None) -> None:
        self.said, self.keys, self.row = said, keys, row
        where = "recording.toml, " if keys else "readings.csv: " if row is None else f"readings.csv, row {row + 1}: "
        super().__init__(where + said)


OWN_CLOCK = "own"


@dataclass(frozen=True)
class ChannelInfo:
    """One sample column: `noise_rms` and `full_scale` in `unit`, `latency_s` as recorded, not corrected.

    `clock` is `OWN_CLOCK` where the channel was not sampled at the rig's trigger edges: a run then has its times in a
    column of their own (`time_column`). `clock_u_s` is how well they are known on the rig's time axis (standard
    uncertainty), before an offset is fitted; None for nothing better than a quarter of the drive's period.
    """

    unit: str = ""
    kind: str = ""
    noise_rms: float | None = None
    full_scale: float | None = None
    latency_s: float | None = None
    clock: str | None = None
    clock_u_s: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LaserInfo:
    """Geometry of one displacement head.

    `face` is the outward normal, in the cube's frame C, of the face it looks at (x y z -x -y -z); None when
    it is given run by run in a condition such as `laser_1_face`.
    """

    face: str | None = None
    tilt_deg: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class TableSpec:
    """What a `table` recording asks: `response` as the expression `baseline` over columns and parameters.

    `sigma` names the column of standard uncertainties, in the response's unit; `batch` columns whose readings share
    an unknown offset where they share a value, nested in this order. `constants` are names in the baseline that are
    neither columns nor parameters.
    """

    response: str
    baseline: str
    start: Mapping[str, float] = field(default_factory=dict)
    order: str | None = None
    block: str | None = None
    sigma: str | None = None
    batch: Sequence[str] = ()
    constants: TableConstants = field(default_factory=dict)


@dataclass(frozen=True)
class Header:
    """What holds for a whole recording.

    `started` is UTC, ISO 8601; "" when unknown. `rig_toml` is the rig file as run without its simulated
    world, of which only the hash is kept. `constants` carry their unit in their name. `extra` is JSON; its
    keys `table`, `patterns` (columns of patterns.csv) and `plugins` (see `parts`) have a meaning of their own.
    """

    experiment: str
    title: str = ""
    started: str = ""
    rig_toml: str | None = None
    campaign_toml: str | None = None
    world_sha256: str | None = None
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    channels: Mapping[str, ChannelInfo] = field(default_factory=dict)
    lasers: Mapping[str, LaserInfo] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def table(self) -> TableSpec | None:
        """The question of a `table` recording; None in any other."""
        spec = self.extra.get("table")
        if spec is None:
            return None
        constants = {name: TableConstant(**stated) for name, stated in spec.get("constants", {}).items()}
        return TableSpec(**{**spec, "constants": constants})

    def with_constants(self, constants: TableConstants) -> Header:
        """The same with these constants in the baseline of its table; `DataError` for some that cannot be."""
        table = self.extra.get("table")
        if table is None:
            raise DataError(
                f"a {self.experiment} recording has no baseline that constants could be in; leave them out"
            )
        if flaw := flaw_of_constants(constants):
            keys, why = flaw
            raise DataError(f"{'.'.join(('constants', *keys))} {why}")
        stated = {name: constant.as_json() for name, constant in constants.items()}
        return replace(self, extra={**self.extra, "table": {**table, "constants": stated}})


@dataclass(frozen=True)
class RunRecord:
    """One acquisition at fixed set-points, without its samples.

    `conditions` hold the columns of runs.csv but `run_id`, `valid` and `reason`; a missing number is NaN, a
    missing text is "". `reason` says why a run is invalid, or what was remarked about a valid one. `state`
    is `finished`, `interrupted` or, while a campaign is at it, `acquiring`.
    """

    run_id: str
    key: str
    step: str
    conditions: Mapping[str, Any]
    valid: bool = True
    reason: str = ""
    state: str = "finished"


@dataclass(frozen=True)
class ImportReport:
    """What was found while reading a bundle: nothing in it stopped the reading.

    `invalid` are run_ids, or rows of a table ("row 7"), that count in no result, and why.
    """

    runs: int
    invalid: tuple[tuple[str, str], ...] = ()
    warnings: tuple[str, ...] = ()


class RunSource(Protocol):
    """Anything that holds a recording's runs."""

    @property
    def header(self) -> Header:
        """What holds for all runs."""

    def runs(self, *, valid_only: bool = False) -> list[RunRecord]:
        """The finished runs in order."""

    def run(self, run_id: str) -> RunRecord | None:
        """One of them, by a look-up; None where there is no such run."""

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        """The columns of one run, each of shape (samples,)."""


def why_none(source: RunSource, left_out: Mapping[str, str]) -> str:
    """Why no run can be used, by the first that cannot: left out of the valid ones, by run_id, or invalid itself."""
    invalid = {record.run_id: record.reason for record in source.runs() if not record.valid}
    for run_id, reason in {**left_out, **invalid}.items():
        return f"run {run_id}: {reason.removeprefix(f'run {run_id}: ') or 'it is marked invalid'}"
    return "there is no run; measure some, and of a study of draws look at `rigctl result`"


@dataclass(frozen=True)
class Recording:
    """A recording in memory; `columns` maps a run_id to its samples."""

    header: Header
    records: Sequence[RunRecord]
    columns: Mapping[str, Mapping[str, FloatArray]]
    report: ImportReport

    def runs(self, *, valid_only: bool = False) -> list[RunRecord]:
        """The runs in order."""
        return [record for record in self.records if record.valid or not valid_only]

    def run(self, run_id: str) -> RunRecord | None:
        """One of them; None where there is no such run."""
        return self._by_id.get(run_id)

    @cached_property
    def _by_id(self) -> Mapping[str, RunRecord]:
        return {record.run_id: record for record in self.records}

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        """The columns of one run, each of shape (samples,); `DataError` for an unknown run."""
        if run_id not in self.columns:
            raise DataError(f"no run {run_id} in this recording")
        return dict(self.columns[run_id])


def time_column(channel: str) -> str:
    """The column of times of a channel that has a clock of its own."""
    return f"{channel}.t_s"


def own_clocks(header: Header) -> tuple[str, ...]:
    """The channels that have a clock of their own."""
    return tuple(name for name, channel in header.channels.items() if channel.clock == OWN_CLOCK)


def on_rig_time(samples: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The columns of a run that were sampled at the times `t_s`: those without a clock of their own."""
    own = {name for channel in samples if (time := time_column(channel)) in samples for name in (channel, time)}
    return {name: column for name, column in samples.items() if name not in own}


def flaw_of_run_id(run_id: str) -> str | None:
    """Why `run_id` cannot name a run, and so a file; None when it can."""
    if not run_id or run_id != run_id.strip():
        return "is empty or begins or ends with a space"
    if run_id in {".", ".."} or any(c in run_id for c in "/\\") or not run_id.isprintable():
        return "cannot name a file"
    # File systems count bytes, 255 at most; the suffixes need some of them.
    if len(run_id.encode()) > MAX_RUN_ID_BYTES:
        return f"is longer than {MAX_RUN_ID_BYTES} bytes"
    return None


def flaw_of_column(name: str) -> str | None:
    """Why `name` cannot name a column of samples; None when it can."""
    if not name or name != name.strip() or not name.isprintable():
        return "is empty, or has spaces at its ends or unprintable characters"
    return None
