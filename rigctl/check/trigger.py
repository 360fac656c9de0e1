"""Ten edges of the pacing instrument, counted at every recorder, and how long after an edge each has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rigctl.check.asking import Tell
from rigctl.core.clock import Clock
from rigctl.core.errors import RigError
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.interfaces import CountsEdges, FreeRecorder, PacedRecorder, PacingRecorder
from rigctl.rig import Rig

EDGES = 10
PERIOD_S = 0.1
"""Of the wall clock: slow enough for every recorder, and to be watched while they come."""
LOOK_EVERY_S = 0.002
AFTER_S = 0.5
WIRING = "docs/wiring.md"


@dataclass
class _Watched:
    """When each edge was seen at a recorder: not before the first time, not after the second [rig s]."""

    recorder: CountsEdges
    seen: int = 0
    looked_s: float = -math.inf
    bounds_s: list[tuple[float, float]] = field(default_factory=list)

    def look(self, clock: Clock) -> None:
        """Ask once."""
        asked_s = clock.now_s()
        seen = self.recorder.edges_seen()
        answered_s = clock.now_s()
        self.bounds_s += [(self.looked_s, answered_s)] * (seen - self.seen)
        self.seen, self.looked_s = max(seen, self.seen), asked_s


def try_trigger(rig: Rig, tell: Tell) -> None:
    """Have the readout give its edges; a finding for each recorder."""
    pacing = [each for each in rig.by_role("readout") if isinstance(each, PacingRecorder)]
    recorders = [
        each
        for name, each in rig.instruments.items()
        if isinstance(each, PacedRecorder | FreeRecorder) and rig.file.instruments[name].role != "spare"
    ]
    if len(pacing) != 1 or not recorders:
        tell("", unknown("trigger", "edges", "no instrument gives edges that others follow", f"{WIRING}"))
        return
    Edges(rig.clock, pacing[0], recorders, tell).count()


class Edges:
    """One train, and who has recorded it."""

    def __init__(
        self, clock: Clock, readout: PacingRecorder, recorders: Sequence[PacedRecorder | FreeRecorder], tell: Tell
    ) -> None:
        self._clock = clock
        self._readout = readout
        self._recorders = recorders
        self._tell = tell
        # On a clock that is speeded up edges would come too fast to be watched.
        self._speed = max(clock.speed, 1.0) if math.isfinite(clock.speed) else 1.0
        self._period_s = PERIOD_S * self._speed

    def count(self) -> None:
        """Arm all, give the train, and say of each what it has of it."""
        armed = [each for each in self._recorders if self._armed(each)]
        watched = {each.name: _Watched(each) for each in armed if isinstance(each, CountsEdges)}
        for one in watched.values():
            one.looked_s = self._clock.now_s()
        try:
            start_s = self._readout.start(EDGES, self._period_s)
            first_s = start_s + self._readout.first_sample_after_s
            self._watch(list(watched.values()), first_s + EDGES * self._period_s + AFTER_S)
            readings = len(self._readout.fetch())
        except RigError as error:
            self._tell(self._readout.name, _failed(error))
            return
        told = f"{readings} of {EDGES} readings, {1e3 * self._period_s / self._speed:g} ms apart"
        mend = "was it stopped at its panel?"
        whole = readings == EDGES
        self._tell(
            self._readout.name, ok("trigger", "pace", told) if whole else differs("trigger", "pace", told, mend)
        )
        for each in armed:
            self._tell(each.name, self._collected(each, watched.get(each.name), first_s))

    def _armed(self, recorder: PacedRecorder | FreeRecorder) -> bool:
        try:
            if isinstance(recorder, FreeRecorder):
                recorder.prepare(EDGES, self._period_s)
                recorder.begin()
            else:
                recorder.arm(EDGES, self._period_s)
        except RigError as error:
            self._tell(recorder.name, _failed(error))
            return False
        return True

    def _watch(self, watched: Sequence[_Watched], until_s: float) -> None:
        while self._clock.now_s() < until_s:
            for each in watched:
                each.look(self._clock)
            self._clock.sleep_s(LOOK_EVERY_S * self._speed)

    def _collected(self, recorder: PacedRecorder | FreeRecorder, watched: _Watched | None, first_s: float) -> Finding:
        try:
            if isinstance(recorder, FreeRecorder):
                own = recorder.finish()
                known = f"its first value known to {1e3 * own.start_u_s:.2g} ms"
                return ok("trigger", "edges", f"on its own clock: {len(own.values)} values, {known}")
            rows = recorder.collect()
        except RigError as error:
            return _failed(error)
        delay = self._delay(watched, first_s) if watched else "when, tells a motion: --trigger --move"
        return ok("trigger", "edges", f"{len(rows)} of {EDGES}; {delay}")

    def _delay(self, watched: _Watched, first_s: float) -> str:
        """How long after the readout's time of an edge it was counted; one delay for all, if there is one."""
        due_s = [first_s + number * self._period_s for number in range(EDGES)]
        pairs = list(zip(watched.bounds_s, due_s, strict=False))
        low_s = max(low - due for (low, _), due in pairs)
        high_s = min(high - due for (_, high), due in pairs)
        width_s = sum(high - low for low, high in watched.bounds_s) / len(watched.bounds_s)
        looks = f"looked at every {1e3 * width_s:.2g} ms"
        if low_s <= high_s:
            return f"counted {1e3 * low_s:.2g} to {1e3 * high_s:.2g} ms after it, no jitter seen ({looks})"
        # No one delay explains all: it differs between edges by this at least.
        return (
            f"counted {1e3 * high_s:.2g} to {1e3 * low_s:.2g} ms after it, jitter {1e3 * (low_s - high_s):.2g} ms "
            f"at least ({looks})"
        )


def _failed(error: RigError) -> Finding:
    what, _, mend = str(error).rpartition("; ")
    return differs("trigger", "edges", what or mend, f"{mend}; see {WIRING}")
