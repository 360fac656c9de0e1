"""A record that one meter paces and others follow, streamed into a run while it comes.

What records on a clock of its own runs beside it, from a little before to a little after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from procedures.pace import Pace
from rigctl.campaign.recording import time_column
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import InstrumentError
from rigctl.core.interfaces import FreeRecorder, PacedRecorder, PacingRecorder

SURELY = 3.0
"""Standard uncertainties within which a time is."""


def record(
    session: Session,
    writer: RunWriter,
    readout: PacingRecorder,
    followers: Sequence[PacedRecorder | FreeRecorder],
    samples: int,
    period_s: float,
) -> tuple[float, dict[str, FloatArray]]:
    """When the record began [rig s], and every column but `t_s`, shape (samples,) each.

    A channel on a clock of its own has its own number of samples and a `time_column`, of the same zero as `t_s`.
    `InstrumentError` when samples come at another pace than they were asked for.
    """
    free = [each for each in followers if isinstance(each, FreeRecorder)]
    paced = [each for each in followers if not isinstance(each, FreeRecorder)]
    # First all that follow, then the meter that paces: its first edge must find them armed.
    for follower in paced:
        follower.arm(samples, period_s)
    for recorder in free:
        recorder.prepare(samples, period_s)
    for recorder in free:
        recorder.begin()
    start_s = readout.start(samples, period_s)
    _require_prompt(readout, session.clock.now_s() - start_s, free)
    pace = Pace.of_record(session.clock, start_s, readout.first_sample_after_s, period_s, samples)
    name = readout.channels()[0].name
    parts: list[FloatArray] = []
    received = 0
    while received < samples:
        # Every second, so that a kill costs no more and an abort is heeded.
        session.wait_s(min(1.0, (samples - received) * period_s) + period_s)
        asked_s = session.clock.now_s()
        part = readout.fetch()[:, 0]
        pace.require(readout.name, received + len(part), asked_s, session.clock.now_s())
        if len(part):
            writer.stream({"t_s": period_s * np.arange(received, received + len(part), dtype=np.float64), name: part})
        received += len(part)
        parts.append(part)
    followed: dict[str, FloatArray] = {}
    # First what still records, and fills its memory.
    for recorder in free:
        followed |= _own_clock_columns(recorder, start_s + readout.first_sample_after_s, (samples - 1) * period_s)
    for follower in paced:
        values = follower.collect()
        followed |= {channel.name: values[:, i] for i, channel in enumerate(follower.channels())}
    writer.stream(followed)
    return start_s, {name: np.concatenate(parts), **followed}


def _require_prompt(readout: PacingRecorder, took_s: float, free: Sequence[FreeRecorder]) -> None:
    """The readout's record began within these seconds: beside what the others' clocks are known to, that is nothing.

    Uniform within, it adds a third of itself in quadrature.
    """
    for recorder in free:
        known_s = min(
            (each.clock_u_s for each in recorder.channels() if each.clock_u_s is not None), default=math.inf
        )
        if took_s > known_s:
            raise InstrumentError(
                f"{readout.name}: its start took {took_s:.2g} s to be answered, {recorder.name}'s times are to be "
                f"known to {known_s:g} s; use a faster line or a less busy computer, or raise start_u_s",
                instrument=readout.name,
            )


def _own_clock_columns(recorder: FreeRecorder, first_s: float, lasting_s: float) -> dict[str, FloatArray]:
    """Each channel and its times, counted from the rig's first sample at `first_s`, while the others record."""
    own = recorder.finish()
    # To the nanosecond: the difference of two late times has no more digits to be relied on.
    t_s = round(own.start_s - first_s, 9) + own.period_s * np.arange(len(own.values), dtype=np.float64)
    # Surely within, as far as it is known when it began.
    margin_s = SURELY * own.start_u_s
    within = (t_s >= margin_s) & (t_s <= lasting_s - margin_s)
    if not within.any():
        raise InstrumentError(
            f"{recorder.name}: it stored nothing while the others recorded; was it stopped?", instrument=recorder.name
        )
    columns: dict[str, FloatArray] = {}
    for index, channel in enumerate(recorder.channels()):
        columns |= {channel.name: own.values[within, index], time_column(channel.name): t_s[within]}
    return columns
