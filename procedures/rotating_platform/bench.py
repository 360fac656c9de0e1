"""The rotating-platform bench as a procedure sees it: a time table and a tilt in, one durable run out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from procedures.rotating_platform.stream import FollowingMeter, PacingMeter
from procedures.rotating_platform.time_table import TimeTable
from rigctl.campaign.session.recovery import Apparatus, require_homed
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.errors import ImplausibleSample
from rigctl.core.interfaces import Instrument, Thermometer, TimedRotationStage
from rigctl.core.voltage_sources import VoltageSource, Waveform

ANGLE_TOLERANCE_DEG = 0.1
"""Largest difference between the angle asked for and the encoder's: 1.5e-6 in cos(theta)."""

TILT_Y, TILT_Z = "dm1_y_v", "dm1_z_v"

Watch = Callable[[Mapping[str, FloatArray]], None]
"""Is given every stretch of a run's columns once it is recorded."""


class TiltSource(VoltageSource, Protocol):
    """A source that says beforehand what it can make."""

    def check(self, waveforms: Mapping[str, Waveform]) -> None:
        """`LimitError` for what `start` would refuse. Sends nothing."""
        ...


@dataclass(frozen=True)
class Wanted:
    """One recording: the platform's table, the voltages at the offset inputs, the sampling rate."""

    table: TimeTable
    tilt: Mapping[str, Waveform]
    sample_rate_hz: float

    @property
    def samples(self) -> int:
        """Of the whole run."""
        return round(self.table.duration_s * self.sample_rate_hz)


@dataclass
class PlatformBench:
    """The instruments by role, and what their columns are called."""

    platform: TimedRotationStage
    readout: PacingMeter
    voltmeter: FollowingMeter
    source: TiltSource
    thermometer: Thermometer | None
    clock: Clock
    settle_s: float = 10.0
    temperature_every_s: float = 60.0
    _left: TimeTable | None = field(default=None, init=False)

    def prepare(self) -> None:
        """Home what is not homed."""
        if not self.platform.is_homed():
            self.platform.home()

    def apparatus(self) -> Apparatus:
        """The instruments of a run, and how they are made ready after a fault that ended it."""
        instruments: list[Instrument] = [self.readout, self.voltmeter, self.source]
        if self.thermometer is not None:
            instruments.append(self.thermometer)
        return Apparatus((self.platform,), tuple(instruments), confirms_itself=True)

    def replayed(self, table: TimeTable) -> None:
        """A run after this table is recorded: the platform has been left at its end."""
        self._left = table

    def restore(self) -> None:
        """After a restart: the platform as the last recorded run has left it, turned in the same direction."""
        if self._left is not None:
            # By way of the rest before, so that the last one is reached from the same side.
            for theta_deg in self._left.angles_deg[-2:]:
                self.platform.move_to(theta_deg)

    @property
    def turning(self) -> Apparatus:
        """The platform by itself: meters and source go on while it is brought back."""
        return Apparatus((self.platform,), alone=True)

    def standing_deg(self, asked_theta_deg: float) -> float:
        """The encoder's angle, platform at rest; `ImplausibleSample` when it is not where it was sent.

        `SafetyStop` or `InstrumentError` when it has lost its reference: any angle it says is then none.
        """
        theta_deg = self.platform.angle().value
        # After the angle: a reference that is still there now was there when the angle was said.
        require_homed(self.platform)
        self.platform.confirm_in_step()
        if abs(theta_deg - asked_theta_deg) > ANGLE_TOLERANCE_DEG:
            message = f"{self.platform.name}: {theta_deg:g} deg where {asked_theta_deg:g} deg was asked for"
            raise ImplausibleSample(message, channel="theta_deg", instrument=self.platform.name)
        return theta_deg

    def rest(self) -> None:
        """Between runs nothing moves."""

    def level(self) -> None:
        """No tilt is commanded any more."""
        self.source.start({})

    def check(self, wanted: Wanted) -> None:
        """`LimitError` when platform, meters or source cannot do it."""
        wanted.table.check(self.platform.name, self.platform.limits)
        # Asked for its refusal of a rate, not for the number.
        self.readout.longest_record(1.0 / wanted.sample_rate_hz)
        self.source.check(wanted.tilt)
