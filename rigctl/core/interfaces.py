"""What a procedure may ask of an instrument.

Units are in the names: degrees for angles, millimetres for positions, as on the instruments' panels; times
are rig seconds. All calls raise `rigctl.core.errors.LinkError` when the wire fails and
`rigctl.core.errors.InstrumentError` when the instrument refuses; set-points outside the limits raise
`rigctl.core.errors.LimitError` before a byte is sent. `stop` may be called at any time from any thread, any
number of times; a blocked motion then raises `rigctl.core.errors.MotionStopped`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from rigctl.core.findings import Finding
from rigctl.core.limits import LinearLimits, RotationLimits

if TYPE_CHECKING:
    from rigctl.core.arrays import FloatArray


@dataclass(frozen=True)
class Identity:
    """Who answered: as the instrument says it."""

    model: str
    serial: str
    firmware: str
    text: str


@dataclass(frozen=True)
class Reading:
    """A value with its unit and the rig time it was taken; NaN when the instrument has no valid value."""

    value: float
    unit: str
    time_s: float


@runtime_checkable
class Instrument(Protocol):
    """Anything with a wire. The constructor touches nothing: `open` connects, `close` ends."""

    name: str

    def open(self) -> None:
        """Connect and check that the right model answers; `WrongInstrument` otherwise. Moves nothing."""

    def close(self) -> None:
        """Disconnect; may be called twice."""

    def identify(self) -> Identity:
        """Ask the instrument who it is."""

    def confirm_in_step(self) -> None:
        """Make sure that no reply is outstanding or surplus on any connection.

        Looks for unread bytes, asks one question whose reply cannot be mistaken, looks again. Raises `OutOfStep`
        (after resynchronising) or another `LinkError`. Called before a run is called valid.
        """

    def stop(self) -> None:
        """Bring it to rest: motion halted, acquisition ended. Any thread, any time, any number of times.

        Connects if it is not connected, and returns only when the instrument has answered that it is at rest;
        raises `LinkError` or `InstrumentError` otherwise.
        """


@runtime_checkable
class Stage(Instrument, Protocol):
    """An axis that can be moved."""

    def home(self) -> None:
        """Enable it and find the reference, returns when done; only what is still to be done of it."""

    def is_homed(self) -> bool:
        """True when positions are referenced and the axis is ready to move."""

    def is_moving(self) -> bool:
        """True while the axis moves, whoever had it move."""

    def safety_stop(self) -> str:
        """Which safety device has stopped the axis, such as an emergency stop or a limit switch; "" for none.

        It says so until the axis is homed or enabled anew.
        """


@runtime_checkable
class RotationStage(Stage, Protocol):
    """A rotary axis."""

    limits: RotationLimits

    def move_to(self, angle_deg: float) -> None:
        """Move and return when the stage has arrived and settled (its own motion-done)."""

    def angle(self) -> Reading:
        """The encoder's angle now [deg]; may be called while a move blocks another thread."""


@runtime_checkable
class TimedRotationStage(RotationStage, Protocol):
    """A rotary axis that can be told how long a motion takes."""

    def turn_to(self, angle_deg: float, duration_s: float) -> None:
        """As `move_to`, the motion itself lasting `duration_s`; `LimitError` when that is too fast for its limits."""


@runtime_checkable
class LinearStage(Stage, Protocol):
    """A linear axis that can be moved and oscillated."""

    limits: LinearLimits

    def move_to(self, position_mm: float) -> None:
        """Move and return when arrived."""

    def oscillate(self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float) -> None:
        """Start a sinusoid about `centre_mm` that lasts at least `duration_s`; returns once it runs.

        `amplitude_mm` is half the peak-to-peak travel. The axis first goes where the motion starts.
        Replaces an oscillation that is running. Ends by itself after the duration, or with `rest`.
        """

    def rest(self) -> None:
        """End an oscillation smoothly and return when the axis stands still."""

    def position(self) -> Reading:
        """The encoder's position now [mm]."""


@dataclass(frozen=True)
class Learned:
    """What a motion has shown of an instrument: a key of the rig file, its value, and what was measured."""

    key: str
    value: str
    measured: str


@runtime_checkable
class LearnsByMoving(Protocol):
    """An instrument of which only motion tells how it understands a command."""

    def unknown_until_moved(self) -> tuple[str, ...]:
        """The keys of the rig file that are not known; sends no motion."""

    def learn_by_moving(self) -> tuple[Learned, ...]:
        """Find them out by a small motion that somebody watches; the docstring of the driver says how far it goes."""


