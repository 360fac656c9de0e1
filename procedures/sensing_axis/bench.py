"""The sensing-axis bench as a procedure sees it: set-points in, one durable run out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from procedures.paced_record import record
from procedures.sensing_axis.run_checks import CapturingStage, Recorders, require_standing, require_steady
from rigctl.analysis.clock_fit import sign_is_known
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.session.recovery import Apparatus, require_homed
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.entries import TEMPERATURE_MISSED
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.clock import Clock
from rigctl.core.errors import ImplausibleSample, LimitError
from rigctl.core.interfaces import (
    DisplacementMeter,
    FreeRecorder,
    Instrument,
    LinearStage,
    PacedRecorder,
    PacingRecorder,
    Recorder,
    RotationStage,
    Thermometer,
    Voltmeter,
)
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS
from rigctl.experiments.sensing_axis.observe.reduction import face_column
from rigctl.experiments.sensing_axis.observe.set_points import peak_output_v
from rigctl.files.package import HeadSettings, Package

RESIDUAL_TRANSIENT_M_S2 = 1e-8
"""What may be left of a free oscillation when a run starts: a tenth of the noise of a hundred-second run."""

NULL_WITHIN_DEG = 2.0
"""How far a null may be from the nominal one: axes are off the cube by up to a degree, mountings by tenths."""

OSCILLATION_MARGIN_S = 30.0
"""Settling, arming and read-out fit in here."""

DRIVE_WITHIN = 1e-3
"""A drive has the frequency that is asked for to better than this part."""

ANGLE_RESOLUTION_DEG = 1e-4
"""Set-points are whole steps of the rotation stage (0.36 arcsec)."""


class Readout(Voltmeter, PacingRecorder, Protocol):
    """The accelerometer's voltmeter, which also paces the others."""


class PacedMeter(DisplacementMeter, PacedRecorder, Protocol):
    """A controller that records on the rig's edges."""


class FreeMeter(DisplacementMeter, FreeRecorder, Protocol):
    """A controller that records on its own clock."""


@dataclass(frozen=True)
class SetPoint:
    """What a run is asked to be; `approach` is the direction in which the angle is last reached."""

    axis: str
    configuration: str
    mounting: int
    theta_deg: float
    frequency_hz: float
    amplitude_mm: float
    dwell_s: float
    sample_rate_hz: float
    approach: int = 1

    @property
    def samples(self) -> int:
        """Samples of the whole periods that the duration asks for, at least one."""
        # Rounding of a product must not add a whole period.
        periods = max(math.ceil(self.dwell_s * self.frequency_hz - 1e-6), 1)
        return math.ceil(periods / self.frequency_hz * self.sample_rate_hz)

    @property
    def peak_acceleration_m_s2(self) -> float:
        """A w^2."""
        return 1e-3 * self.amplitude_mm * (2.0 * math.pi * self.frequency_hz) ** 2


