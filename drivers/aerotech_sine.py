"""OSCILLATE of an Ensemble: what its distance means, and how that is found out by a millimetre."""

from __future__ import annotations

from drivers.aerotech_axis import AsciiAxis
from drivers.aerotech_commands import AsciiCommands, Commands
from drivers.aerotech_motion import AxisMotion
from drivers.aerotech_settings import StageSettings
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError
from rigctl.core.interfaces import Learned

DISTANCE_KEY, ANSWERS_KEY = "oscillate_distance", "oscillate_answers"
TRAVEL_BY_DISTANCE = {"peak-to-peak": 1.0, "amplitude": 2.0}
TRIAL_DISTANCE_MM = 0.5
"""An oscillation by so much goes 1 mm at most, whichever way it is read."""
TRIAL_HZ = 0.5
AGREEMENT = 0.1
"""Of the distance: the two readings differ by all of it."""


class Sine:
    """Oscillations, and what is known of how the controller makes them."""

    def __init__(self, name: str, settings: StageSettings, wire: AsciiAxis, motion: AxisMotion, clock: Clock) -> None:
        self._name = name
        self._settings = settings
        self._wire = wire
        self._motion = motion
        self._clock = clock
        self._distance: str = settings.oscillate_distance
        self._answers: str = settings.oscillate_answers

    def unknown(self, commands: Commands) -> tuple[str, ...]:
        """The keys of the rig file of which only motion tells what they should be."""
        known = {DISTANCE_KEY: self._distance}
        if isinstance(commands, AsciiCommands):
            known[ANSWERS_KEY] = self._answers
        return tuple(key for key, value in known.items() if value == "unknown")

    def distance_mm(self, amplitude_mm: float, commands: Commands) -> float:
        """What to say for this amplitude; `InstrumentError` while it is not known."""
        if unknown := self.unknown(commands):
            raise InstrumentError(
                f"{self._name}: {' and '.join(unknown)} of this controller's OSCILLATE not known: let a supervised "
                f"millimetre tell (learn_by_moving), or look up OSCILLATE in {self._wire.words.manual} and say it "
                "in the rig file",
                instrument=self._name,
            )
        return 2.0 * amplitude_mm / TRAVEL_BY_DISTANCE[self._distance]

    def start(self, commands: Commands, distance_mm: float, frequency_hz: float, cycles: int, stops: int) -> None:
        """From where the stage stands; returns once it oscillates."""
        start_mm = self._wire.position_mm()
        line = commands.oscillation(distance_mm, frequency_hz, cycles)
        self._motion.start(line, stops)
        commands.begun(lambda: self._motion.raise_if_stopped(stops, "oscillation"))
        self._motion.await_oscillation(line, stops, start_mm, self._clock.now_s() + cycles / frequency_hz)

    def learn(self, commands: Commands, stops: int) -> tuple[Learned, ...]:
        """One cycle of the trial distance; what it showed."""
        unknown = self.unknown(commands)
        start_mm = self._wire.position_mm()
        self._settings.limits.require_position(self._name, start_mm + 2.0 * TRIAL_DISTANCE_MM)
        line = commands.oscillation(TRIAL_DISTANCE_MM, TRIAL_HZ, 1)
        begun_s = self._clock.now_s()
        period_s = 1.0 / TRIAL_HZ
        answer = self._motion.send(line, stops, timeout_s=period_s + self._settings.link_timeout_s)
        self._wire.succeed(line, answer)
        if self._clock.now_s() - begun_s > 0.5 * period_s:
            raise InstrumentError(
                f"{self._name}: OSCILLATE as an ASCII command is answered only when the motion has ended, so that "
                f"nothing could stop it; load the program ({self._wire.words.page})",
                instrument=self._name,
            )
        commands.begun(lambda: self._motion.raise_if_stopped(stops, "trial oscillation"))
        shows = self._wire.moving(self._wire.status())
        travelled_mm = [position_mm - start_mm for position_mm in self._positions_mm(period_s)]
        self._motion.await_standstill()
        if not shows:
            raise InstrumentError(
                f"{self._name}: AXISSTATUS does not show that OSCILLATE moves the axis, so that nobody could wait "
                f"for its end; load the program ({self._wire.words.page})",
                instrument=self._name,
            )
        found = {DISTANCE_KEY: self._reading(min(travelled_mm), max(travelled_mm)), ANSWERS_KEY: "at once"}
        self._distance, self._answers = found[DISTANCE_KEY], found[ANSWERS_KEY]
        measured = f"{min(travelled_mm):.3f} to {max(travelled_mm):.3f} mm for a distance of {TRIAL_DISTANCE_MM:g} mm"
        return tuple(Learned(key, found[key], measured) for key in unknown)

    def _positions_mm(self, period_s: float) -> list[float]:
        """Where the axis is, until a cycle that has begun by now is over."""
        positions_mm = []
        end_s = self._clock.now_s() + period_s
        while self._clock.now_s() < end_s:
            positions_mm.append(self._wire.position_mm())
            self._clock.sleep_s(self._settings.poll_interval_s)
        return positions_mm

    def _reading(self, low_mm: float, high_mm: float) -> str:
        allowed_mm = AGREEMENT * TRIAL_DISTANCE_MM
        for reading, travel in TRAVEL_BY_DISTANCE.items():
            if abs(high_mm - travel * TRIAL_DISTANCE_MM) < allowed_mm and abs(low_mm) < allowed_mm:
                return reading
        raise InstrumentError(
            f"{self._name}: OSCILLATE by {TRIAL_DISTANCE_MM:g} mm went from {low_mm:.3f} to {high_mm:.3f} mm, "
            f"neither 0 to 0.5 mm nor 0 to 1 mm; look up OSCILLATE in {self._wire.words.manual} before anything "
            "else is moved",
            instrument=self._name,
        )
