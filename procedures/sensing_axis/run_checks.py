"""Is a run on the sensing-axis bench what its instruments can have measured, and is it fit for use?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from procedures.sample_checks import Flaw, encoder_flaw, free_laser_flaw, laser_flaw, voltage_flaw
from procedures.sine_fit import Column, Sine
from rigctl.campaign.recording import time_column
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ImplausibleSample, ProcedureError
from rigctl.core.interfaces import DisplacementMeter, LinearStage, PacedRecorder, PacingRecorder

CHANGE_K, ROOM_C = 2.0, (-20.0, 60.0)
"""What a bench's temperature changes by at most within a run, and what rooms have [degC]."""

ANGLE_TOLERANCE_DEG = 0.01
"""Largest difference between the angle asked for and the encoder's: what drivers take for arrived."""

AMPLITUDE_TOLERANCE = 0.05
"""Largest relative difference between the amplitude asked for and the encoder's."""


class CapturingStage(LinearStage, PacedRecorder, Protocol):
    """A linear stage that records its encoder on the trigger edges."""


def require_standing(stage: str, asked_deg: float, angles_deg: Sequence[float]) -> None:
    """`ImplausibleSample` when the encoder, before and after a run, is not where the stage was sent."""
    for theta_deg in angles_deg:
        # NaN fails in this form.
        if not abs(theta_deg - asked_deg) <= ANGLE_TOLERANCE_DEG:
            message = f"{stage}: {theta_deg:g} deg where {asked_deg:g} deg was asked for"
            raise ImplausibleSample(message, channel="theta_deg", instrument=stage)


def require_steady(temperatures_c: Sequence[float]) -> None:
    """`ImplausibleSample` when no room, and no bench within a run, has these temperatures; NaN is none."""
    known = [each for each in temperatures_c if math.isfinite(each)]
    if known and (max(known) - min(known) > CHANGE_K or not ROOM_C[0] <= min(known) <= max(known) <= ROOM_C[1]):
        values = ", ".join(f"{temperature_c:g}" for temperature_c in known)
        raise ImplausibleSample(f"temperature_c: {values} degC within one run", channel="temperature_c")


@dataclass(frozen=True)
class Recorders:
    """Whose columns a run has."""

    linear: CapturingStage
    readout: PacingRecorder
    lasers: Sequence[DisplacementMeter]

    def require_possible(self, frequency_hz: float, sample_rate_hz: float, columns: Mapping[str, FloatArray]) -> None:
        """`ImplausibleSample` when a column holds what its instrument cannot have measured."""
        (stage,), (readout,) = self.linear.channels(), self.readout.channels()
        sine = Sine(np.arange(len(columns[stage.name])) / sample_rate_hz, frequency_hz)
        position, volts = (Column(each.name, sine, columns[each.name]) for each in (stage, readout))
        flaws: list[tuple[str, Flaw | None]] = [
            (self.linear.name, encoder_flaw(position, self.linear.limits.acceleration_mm_s2)),
            (self.readout.name, voltage_flaw(readout, volts)),
        ]
        for laser in self.lasers:
            for head in laser.channels():
                if (values_mm := columns.get(head.name)) is None:
                    continue
                if (own_s := columns.get(time_column(head.name))) is not None:
                    flaw = free_laser_flaw(Column(head.name, Sine(own_s, frequency_hz), values_mm), position)
                else:
                    # Against the encoder, which has a latency of its own.
                    late_s = head.latency_s - stage.latency_s
                    flaw = laser_flaw(Column(head.name, sine, values_mm), position, late_s)
                flaws.append((laser.name, flaw))
        for instrument, flaw in flaws:
            if flaw is not None:
                raise flaw.of(instrument)

    def require_amplitude(self, amplitude_mm: float, columns: Mapping[str, FloatArray]) -> None:
        """A stage that does what it was not asked to is a `ProcedureError`: no repetition would help."""
        seen_mm = math.sqrt(2.0) * float(np.std(columns[self.linear.channels()[0].name]))
        if not abs(seen_mm / amplitude_mm - 1.0) <= AMPLITUDE_TOLERANCE:
            raise ProcedureError(
                f"{self.linear.name}: the encoder shows an amplitude of {seen_mm:.3f} mm where "
                f"{amplitude_mm:g} mm was asked for; check oscillate_distance in the rig file"
            )

    def missing(self, columns: Mapping[str, FloatArray]) -> dict[str, Any]:
        """What is remarked about a run that is valid: heads that for some of its samples saw no target."""
        remarks = []
        for laser in self.lasers:
            for head in laser.channels():
                values_mm = columns.get(head.name, np.empty(0))
                if unseen := int(np.sum(np.isnan(values_mm))):
                    missing = f"{unseen} of {len(values_mm)} samples of {head.name} are missing"
                    remarks.append(f"{laser.name}: {missing}; does the head see its target?")
        return {"reason": "; ".join(remarks)} if remarks else {}

    def saturation(self, columns: Mapping[str, FloatArray]) -> dict[str, Any]:
        """What makes a run invalid that is measured well: a sensor beyond its range."""
        channel = self.readout.channels()[0]
        volts = columns[channel.name]
        known = volts[np.isfinite(volts)]
        # An overload is NaN.
        saturated = len(volts) - len(known)
        if channel.full_scale is not None:
            saturated += int(np.sum(np.abs(known) >= channel.full_scale))
        return {"valid": False, "reason": f"{saturated} saturated samples in {channel.name}"} if saturated else {}