@dataclass
class Bench:
    """The instruments by role, and what the rig file says of the package and the heads."""

    rotation: RotationStage
    linear: CapturingStage
    lasers: tuple[PacedMeter | FreeMeter, ...]
    readout: Readout
    thermometer: Thermometer | None
    package: Package
    heads: Mapping[str, HeadSettings]
    g_m_s2: float
    clock: Clock
    approach_overshoot_deg: float = 0.05
    _oscillating: bool = field(default=False, init=False)
    _last_approach: int = field(default=0, init=False)
    _last_point: SetPoint | None = field(default=None, init=False)

    def prepare(self) -> None:
        """Home what is not homed."""
        if not self.linear.is_homed():
            self.linear.home()
        if not self.rotation.is_homed():
            self.rotation.home()

    def apparatus(self, *, lasers: bool = True) -> Apparatus:
        """The instruments of a run, and how they are made ready after a fault."""
        instruments: list[Instrument] = [self.readout]
        if lasers:
            instruments += self.lasers
        if self.thermometer is not None:
            instruments.append(self.thermometer)
        return Apparatus((self.rotation, self.linear), tuple(instruments), self._forget)

    def _forget(self) -> None:
        """Nothing oscillates any more, and nobody knows from which side the angle was reached."""
        self._oscillating, self._last_approach = False, 0

    def restore(self) -> None:
        """After a restart: the stages as the last recorded run has left them."""
        self.linear.move_to(0.0)
        if self._last_point is not None:
            self._turn_to(self._last_point.theta_deg, self._last_point.approach)

    def rest(self) -> None:
        """End an oscillation."""
        if self._oscillating:
            self.linear.rest()
            self._oscillating = False

    def check(self, point: SetPoint, *, lasers: bool) -> None:
        """`LimitError` when the stages cannot do it, the samples would not show the drive, or the spots would leave
        the cube's faces.
        """
        check_rate(point.sample_rate_hz, point.frequency_hz)
        self._check_angle(point)
        check_oscillation(self.linear, point.amplitude_mm, point.frequency_hz)
        longest_s = self.longest_run_s(point.sample_rate_hz, lasers=lasers)
        if point.samples > longest_s * point.sample_rate_hz:
            raise LimitError(
                f"{point.dwell_s:g} s at {point.sample_rate_hz:g} Hz is more than the recorders' memories hold; "
                f"at this rate at most {longest_s:.0f} s"
            )
        if lasers:
            self._check_clocks(point.frequency_hz)
        margin_mm = self.package.spot_margin_mm(point.theta_deg, point.amplitude_mm)
        if lasers and self.heads and margin_mm < 0:
            raise LimitError(
                f"at {point.theta_deg:g} deg with {point.amplitude_mm:g} mm a laser's spot leaves the "
                f"{self.package.cube_side_mm:g} mm cube by {-margin_mm:.2f} mm: less angle or amplitude"
            )

    def _check_clocks(self, frequency_hz: float) -> None:
        for laser in self.lasers:
            for channel in laser.channels():
                if not sign_is_known(frequency_hz, channel.clock_u_s):
                    raise LimitError(
                        f"{laser.name}: its times are known to {channel.clock_u_s:g} s (start_u_s), which at "
                        f"{frequency_hz:g} Hz may be half a period; drive more slowly, or make start_u_s smaller"
                    )

    def spots_stay(self, point: SetPoint) -> bool:
        """True when every spot stays on its face of the cube."""
        return self.package.spot_margin_mm(point.theta_deg, point.amplitude_mm) >= 0.0

    def check_level(self, point: SetPoint) -> None:
        """`LimitError` when the sensor's output would leave its range, as far as gain and level are known."""
        full_scale_v = self.readout.channels()[0].full_scale
        where = point.axis, point.configuration, point.theta_deg, point.frequency_hz, point.amplitude_mm
        peak_v = peak_output_v(self.package, *where)
        if full_scale_v is not None and peak_v >= full_scale_v:
            raise LimitError(
                f"at {point.theta_deg:g} deg, {point.frequency_hz:g} Hz and {point.amplitude_mm:g} mm {point.axis} "
                f"in {point.configuration} would give up to {peak_v:.1f} V, past the {full_scale_v:g} V of "
                f"{self.readout.name}: less amplitude, frequency or angle"
            )

    def _check_angle(self, point: SetPoint) -> None:
        limits = self.rotation.limits
        lowest, highest, side = limits.angle_min_deg, limits.angle_max_deg, "below"
        if point.approach > 0:
            lowest += self.approach_overshoot_deg
        else:
            highest, side = highest - self.approach_overshoot_deg, "above"
        if not lowest <= point.theta_deg <= highest:
            raise LimitError(
                f"{self.rotation.name}: {point.theta_deg:g} deg is outside {lowest:g} .. {highest:g} deg "
                f"(with the approach from {side})"
            )

    def longest_run_s(self, sample_rate_hz: float, *, lasers: bool) -> float:
        """What the recorders' memories hold at this rate; `LimitError` when one of them is not that fast."""
        recorders: list[Recorder] = [self.readout, self.linear]
        if lasers:
            recorders += self.lasers
        return min(recorder.longest_record(1.0 / sample_rate_hz) for recorder in recorders) / sample_rate_hz

    def run(
        self,
        session: Session,
        key: str,
        point: SetPoint,
        *,
        before: Callable[[], None],
        lasers: bool = True,
    ) -> RunRecord:
        """Acquire one run at a set-point, unless it is recorded already.

        `before` is called before anything moves.
        """
        self.check(point, lasers=lasers)
        asked = {
            "axis": point.axis,
            "configuration": point.configuration,
            "mounting": point.mounting,
            "theta_asked_deg": point.theta_deg,
            "frequency_hz": point.frequency_hz,
            "amplitude_mm": point.amplitude_mm,
            "approach": point.approach,
        }

        def measure(writer: RunWriter) -> dict[str, Any]:
            return self._measure(session, writer, point, lasers)

        if session.recorded(key):
            self._last_point = point
        else:
            # A pause must come before the operator is asked and anything moves.
            session.checkpoint()
            before()
        return session.acquire(key, asked, measure, self.apparatus(lasers=lasers))

    def _measure(self, session: Session, writer: RunWriter, point: SetPoint, lasers: bool) -> dict[str, Any]:
        # Every run sets out from rest, so that nothing of the run before is in it (docs/decisions/011).
        self.rest()
        self._turn_to(point.theta_deg, point.approach)
        self._oscillate(point)
        session.wait_s(self._settling_s(point))
        # Once before and once after the record: a stage that slipped in between shows.
        angle = self.rotation.angle()
        temperature = [self._temperature_c()]
        recorders: list[PacedRecorder | FreeRecorder] = [self.linear]
        if lasers:
            recorders += self.lasers
        start_s, columns = record(session, writer, self.readout, recorders, point.samples, 1.0 / point.sample_rate_hz)
        # Before and after, of which the run has the mean.
        temperature.append(self._temperature_c())
        require_standing(self.rotation.name, point.theta_deg, [angle.value, self.rotation.angle().value])
        require_steady(temperature)
        recorded = Recorders(self.linear, self.readout, self.lasers)
        try:
            recorded.require_possible(point.frequency_hz, point.sample_rate_hz, columns)
        except ImplausibleSample:
            require_homed(self.linear)  # a stage that has stopped tells why better than its samples do
            raise
        recorded.require_amplitude(point.amplitude_mm, columns)
        # Every run ends at rest in the middle: the next sets out from there at the same time, a restart included.
        self.rest()
        self.linear.move_to(0.0)
        if self.thermometer is not None and not np.isfinite(temperature).all():
            session.event(
                TEMPERATURE_MISSED, error=f"{self.thermometer.name}: no valid value; is its probe connected?"
            )
        conditions: dict[str, Any] = {
            "theta_deg": angle.value,
            "start_s": start_s,
            "temperature_c": float(np.mean(temperature)),
        }
        conditions.update(recorded.saturation(columns) or recorded.missing(columns))
        return conditions | {face_column(head): face for head, face in self._faces(point).items()}

    def _faces(self, point: SetPoint) -> dict[str, str]:
        """Which face each head looks at, for whoever reads the recording without the rig file."""
        return {
            name: self.package.face(point.axis, point.configuration, head.position)
            for name, head in self.heads.items()
        }

    def _settling_s(self, point: SetPoint) -> float:
        """Time until the free oscillation has died away that stopping, turning and starting have excited."""
        # The drive acts on the sensor by the sine of the angle to its null, at most in full.
        offset_deg = min(abs(point.theta_deg) + NULL_WITHIN_DEG, 90.0)
        excited_m_s2 = point.peak_acceleration_m_s2 * math.sin(math.radians(offset_deg))
        ring_down_s = self.package.axes[point.axis].sensor[point.configuration].ring_down_s
        # Time constants until the free oscillation is below what matters; none where it is so from the start.
        return ring_down_s * max(math.log(excited_m_s2 / RESIDUAL_TRANSIENT_M_S2), 0.0)

    def _turn_to(self, theta_deg: float, approach: int) -> None:
        """Arrive in the direction asked for: a cable that pulls shifts a null with the side it is come from."""
        now_deg = self.rotation.angle().value
        if self._last_approach == approach and abs(now_deg - theta_deg) < ANGLE_RESOLUTION_DEG / 2:
            return
        aside_deg = theta_deg - approach * self.approach_overshoot_deg
        # Only where it has to come back: a stage on the right side already arrives from there.
        if approach * (now_deg - aside_deg) > 0.0:
            self.rotation.move_to(aside_deg)
        self.rotation.move_to(theta_deg)
        self._last_approach = approach

    def _oscillate(self, point: SetPoint) -> None:
        # It ends by itself, so it has to outlast settling, arming and the record; `rest` ends it earlier.
        lasting_s = 1.5 * point.dwell_s + 2 * OSCILLATION_MARGIN_S
        # Before the command: if that fails on its way, nobody knows whether the stage moves.
        self._oscillating = True
        self.linear.oscillate(0.0, point.amplitude_mm, point.frequency_hz, lasting_s)

    def _temperature_c(self) -> float:
        return self.thermometer.temperature().value if self.thermometer is not None else math.nan


