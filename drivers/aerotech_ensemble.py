"""Aerotech Ensemble: a linear stage over the controller's ASCII command interface.

Facts from Aerotech's library headers and drivers in public use (EPICS motorAerotech, ESRF BLISS, NASA
golaborate). Where these are silent the driver decides:

- Homing: `HOME` blocks the command interpreter, so that nothing could stop it over the same socket. The
  driver runs the maker's HomeAsync program on the auxiliary task and polls; a controller without it gets
  `HOME`, and then a stop takes effect only when homing has ended.
- `WAIT MODE NOWAIT` and the ramp are sent before every motion: enabling resets the mode, and other clients
  change both. No exchange is long then, so `stop` gets its turn at once.
- Oscillation and capture are done by a program of ours on tasks of the controller, or by ASCII commands where
  it understands them (`drivers.aerotech_commands`).
- `OSCILLATE` is a raised cosine that begins at one end; whether its distance is the whole travel or the
  amplitude only motion tells: `learn_by_moving`, by a millimetre, or the rig file.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

import numpy as np

from drivers.aerotech_ascii import AsciiLink
from drivers.aerotech_axis import SAFETY_FAULTS, AsciiAxis, AxisStatus, fault_text
from drivers.aerotech_capture import PositionCapture
from drivers.aerotech_commands import Commands, find_commands
from drivers.aerotech_examined import examined
from drivers.aerotech_motion import AxisMotion
from drivers.aerotech_settings import EnsembleSettings, StageSettings
from drivers.aerotech_setup import ControllerSetup
from drivers.aerotech_sine import Sine
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import InstrumentError
from rigctl.core.findings import Finding, unknown
from rigctl.core.interfaces import Channel, Identity, Learned, Reading


class AerotechEnsemble:
    """One axis of an Ensemble as a linear stage that records its own position at trigger edges."""

    _set_up_as: type[ControllerSetup] = ControllerSetup

    def __init__(self, name: str, settings: StageSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = settings.limits
        self._settings = settings
        self._clock = clock
        self._link = AsciiLink(name, connect, settings.link_timeout_s)
        task = settings.program_task if settings.program else None
        self._wire = AsciiAxis(name, settings.words, self._link, task)
        self._setup = self._set_up_as(name, settings, self._link, self._wire)
        self._motion = AxisMotion(name, settings, self._wire, clock)
        self._capture = PositionCapture(name, settings, self._wire, clock)
        self._sine = Sine(name, settings, self._wire, self._motion, clock)
        self._found: Commands | None = None

    # instrument

    def open(self) -> None:
        """Connect and check that an Ensemble with this axis, in millimetres, answers; moves nothing."""
        try:
            self._link.open()
            self._setup.check()
        # A Ctrl-C too: whatever ends the opening must free the one connection that the controller serves.
        except BaseException:
            self._link.close()
            raise
        self._capture.provide(self._setup.integer_registers)
        self._found = None

    def examine(self) -> Iterator[Finding]:
        """Connect and look at axis, unit, limits, faults, registers and programs; moves nothing.

        Where it has no program of ours the axis is disabled for a moment, to ask about OSCILLATE without any risk.
        """
        self._link.open()
        self._setup.meet()
        self._capture.provide(self._setup.integer_registers)
        self._found = None
        version = self._link.version().value
        yield from examined(
            version, self._settings, self._setup, self._wire, self._commands, self._capture.longest_record
        )
        with contextlib.suppress(InstrumentError):
            for key in self.unknown_until_moved():
                yield unknown("motion", key, "only motion tells", "`rigctl check --move`, by a millimetre")

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._link.close()

    def identify(self) -> Identity:
        """Model and firmware; the interface tells no serial number."""
        firmware = self._wire.succeed("VERSION", self._link.version())
        words = self._wire.words
        axis = f", axis {words.axis}" if words.axis else ""
        return Identity(words.model, "", firmware, f"Aerotech {words.model} {firmware}{axis}")

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._link.confirm_in_step()

    def stop(self) -> None:
        """Abort whatever moves, end a capture, and return when the axis says that it stands still."""
        # First: a motion that is about to be sent in another thread then finds that it was stopped.
        self._motion.note_stop()
        with self._link.urgently():
            self._halt()
            self._setup.learn_questions()
            self._capture.end()
            self._motion.await_standstill()

    # linear stage

    def home(self) -> None:
        """Acknowledge faults, enable, find the reference; only what is still to be done of it."""
        with self._motion.stoppable("homing") as stops:
            # While the axis may still be disabled, and before anything moves.
            self._look_for_commands()
            # Enabling acknowledges faults first: a latched fault would refuse it.
            if not self._wire.status() & AxisStatus.ENABLED:
                self._wire.tell("ACKNOWLEDGEALL")
                self._wire.enable()
            if not self._wire.status() & AxisStatus.HOMED:
                self._motion.find_reference(stops)
            self._setup.require_program_zero()

    def is_homed(self) -> bool:
        """True when enabled and referenced."""
        ready = AxisStatus.ENABLED | AxisStatus.HOMED
        return self._wire.status() & ready == ready

    def safety_stop(self) -> str:
        """The limits and the emergency stop among the axis' latched faults."""
        word = self._wire.fault_word() & SAFETY_FAULTS
        return fault_text(word) if word else ""

    def is_moving(self) -> bool:
        """True while the axis moves or homes."""
        status = self._wire.status()
        return self._wire.moving(status) or bool(status & AxisStatus.HOMING)

    def move_to(self, position_mm: float) -> None:
        """Move and return when the axis is in position."""
        self.limits.require_position(self.name, position_mm)
        with self._motion.stoppable(f"move to {position_mm:g} mm") as stops:
            self._prepare_motion()
            self._motion.move(position_mm, stops)

    def oscillate(self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float) -> None:
        """Go to the negative end and start whole cycles for at least `duration_s`; returns once they run."""
        self.limits.require_oscillation(self.name, centre_mm, amplitude_mm, frequency_hz, duration_s)
        # Rounded before: 12.0000000001 cycles of rounding must not become 13.
        cycles = math.ceil(round(duration_s * frequency_hz, 9))
        with self._motion.stoppable("oscillation") as stops:
            self._prepare_motion()
            commands = self._commands()
            distance_mm = self._sine.distance_mm(amplitude_mm, commands)
            # OSCILLATE begins at one end of its travel, so the carriage is brought to the negative end first.
            self._motion.move(centre_mm - amplitude_mm, stops)
            self._sine.start(commands, distance_mm, frequency_hz, cycles, stops)

    def rest(self) -> None:
        """Decelerate at the controller's AbortDecelRate and return when the axis stands still."""
        self._halt()
        self._motion.await_standstill()

    def position(self) -> Reading:
        """The encoder's position now [mm]."""
        return Reading(self._wire.position_mm(), "mm", self._clock.now_s())

    # what only motion tells

    def unknown_until_moved(self) -> tuple[str, ...]:
        """The keys of the rig file that `learn_by_moving` would find out; sends no motion."""
        return self._sine.unknown(self._commands())

    def learn_by_moving(self) -> tuple[Learned, ...]:
        """Find them out by an oscillation of 1 mm at most from where the stage stands, which has to be homed.

        What was learned holds until the driver is made anew: the rig file keeps it. `InstrumentError` when the axis
        does neither the one nor the other; `LimitError` when there is no room.
        """
        with self._motion.stoppable("trial oscillation") as stops:
            self._prepare_motion()
            return self._sine.learn(self._commands(), stops)

    # paced recorder

    def channels(self) -> tuple[Channel, ...]:
        """The stage's position."""
        return (Channel("stage_x_mm", "mm", "position", self._settings.latency_s),)

    def longest_record(self, period_s: float) -> int:
        """Most positions of one record; `LimitError` when the capture is not that fast."""
        return self._capture.longest_record(period_s)

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart."""
        self._capture.arm(samples, period_s, self._commands)

    def collect(self) -> FloatArray:
        """The captured positions, shape (samples, 1) [mm]; `InstrumentError` when edges were missed."""
        counts = self._capture.counts()
        # After the registers: a unit that was changed at any time before has spoilt them.
        self._setup.require_unit()
        return counts[:, np.newaxis] / self._setup.counts_per_mm

    # how it works

    def _commands(self) -> Commands:
        if self._found is None:
            self._found = find_commands(
                self.name,
                self._settings,
                self._wire,
                self._clock,
                integers=self._setup.integer_registers,
                doubles=self._setup.double_registers,
            )
        return self._found

    def _look_for_commands(self) -> None:
        try:
            self._commands()
        except InstrumentError:
            # Moves need none of them: who oscillates or captures is told then.
            return

    def _halt(self) -> None:
        self._motion.abort()
        # After the abort, which ends the motion at once; without it the program could command no other.
        if self._settings.program:
            self._link.insist(f"PROGRAM STOP {self._settings.program_task}")

    def _prepare_motion(self) -> None:
        """At rest, ready, and set up; the first question also finds a connection the controller has closed."""
        if self._wire.moving(self._motion.prepare()):
            self.rest()
        self._setup.require_unit()
        self._motion.set_up()


DRIVER = DriverDeclaration(
    "aerotech-ensemble",
    contract=1,
    roles=dict.fromkeys(("linear", "spare"), Use(EnsembleSettings, AerotechEnsemble)),
    simulator="simulators.aerotech_ensemble.declaration:SIMULATOR",
    port=8000,
)
