"""Satellites with an accelerometer: what a calibration in flight may ask of one, flown or simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from rigctl.core.arrays import FloatArray
from rigctl.core.interfaces import Channel, Instrument


@dataclass(frozen=True)
class Stimulus:
    """`amplitude` cos(2 pi `frequency_hz` t + `phase_rad`), t = 0 at the perigee at which a session begins.

    `drag-free`: the common acceleration that control is to make [m/s2]. `attitude`: an angle taken from what the star
    tracker says [rad]. `masses`: the growth of the off-centring along the masses' own axis, half by each, and
    `mass-1`, `mass-2`: the displacement of one [m].
    """

    target: Literal["none", "drag-free", "attitude", "masses", "mass-1", "mass-2"] = "none"
    axis: Literal["x", "y", "z"] = "x"
    amplitude: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0


@dataclass(frozen=True)
class FlightSession:
    """What a satellite is told to do; `hold` is what drag-free control keeps at rest: a mass, or the mean of both."""

    duration_s: float
    stimulus: Stimulus = Stimulus()
    hold: Literal["both", "mass-1", "mass-2"] = "both"
    spin_hz: float = 0.0
    """Turns about Y against the motion in orbit; 0 where pointing is inertial."""


@runtime_checkable
class DragFreeSatellite(Instrument, Protocol):
    """A satellite with a differential accelerometer, by its ground segment."""

    @property
    def sample_period_s(self) -> float:
        """Between two rows of telemetry."""

    def channels(self) -> tuple[Channel, ...]:
        """The columns `fetch` delivers, in order; `t_s`, since perigee, is the first."""

    def check(self, session: FlightSession) -> None:
        """`LimitError` for a session that is beyond the satellite's limits; sends nothing."""

    def begin(self, session: FlightSession) -> float:
        """Have a session carried out from a perigee to come; returns the rig time of that. Ends the one before."""

    def fetch(self) -> FloatArray:
        """The rows that came down since the last call, shape (n, channels), n may be 0; NaN where some are lost."""


class SatelliteEnsemble(Protocol):
    """Simulated satellites that differ as instruments do, by number; several are flown at once. Can be pickled."""

    at_once: int
    """As many as are flown in about the time of one."""
    sample_period_s: float
    columns: tuple[str, ...]
    complete: bool
    """Whether every sample comes down."""

    def telemetry(self, draws: Sequence[int], run: int, session: FlightSession, chunk: int) -> Iterator[FloatArray]:
        """A session of some draws, shape (samples, columns, draws), `chunk` samples at a time, the last ones fewer.

        `run` is the key of its randomness beside the draw's number: what comes does not depend on the other draws.
        A chunk is there until the next is asked for: all may be in the same memory.
        """

    def truths(self, draw: int) -> Mapping[str, Mapping[str, float]]:
        """What a calibration should find: parameters by name, of `exact_truth` and `paper_truth`."""
