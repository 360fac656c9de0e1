"""The noise of a channel of a store, or of a column of a CSV file: read, cut to a stretch without gaps, described."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rigctl.analysis.stability.allan import ONE_SIGMA, AllanFamily, allan_family
from rigctl.analysis.stability.coefficients import Coefficient, Floor, coefficients, floor
from rigctl.analysis.stability.density import EVERYWHERE, Density, density
from rigctl.campaign.bundle.csv_table import decode
from rigctl.campaign.bundle.place import Place
from rigctl.campaign.bundle.sample_file import read_csv
from rigctl.campaign.recording import ChannelInfo, RunSource, on_rig_time, own_clocks, time_column
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.bounds import RUN_TEXT_BYTES, NoFile, TooLarge, amount, read_regular
from rigctl.core.errors import ConfigError, DataError, either
from rigctl.core.units import unit_of_column

TIME = "t_s"
_GAP = 1.5
"""Periods from one sample to the next beyond which one is missing."""
_UNEVEN = 0.25
"""Periods by which samples may scatter about even spacing."""


@dataclass(frozen=True, eq=False)
class Series:
    """Evenly spaced samples without gaps; `run` is "" for a file, `remarks` say what was left out."""

    source: str
    run: str
    channel: str
    unit: str
    kind: str
    samples: FloatArray
    rate_hz: float
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class NoiseStudy:
    """The noise of one series. `density` is None, with a remark, for a record too short or without noise."""

    series: Series
    confidence: float
    family: AllanFamily
    floor: Floor
    density: Density | None
    coefficients: tuple[Coefficient, ...]


def noise_study(
    series: Series,
    *,
    confidence: float = ONE_SIGMA,
    taus: str = "octave",
    band_hz: tuple[float, float] = EVERYWHERE,
    without_lines: bool = False,
) -> NoiseStudy:
    """Everything about a series; the density is fitted within `band_hz`.

    `without_lines` takes steady sines out before the Allan family. `DataError` for a record too short for one,
    `ConfigError` for a band without enough of the density in it.
    """
    remarks = list(series.remarks)
    try:
        found = density(series.samples, series.rate_hz, band_hz)
    except DataError as error:
        found = None
        remarks.append(f"no spectral density: {error}")
    samples = series.samples
    if found is not None and found.lines:
        remarks.append(_about_lines(found, series, without_lines))
        samples = found.rest if without_lines else samples
    family = allan_family(samples, series.rate_hz, confidence=confidence, taus=taus)
    told = () if found is None else coefficients(found.terms, series.kind, series.unit)
    described = replace(series, remarks=tuple(remarks))
    return NoiseStudy(described, confidence, family, floor(family.allan), found, told)


def _about_lines(found: Density, series: Series, without_lines: bool) -> str:
    share = sum(line.amplitude**2 for line in found.lines) / 2.0 / float(np.var(series.samples))
    part = f"{len(found.lines)} steady lines, {100.0 * min(share, 1.0):.3g} % of the variance"
    return f"{part}, taken out" if without_lines else f"{part}, are in the deviations; --without-lines takes them out"


def store_series(path: Path, runs: Sequence[str] = (), channels: Sequence[str] = ()) -> Iterator[Series]:
    """Channels of runs of a store: of the longest valid run where none is named, all of instruments that vary.

    `DataError` for a run or a channel that is not there.
    """
    with Store.open(path, readonly=True) as store:
        for run in runs or [_longest(store, path)]:
            yield from _run_series(store, path, run, channels)


def csv_series(
    path: Path, channels: Sequence[str] = (), rate_hz: float | None = None, time: str | None = None
) -> Iterator[Series]:
    """The columns of a CSV file, all that vary where none is named, at `rate_hz` or the times of a column (`t_s`).

    `DataError` for a file that cannot be read, `ConfigError` where nothing tells the sample rate.
    """
    try:
        data = read_regular(path, RUN_TEXT_BYTES)
    except NoFile as error:
        raise DataError(f"{path}: {error}") from error
    except TooLarge as error:
        raise DataError(f"{path}: larger than {amount(RUN_TEXT_BYTES)}; split it, or import it as .npz") from error
    if rate_hz is not None and rate_hz <= 0.0:
        raise ConfigError(f"--rate {rate_hz:g} is no sample rate; write samples per second")
    place = Place(str(path))
    text = decode(place, data)
    del data
    columns = read_csv(place, text)
    time = time or (TIME if TIME in columns and rate_hz is None else None)
    if (rate_hz is None) == (time is None):
        raise ConfigError(f"{path}: how are samples spaced? pass --rate HZ, or --time COLUMN: {either(columns)}")
    for name in (*channels, *([time] if time else [])):
        if name not in columns:
            raise DataError(f"{path}: no column {name}; there are {', '.join(columns)}")
    times = {} if time is None else dict.fromkeys(columns, columns[time])
    signals = {name: column for name, column in columns.items() if name not in (time, TIME)}
    told = {name: ChannelInfo(unit_of_column(name)) for name in columns}
    yield from _series(str(path), "", signals, times, told, channels, rate_hz)


def _longest(store: RunSource, path: Path) -> str:
    lengths = {
        record.run_id: max(map(len, store.samples(record.run_id).values()), default=0)
        for record in store.runs(valid_only=True)
    }
    if not lengths:
        raise DataError(f"{path}: no valid runs in it; there is nothing to describe")
    return max(lengths, key=lengths.__getitem__)


def _run_series(store: RunSource, path: Path, run: str, channels: Sequence[str]) -> Iterator[Series]:
    samples = store.samples(run)
    if TIME not in samples:
        raise DataError(f"{path}, run {run}: no times in it ({TIME}); a table of readings has no noise in time")
    own = [name for name in own_clocks(store.header) if time_column(name) in samples]
    signals = {name: samples[name] for name in (*on_rig_time(samples), *own) if name != TIME}
    for name in channels:
        if name not in signals:
            raise DataError(f"{path}, run {run}: no channel {name}; there are {', '.join(signals)}")
    times = {name: samples.get(time_column(name), samples[TIME]) for name in signals}
    told = {name: store.header.channels.get(name) or ChannelInfo(unit_of_column(name)) for name in signals}
    # The instruments' channels rather than what goes with them (angles, flags), where the store says which these are.
    declared = [name for name in signals if name in store.header.channels and _varies(signals[name])]
    yield from _series(str(path), run, signals, times, told, channels or declared, None)


def _series(
    source: str,
    run: str,
    signals: Mapping[str, FloatArray],
    times: Mapping[str, FloatArray],
    told: Mapping[str, ChannelInfo],
    channels: Sequence[str],
    rate_hz: float | None,
) -> Iterator[Series]:
    where = f"{source}, run {run}" if run else source
    # Without a choice, what never changes (a flag, a set-point) is no signal.
    chosen = channels or [name for name, column in signals.items() if _varies(column)]
    if not chosen:
        raise DataError(f"{where}: no column in it varies; there is no noise to describe")
    for name in chosen:
        place, column, time_s = f"{where}, {name}", signals[name], times.get(name)
        if time_s is not None and time_s.size != column.size:
            # A run that was cut off: what came of one and not of the other is no sample.
            column, time_s = column[: time_s.size], time_s[: column.size]
        samples, rate, remarks = _even(place, column, time_s, rate_hz)
        unit = told[name].unit or unit_of_column(name)
        yield Series(source, run, name, unit, told[name].kind, samples, rate, remarks)


def _varies(column: FloatArray) -> bool:
    known = column[np.isfinite(column)]
    return bool(known.size and np.any(known != known[0]))


def _even(
    place: str, column: FloatArray, time_s: FloatArray | None, rate_hz: float | None
) -> tuple[FloatArray, float, tuple[str, ...]]:
    """The longest stretch without gaps, its rate, and a remark when it is not the whole."""
    breaks = np.flatnonzero(np.isfinite(column[1:]) != np.isfinite(column[:-1])) + 1
    if time_s is not None:
        steps = _steps(place, time_s)
        breaks = np.union1d(breaks, np.flatnonzero(steps > _GAP * np.median(steps)) + 1)
    edges = np.concatenate([[0], breaks, [column.size]])
    lengths = np.where(np.isfinite(column[edges[:-1]]), np.diff(edges), 0) if column.size else np.zeros(1, int)
    longest = int(np.argmax(lengths))
    start, stop = int(edges[longest]), int(edges[longest] + lengths[longest])
    if stop - start < 2:
        raise DataError(f"{place}: no two samples in a row; there is no noise to describe")
    if time_s is not None:
        rate_hz = _rate(place, time_s[start:stop])
    assert rate_hz is not None
    remarks: tuple[str, ...] = ()
    if stop - start < column.size:
        remarks = (
            f"the longest stretch without gaps: {stop - start} of {column.size} samples, from sample {start + 1}",
        )
    return column[start:stop], rate_hz, remarks


def _steps(place: str, time_s: FloatArray) -> FloatArray:
    if not np.isfinite(time_s).all():
        raise DataError(
            f"{place}: sample {int(np.argmin(np.isfinite(time_s))) + 1} has no time; write the time of every sample"
        )
    steps = np.diff(time_s)
    if steps.size and steps.min() <= 0.0:
        raise DataError(
            f"{place}: time does not go on at sample {int(np.argmax(steps <= 0.0)) + 2}; sort the samples"
        )
    return steps


def _rate(place: str, time_s: FloatArray) -> float:
    """Of a stretch without gaps; `DataError` where samples are not evenly spaced."""
    period_s = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    off = float(np.abs(np.diff(time_s) - period_s).max()) / period_s
    if off > _UNEVEN:
        raise DataError(f"{place}: samples are not evenly spaced (up to {off:.2g} periods off); resample them")
    return 1.0 / period_s
