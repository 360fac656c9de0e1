"""The signed in-phase null search: few angles, two frequencies, the crossing of eq. 5 rather than the minimum.

The in-phase response S = k [rho g cos(theta - theta0) + A w^2 sin(theta - theta0)] has a roll term that no angle
removes, but it does not depend on frequency: curves taken at several frequencies cross at theta0. One short run
tells roughly where the null is; the rest of the time is spent close to it, shared between the two frequencies that
separate roll and angle best, until the sigma of theta0 is below the target.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from procedures.bench import ANGLE_RESOLUTION_DEG, Bench, SetPoint
from procedures.mounting import Fixture, Mounting
from rigctl.campaign.session import Session
from rigctl.effects.catalogue import Effect
from rigctl.errors import ProcedureError
from rigctl.experiments.sensing_axis.fit import NullPoint, RecordingFit, fit_recording
from rigctl.experiments.sensing_axis.model import RecordingModel
from rigctl.experiments.sensing_axis.reduction import ReducedRun, noise_density, observables, reduce_run
from rigctl.fitting.plane import ARCSEC

ROLL = "roll-gravity"
MAX_RUNS = 24
MARGIN = 1.03
"""Time is planned this much longer than the noise asks for: a second visit costs more."""


@dataclass(frozen=True)
class NullSearchSettings:
    """How a null is searched."""

    frequencies_hz: tuple[float, ...]
    amplitude_mm: float
    sample_rate_hz: float
    theta0_sigma_arcsec: float
    coarse_s: float = 6.0
    start_deg: float = 0.0
    noise_m_s2_rthz: float = 1e-6
    max_run_s: float = 600.0


@dataclass
class NullSearch:
    """A search in one mounting."""

    session: Session
    bench: Bench
    fixture: Fixture
    mounting: Mounting
    settings: NullSearchSettings
    effects: Sequence[Effect]
    runs: list[ReducedRun] = field(default_factory=list)

    def find(self) -> NullPoint:
        """Measure until theta0 is known well enough; `ProcedureError` when that does not come about."""
        low_hz, high_hz = self._frequencies()
        null = self._approach(high_hz)
        theta_deg = self._set_point_deg(null)
        frequencies = [high_hz] if low_hz == high_hz else [high_hz, low_hz]
        while not self._good_enough(null):
            if len(self.runs) >= MAX_RUNS:
                raise ProcedureError(
                    f"{self.mounting.key}: theta0 known to {null.theta0_sigma_rad / ARCSEC:.2f} arcsec only after "
                    f"{MAX_RUNS} runs, target {self.settings.theta0_sigma_arcsec:g}: is the room quiet?"
                )
            missing_s = self._missing_s(null, low_hz, high_hz)
            for frequency_hz in frequencies:
                self._measure(theta_deg, frequency_hz, missing_s / len(frequencies), null)
            frequencies.reverse()
            null = self._null()
        return null

    def fit(self) -> RecordingFit:
        """The model fitted to the runs of this mounting."""
        bench = self.bench
        return fit_recording(
            RecordingModel(observables(self.runs), bench.package, bench.heads, bench.g_m_s2, self._separable())
        )

    def _separable(self) -> tuple[Effect, ...]:
        """At one frequency roll is a shift of the null: it enters the model with the second one."""
        one_frequency = len({round(run.frequency_hz, 2) for run in self.runs}) == 1
        return tuple(effect for effect in self.effects if effect.id != ROLL or not one_frequency)

    def _approach(self, frequency_hz: float) -> NullPoint:
        """Short runs, each at the null as the last one told, until the guess stays on the spot."""
        theta_deg = self.settings.start_deg
        for _ in range(4):
            self._measure(theta_deg, frequency_hz, self.settings.coarse_s, None)
            null = self._null()
            found_deg = self._set_point_deg(null)
            # With the gain known to its prior, one step of a degree ends within its hundredth.
            if abs(found_deg - theta_deg) <= 1.5:
                return null
            theta_deg = found_deg
        raise ProcedureError(f"{self.mounting.key}: no null within reach of {self.settings.start_deg:g} deg")

    def _measure(self, theta_deg: float, frequency_hz: float, duration_s: float, null: NullPoint | None) -> None:
        settings = self.settings
        point = SetPoint(
            self.mounting.axis,
            self.mounting.configuration,
            self.mounting.number,
            theta_deg,
            frequency_hz,
            settings.amplitude_mm,
            min(duration_s, settings.max_run_s),
            settings.sample_rate_hz,
        )
        null_deg = math.degrees(null.theta0_rad) if null is not None else None
        key = f"{self.mounting.key} run {len(self.runs) + 1}"
        record = self.bench.run(
            self.session, key, point, before=lambda: self.fixture.confirm(self.mounting), null_deg=null_deg
        )
        if not record.valid:
            raise ProcedureError(f"{key}: {record.reason}; level the package or reduce the amplitude")
        self.runs.append(reduce_run(record.run_id, record.conditions, self.session.store.samples(record.run_id)))

    def _null(self) -> NullPoint:
        mounting = self.mounting
        return self.fit().null(mounting.axis, mounting.configuration, mounting.number)

    def _good_enough(self, null: NullPoint) -> bool:
        visited = {round(run.frequency_hz, 2) for run in self.runs[1:]}
        enough = {round(f, 2) for f in self._frequencies()} <= visited
        return enough and null.theta0_sigma_rad <= self.settings.theta0_sigma_arcsec * ARCSEC

    def _frequencies(self) -> tuple[float, float]:
        """The lowest and the highest: they separate roll from angle best. Without roll the highest alone."""
        high_hz = max(self.settings.frequencies_hz)
        with_roll = any(effect.id == ROLL for effect in self.effects)
        return (min(self.settings.frequencies_hz) if with_roll else high_hz), high_hz

    def _missing_s(self, null: NullPoint, low_hz: float, high_hz: float) -> float:
        """Further acquisition time for the target, both frequencies together."""
        target_rad = self.settings.theta0_sigma_arcsec * ARCSEC
        sensor = self.bench.package.axes[self.mounting.axis].sensor[self.mounting.configuration]
        noise = noise_density(self.runs, high_hz) / sensor.gain_v_per_m_s2**2
        w2 = (2.0 * math.pi * high_hz) ** 2 - ((2.0 * math.pi * low_hz) ** 2 if low_hz != high_hz else 0.0)
        shares = 4.0 if low_hz != high_hz else 1.0
        total_s = shares * noise / (1e-3 * self.settings.amplitude_mm * w2 * target_rad) ** 2
        if len(self.runs) == 1:
            return max(MARGIN * total_s, 2.0 / low_hz)
        # What is there already counts: variance falls as the inverse of time.
        sigma = null.theta0_sigma_rad
        return max(MARGIN * total_s * (1.0 - (target_rad / sigma) ** 2), 2.0 / low_hz)

    @staticmethod
    def _set_point_deg(null: NullPoint) -> float:
        steps = round(math.degrees(null.theta0_rad) / ANGLE_RESOLUTION_DEG)
        return steps * ANGLE_RESOLUTION_DEG
