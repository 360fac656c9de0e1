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

from procedures.sensing_axis.bench import ANGLE_RESOLUTION_DEG, Bench, SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting
from rigctl.analysis.plane import ARCSEC
from rigctl.campaign.session.session import Session
from rigctl.core.errors import ConfigError, ProcedureError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.fit import ROLL, NullPoint, RecordingFit, fit_mounting
from rigctl.experiments.sensing_axis.observe.reduction import ReducedRun, noise_density, observables, reduce_run

MAX_RUNS = 24
MAX_ATTEMPTS = 3
"""A run that saturates, or that an operator has declared invalid, is taken again."""

MARGIN = 1.04
"""Time is planned this much longer than the noise asks for: a second visit costs more."""

NEAR_DEG = 1.5
"""A first guess this close is good enough to go to the null from."""


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
        null = self._approach()
        theta_deg = _set_point_deg(null)
        target_rad = self.settings.theta0_sigma_arcsec * ARCSEC
        # Each frequency at least once: without one of them roll and angle are one parameter.
        pending = list(self.pair)
        while pending or null.theta0_sigma_rad > target_rad:
            if len(self.runs) >= MAX_RUNS:
                raise ProcedureError(
                    f"{self.mounting.key}: theta0 known to {null.theta0_sigma_rad / ARCSEC:.2f} arcsec only after "
                    f"{MAX_RUNS} runs, target {self.settings.theta0_sigma_arcsec:g}: is the room quiet?"
                )
            # After that whichever limits theta0 now.
            frequency_hz = pending.pop(0) if pending else self._weakest()
            self._measure(theta_deg, frequency_hz, self._missing_s(frequency_hz, target_rad))
            null = self._null()
        return null

    @property
    def pair(self) -> tuple[float, ...]:
        """The drive's frequencies used: the outermost separate roll from angle best; without roll the highest."""
        return _pair(self.settings, self.effects)

    def fit(self) -> RecordingFit:
        """The model fitted to the runs of this mounting."""
        bench = self.bench
        return fit_mounting(
            observables(self.runs, harmonics=1), bench.package, bench.heads, bench.g_m_s2, self.effects
        )

    def _approach(self) -> NullPoint:
        """Short runs, each at the null as the last one told, until the guess stays on the spot."""
        theta_deg = self.settings.start_deg
        for _ in range(4):
            self._measure(theta_deg, self.pair[0], self.settings.coarse_s)
            null = self._null()
            found_deg = _set_point_deg(null)
            # With the gain known to its prior, one step of a degree ends within its hundredth.
            if abs(found_deg - theta_deg) <= NEAR_DEG:
                return null
            theta_deg = found_deg
        raise ProcedureError(f"{self.mounting.key}: no null within reach of {self.settings.start_deg:g} deg")

    def _measure(self, theta_deg: float, frequency_hz: float, dwell_s: float) -> None:
        settings = self.settings
        point = SetPoint(
            self.mounting.axis,
            self.mounting.configuration,
            self.mounting.number,
            theta_deg,
            frequency_hz,
            settings.amplitude_mm,
            dwell_s,
            settings.sample_rate_hz,
        )
        # The set-point is part of the name: when a run is declared invalid, what follows from it changes too.
        key = f"{self.mounting.key} run {len(self.runs) + 1} at {theta_deg:.4f} deg {frequency_hz:g} Hz"
        reason = ""
        for attempt in range(MAX_ATTEMPTS):
            name = f"{key}, again {attempt}" if attempt else key
            record = self.bench.run(self.session, name, point, before=lambda: self.fixture.confirm(self.mounting))
            if record.valid:
                samples = self.session.store.samples(record.run_id)
                self.runs.append(
                    reduce_run(record.run_id, record.conditions, samples, channels=self.session.store.header.channels)
                )
                return
            reason = record.reason
        raise ProcedureError(f"{key}: {MAX_ATTEMPTS} times {reason}; level the package or reduce the amplitude")

    def _null(self) -> NullPoint:
        mounting = self.mounting
        return self.fit().null(mounting.axis, mounting.configuration, mounting.number)

    def _missing_s(self, frequency_hz: float, target_rad: float) -> float:
        """Further time at this frequency for the target, with what the others have and will have."""
        times, noise = self._times_s(), self._noise()
        allowed = (target_rad * self._slope_m_s2()) ** 2 / MARGIN
        # Equal noise per frequency is best at equal times: each may use an equal share of what is allowed.
        share = allowed / len(self.pair)
        # What the others lack of their shares they get when it is their turn again: nobody else makes up for it.
        others = sum(min(noise[f] / times[f], share) if times[f] else share for f in self.pair if f != frequency_hz)
        needed_s = noise[frequency_hz] / (allowed - others) - times[frequency_hz]
        longest_s = self.bench.longest_run_s(self.settings.sample_rate_hz, lasers=True) - 1.0 / frequency_hz
        return min(max(needed_s, 2.0 / frequency_hz), self.settings.max_run_s, longest_s)

    def _weakest(self) -> float:
        """The frequency whose noise limits theta0 now."""
        times, noise = self._times_s(), self._noise()
        return max(self.pair, key=lambda f: noise[f] / times[f])

    def _times_s(self) -> dict[float, float]:
        """Acquisition time near the null, by frequency."""
        # The first run only finds the way and stands too far from the null.
        near = self.runs[1:]
        # One of the list of frequencies but for rounding.
        return {f: sum(r.duration_s for r in near if abs(r.frequency_hz - f) < 0.01) for f in self.pair}

    def _noise(self) -> dict[float, float]:
        """Density of the acceleration noise at each frequency [(m/s2)^2/Hz]."""
        sensor = self.bench.package.axes[self.mounting.axis].sensor[self.mounting.configuration]
        # After the coarse run alone the noise is the one the room was measured to have.
        if len(self.runs) == 1:
            return dict.fromkeys(self.pair, self.settings.noise_m_s2_rthz**2)
        return {f: noise_density(self.runs, f) / sensor.gain_v_per_m_s2**2 for f in self.pair}

    def _slope_m_s2(self) -> float:
        """Change per radian of what tells the null: A w^2, or its difference between the two frequencies."""
        return _slope_m_s2(self.settings, self.pair)


