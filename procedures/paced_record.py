"""A record that one meter paces and others follow, streamed into a run while it comes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.pace import Pace
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import FloatArray
from rigctl.core.interfaces import PacedRecorder, PacingRecorder


def record(
    session: Session,
    writer: RunWriter,
    readout: PacingRecorder,
    followers: Sequence[PacedRecorder],
    samples: int,
    period_s: float,
) -> tuple[float, dict[str, FloatArray]]:
    """When the record began [rig s], and every column but `t_s`, shape (samples,) each.

    `InstrumentError` when samples come at another pace than they were asked for.
    """
    # First all that follow, then the meter that paces: its first edge must find them armed.
    for follower in followers:
        follower.arm(samples, period_s)
    start_s = readout.start(samples, period_s)
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
    for follower in followers:
        values = follower.collect()
        followed |= {channel.name: values[:, i] for i, channel in enumerate(follower.channels())}
    writer.stream(followed)
    return start_s, {name: np.concatenate(parts), **followed}