@runtime_checkable
class Examinable(Protocol):
    """An instrument that can be asked for everything a campaign needs of it."""

    def examine(self) -> Iterator[Finding]:
        """Connect, and look at one thing after the other; goes on after what differs. Moves nothing.

        Whoever calls it closes the instrument. `LinkError` when nothing answers, `WrongInstrument` when another does.
        """


@dataclass(frozen=True)
class Channel:
    """One column of a run as an instrument delivers it.

    `clock_u_s` is None for a channel that is sampled at the rig's edges; of a `FreeRecorder` it is how well the rig
    time of its rows is known at least (standard uncertainty).
    """

    name: str
    unit: str
    kind: str
    latency_s: float = 0.0
    full_scale: float | None = None
    clock_u_s: float | None = None


@runtime_checkable
class Recorder(Protocol):
    """Records one row per trigger edge."""

    name: str

    def channels(self) -> tuple[Channel, ...]:
        """The columns a record has, in order."""

    def longest_record(self, period_s: float) -> int:
        """Most samples of one record at this period; `LimitError` when it is not that fast. Sends nothing."""


@runtime_checkable
class PacedRecorder(Recorder, Protocol):
    """Records one row per trigger edge that comes from outside."""

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart; `LimitError` if the memory cannot hold them."""

    def collect(self) -> FloatArray:
        """The recorded rows, shape (samples, channels), after the last edge; NaN where there was no value.

        Raises `EdgesMissing` when fewer edges than armed for have been recorded.
        """


@runtime_checkable
class CountsEdges(Protocol):
    """A paced recorder that tells at any time how many edges it has seen."""

    def edges_seen(self) -> int:
        """How many of those it is armed for have come; a question and no more."""


@runtime_checkable
class StreamedRecorder(PacedRecorder, Protocol):
    """Follows the trigger edges for as long as somebody fetches: its memory is no limit."""

    def follow(self, samples: int, period_s: float) -> None:
        """As `arm`, for a record that is fetched while it comes; `LimitError` beyond the instrument's longest."""

    def fetch(self) -> FloatArray:
        """The rows recorded since the last call, shape (n, channels), n may be 0; NaN where overloaded.

        Raises `InstrumentError` when rows were lost because nobody fetched them in time.
        """


@dataclass(frozen=True)
class OwnClockRecord:
    """Rows at equal steps of the instrument's own clock, which nothing ties to the rig's.

    `values` has the shape (rows, channels), NaN where there was no value. The first row was taken at `start_s`, rig
    time, known to the standard uncertainty `start_u_s`; `period_s` is the step in seconds of the instrument.
    """

    start_s: float
    start_u_s: float
    period_s: float
    values: FloatArray


@runtime_checkable
class FreeRecorder(Recorder, Protocol):
    """Records rows on its own clock, beside what others record on the trigger edges."""

    def prepare(self, samples: int, period_s: float) -> None:
        """Clear, and be ready to record while others take `samples` edges `period_s` apart; `LimitError` beyond it.

        Its own step is at most `period_s`.
        """

    def begin(self) -> None:
        """Start, soon before the first edge; returns once it records."""

    def finish(self) -> OwnClockRecord:
        """Stop, and what was recorded; called after the last edge.

        Raises `InstrumentError` when it has recorded for a shorter time than the edges came.
        """


@runtime_checkable
class PacingRecorder(Recorder, Protocol):
    """Records on its own sample timer and gives the trigger edges all the others record on."""

    @property
    def first_sample_after_s(self) -> float:
        """From the start to the first sample."""

    def start(self, samples: int, period_s: float) -> float:
        """Clear, start the train of edges, and return the rig time of the start."""

    def fetch(self) -> FloatArray:
        """The rows recorded since the last call, shape (n, channels), n may be 0; NaN where overloaded."""


@runtime_checkable
class DisplacementMeter(Instrument, Recorder, Protocol):
    """A controller with one or more displacement heads; it is a `PacedRecorder` or a `FreeRecorder` besides."""

    def displacements(self) -> tuple[Reading, ...]:
        """The value of each head now [mm], NaN when out of range or without a target."""


@runtime_checkable
class Voltmeter(Instrument, Protocol):
    """Single voltage readings."""

    def voltage(self) -> Reading:
        """One reading now [V]; NaN when overloaded."""


@runtime_checkable
class Thermometer(Instrument, Protocol):
    """Single temperature readings."""

    def temperature(self) -> Reading:
        """One reading now [degC]."""
