"""One run as it was recorded: its conditions, its samples channel by channel, and a spectrum."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.analysis.density import amplitude_density
from rigctl.campaign.recording import ChannelInfo
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.report.picture import Line, Picture
from rigctl.report.quantities import number
from rigctl.report.shown import RecordedRun
from rigctl.workbench.study import Observations
from rigctl.workbench.workbench import Workbench

SAMPLES = 200_000
"""So many of the last samples are read: a run of hours would fill the memory of what draws it."""

DRAWN = 4000
"""Stretches of a channel of which the least and the greatest value are kept: ten for each column of a terminal."""

TIME = "t_s"


def recorded_run(workbench: Workbench, run_id: str) -> RecordedRun:
    """A run of the store, or what its study takes for one, such as a row of a table; `DataError` for neither."""
    store = workbench.store
    record = store.run(run_id)
    if record is None:
        return _datum(workbench.study.model(workbench.current.terms).observations, run_id)
    facts = [f"{name} {_said(value)}" for name, value in record.conditions.items() if _said(value)]
    return RecordedRun(
        run_id,
        tuple([record.step] * bool(record.step) + facts),
        tuple(pictures_of(store.last_samples(run_id, SAMPLES), store.header.channels)),
        record.valid,
        record.reason,
    )


def _datum(given: Observations, run_id: str) -> RecordedRun:
    if run_id not in given.run_ids:
        raise DataError(f"no run {run_id} in this store")
    run = given.run_ids.index(run_id)
    data = np.flatnonzero(given.run_of == run)
    measured = [
        f"{series.channel} {series.component}".strip()
        + f" {number(float(given.value[at]), 6)} {series.unit}".rstrip()
        for at in data
        for series in [given.series[given.series_of[at]]]
    ]
    facts = []
    for name, values in given.covariates.items():
        value = values[run]
        if np.isfinite(value):
            facts.append(f"{name} {given.levels[name][int(value)] if name in given.levels else number(value, 6)}")
    return RecordedRun(run_id, (*measured, *facts), (), can_be_marked=False)


def pictures_of(samples: Mapping[str, FloatArray], channels: Mapping[str, ChannelInfo]) -> list[Picture]:
    """Channels of one kind and unit together against the time, then the spectrum of the first accelerometer."""
    t_s = samples.get(TIME)
    # As a bundle, channels that nobody has described stand alone.
    groups: dict[tuple[str, str], list[str]] = {}
    for name, channel in channels.items():
        if name in samples and channel.kind not in {"time", "flag"}:
            groups.setdefault((channel.kind or name, channel.unit), []).append(name)
    found = []
    for (kind, unit), names in groups.items():
        lines = [
            Line(*extremes(_axis(t_s, samples[name]), samples[name]), name if len(names) > 1 else "", colour=place)
            for place, name in enumerate(names)
        ]
        title = " / ".join(filter(None, (kind if len(names) > 1 else names[0], unit)))
        found.append(Picture(title, tuple(lines), "sample" if t_s is None else "t / s"))
    sensors = [name for name in samples if name in channels and channels[name].kind == "accelerometer"]
    if sensors and t_s is not None and len(t_s) > 1:
        unit = channels[sensors[0]].unit
        rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
        line = Line(*amplitude_density(samples[sensors[0]], rate_hz))
        found.append(Picture(f"{sensors[0]} / ({unit}/√Hz)", (line,), "f / Hz", x_scale="log", y_scale="log"))
    return found


def extremes(x: FloatArray, y: FloatArray, stretches: int = DRAWN) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest of each of so many stretches, in the order in which they came; all of fewer."""
    size = -(-len(y) // stretches)
    if size < 3:
        return x, y
    rows = np.resize(y, (-(-len(y) // size), size))
    # What fills the last stretch up is one of its own values.
    rows[-1, len(y) - size * (len(rows) - 1) :] = y[-1]
    known = np.isfinite(rows)
    places = np.stack(
        [np.argmin(np.where(known, rows, np.inf), axis=1), np.argmax(np.where(known, rows, -np.inf), axis=1)], axis=1
    )
    places = np.minimum(np.sort(places, axis=1) + size * np.arange(len(rows))[:, None], len(y) - 1).ravel()
    return x[places], y[places]


def _axis(t_s: FloatArray | None, values: FloatArray) -> FloatArray:
    return t_s if t_s is not None and len(t_s) == len(values) else np.arange(len(values), dtype=np.float64)


def _said(value: object) -> str:
    if isinstance(value, float):
        return number(value, 6) if np.isfinite(value) else ""
    return str(value)