def expected_dwells_s(settings: NullSearchSettings, effects: Sequence[Effect]) -> list[tuple[float, float]]:
    """Frequency [Hz] and duration [s] of the runs that a search takes in a room of the settings' noise.

    `ConfigError` where that is more than a search may take.
    """
    pair = _pair(settings, effects)
    allowed_m_s2 = settings.theta0_sigma_arcsec * ARCSEC * _slope_m_s2(settings, pair)
    # One run is the coarse one.
    most = (MAX_RUNS - 1) // len(pair)
    if allowed_m_s2 * math.sqrt(most * settings.max_run_s) < settings.noise_m_s2_rthz * math.sqrt(len(pair) * MARGIN):
        raise ConfigError(
            f"procedure.amplitude_mm: {settings.amplitude_mm:g} mm at {pair[0]:g} Hz do not tell theta0 to "
            f"{settings.theta0_sigma_arcsec:g} arcsec within {MAX_RUNS} runs of {settings.max_run_s:g} s; "
            "give more amplitude, a higher frequency or a larger targets.theta0_sigma_arcsec"
        )
    near_s = MARGIN * len(pair) * (settings.noise_m_s2_rthz / allowed_m_s2) ** 2
    parts = math.ceil(near_s / settings.max_run_s)
    near = [(frequency_hz, max(near_s / parts, 2.0 / frequency_hz)) for frequency_hz in pair for _ in range(parts)]
    return [(pair[0], settings.coarse_s), *near]


def _pair(settings: NullSearchSettings, effects: Sequence[Effect]) -> tuple[float, ...]:
    high_hz, low_hz = max(settings.frequencies_hz), min(settings.frequencies_hz)
    with_roll = any(effect.id == ROLL for effect in effects)
    return (high_hz, low_hz) if with_roll and low_hz != high_hz else (high_hz,)


def _slope_m_s2(settings: NullSearchSettings, pair: Sequence[float]) -> float:
    w2 = [(2.0 * math.pi * f) ** 2 for f in pair]
    # With roll in the model only the difference of w^2 between the two frequencies tells the angle.
    return 1e-3 * settings.amplitude_mm * (w2[0] - (w2[1] if len(w2) > 1 else 0.0))


def _set_point_deg(null: NullPoint) -> float:
    # The stage can stand nowhere else, and a name of a run must not depend on the last bits of a fit.
    return round(math.degrees(null.theta0_rad) / ANGLE_RESOLUTION_DEG) * ANGLE_RESOLUTION_DEG