def check_rate(sample_rate_hz: float, frequency_hz: float) -> None:
    """`LimitError` when samples at this rate do not hold the harmonics that are fitted to a drive."""
    # Aliased, the encoder shows another amplitude than the stage has, and nothing of that is the stage's fault.
    too_slow_hz = 2.0 * HARMONICS * frequency_hz
    if sample_rate_hz <= too_slow_hz * (1.0 + DRIVE_WITHIN):
        raise LimitError(
            f"procedure.sample_rate_hz: {sample_rate_hz:g} Hz is too slow for the {HARMONICS} harmonics that are "
            f"fitted to a drive of {frequency_hz:g} Hz; take more than {too_slow_hz:g} Hz, or drive more slowly"
        )


def check_oscillation(linear: LinearStage, amplitude_mm: float, frequency_hz: float) -> None:
    """`LimitError` when travel, speed or acceleration do not allow a sinusoid about the centre."""
    limits = linear.limits
    w = 2.0 * math.pi * frequency_hz
    allowed_mm = {
        "travel": min(-limits.position_min_mm, limits.position_max_mm),
        "speed": limits.speed_mm_s / w,
        "acceleration": limits.acceleration_mm_s2 / w**2,
    }
    reason = min(allowed_mm, key=lambda name: allowed_mm[name])
    if amplitude_mm > allowed_mm[reason]:
        raise LimitError(
            f"{linear.name}: {amplitude_mm:g} mm at {frequency_hz:g} Hz exceeds its {reason}; "
            f"at this frequency at most {allowed_mm[reason]:.3g} mm"
        )
