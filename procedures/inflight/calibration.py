"""In-flight calibration of a differential accelerometer: ten sessions of an inertially pointed, drag-free satellite.

The sessions are those of Hardy et al., "Validation of the in-flight calibration procedures for the MICROSCOPE space
mission" (arXiv 1707.07630). Each looks at one parameter; k2c takes two runs, one for each mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from procedures.inflight.bench import Flight
from procedures.inflight.tables import Calibration
from procedures.inflight.telemetry import OnGrid, flaw_of, gap, on_grid, require_possible
from rigctl.campaign.session.recovery import Apparatus
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, LimitError
from rigctl.core.interfaces import Channel
from rigctl.core.satellites import FlightSession
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE

LINE_WIDTHS = 0.9
"""A stimulus is at least so many inverse durations away from a line of the orbit."""
ORBITAL_LINES = 12


def check(flight: Flight, calibration: Calibration) -> list[str]:
    """Remarks on the sessions; `ConfigError`, `LimitError` for one that cannot be."""
    remarks = []
    for name in calibration.sessions:
        session = calibration.session(name, flight.orbit_period_s)
        try:
            flight.satellite.check(session)
        except LimitError as error:
            raise LimitError(f"session {name}: {error}") from None
        remarks.extend(_remarks(name, session, flight.orbit_period_s))
    return remarks


def _remarks(name: str, session: FlightSession, orbit_period_s: float) -> list[str]:
    stimulus = session.stimulus
    if stimulus.target == "none":
        return []
    cycles = stimulus.frequency_hz * session.duration_s
    per_orbit = stimulus.frequency_hz * orbit_period_s
    # In inverse durations: that is how wide a line is.
    away = abs(per_orbit - round(per_orbit)) * session.duration_s / orbit_period_s
    if cycles < 1.0:
        raise ConfigError(
            f"session {name}: {session.duration_s:g} s is less than one period of its stimulus; record longer"
        )
    if away < LINE_WIDTHS and round(per_orbit) <= ORBITAL_LINES:
        raise ConfigError(
            f"session {name}: {stimulus.frequency_hz:g} Hz is a line of the orbit ({round(per_orbit)} f_orb); "
            f"go at least {LINE_WIDTHS / session.duration_s:.2g} Hz away from it"
        )
    if abs(cycles - round(cycles)) > 1e-3:
        return [
            f"session {name}: {cycles:.3f} periods of the stimulus are no whole number; its line leaks into others"
        ]
    return []


def calibrate(session: Session, flight: Flight, calibration: Calibration) -> None:
    """One run per session; everything is in the session's store."""
    for remark in check(flight, calibration):
        session.event("remark", text=remark)
    for name in calibration.sessions:
        with session.step(f"session {name}"):
            asked = calibration.session(name, flight.orbit_period_s)
            conditions = calibration.conditions(name, flight.satellite.sample_period_s)
            measure = _Recording(session, flight, asked, name in EQUIVALENCE).measure
            session.acquire(name, conditions, measure, Apparatus(others=(flight.satellite,)))


@dataclass(frozen=True)
class _Recording:
    """One session, from telecommand to the last sample."""

    session: Session
    flight: Flight
    asked: FlightSession
    tests_equivalence: bool

    def measure(self, writer: RunWriter) -> Mapping[str, Any]:
        """Record orbit by orbit; a run whose loop does not hold is ended there, and not valid."""
        satellite = self.flight.satellite
        channels = satellite.channels()
        start_s = satellite.begin(self.asked)
        self.session.wait_s(start_s - self.session.clock.now_s())
        period_s = satellite.sample_period_s
        samples, got = round(self.asked.duration_s / period_s), 0
        # An orbit of patience after its end; what has not come down by then is lost.
        over_s = start_s + self.asked.duration_s + self.flight.orbit_period_s
        while got < samples:
            self.session.checkpoint()
            left_s = (samples - got) * period_s
            self.session.wait_s(min(left_s, self.flight.orbit_period_s))
            rows = on_grid(satellite.name, satellite.fetch(), got, samples, period_s)
            # Before a row is written: the run is an attempt then, and is flown again.
            require_possible(satellite.name, rows.came, channels, got)
            if flaw := flaw_of(rows.came, channels):
                # What shows that the loop did not hold is kept, although the run is not valid.
                self._write(writer, channels, rows.all)
                return {"start_s": start_s, "valid": False, "reason": flaw}
            # What never came is a gap: the analysis takes missing samples as they are.
            if not len(rows.all) and self.session.clock.now_s() > over_s:
                rows = OnGrid(rows.came, gap(got, samples, period_s, len(channels)))
            self._write(writer, channels, rows.all)
            if len(rows.all) > len(rows.came):
                self.session.event("gap", sample=got, samples=len(rows.all) - len(rows.came))
            got += len(rows.all)
        return {"start_s": start_s}

    def _write(self, writer: RunWriter, channels: tuple[Channel, ...], rows: FloatArray) -> None:
        # Only the test of the equivalence principle needs gravity itself; elsewhere it would be one covariate more.
        kept = {name: place for place, name in enumerate(each.name for each in channels)}
        writer.stream(
            {n: rows[:, p] for n, p in kept.items() if self.tests_equivalence or channels[p].kind != "gravity"}
        )
