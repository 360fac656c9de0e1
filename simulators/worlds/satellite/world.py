"""The satellite as its ground segment has it: told what to do, and heard as time goes by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.clock import SimulationClock
from simulators.measured import unheard
from simulators.worlds.satellite.ensemble import Ensemble, command_of
from simulators.worlds.satellite.forcing import ROOM_K, temperature_k
from simulators.worlds.satellite.layout import COLUMNS
from simulators.worlds.satellite.settings import SatelliteSettings

if TYPE_CHECKING:
    from simulators.worlds.satellite.simulation import Simulation


class Satellite:
    """One satellite of the ensemble, on a clock."""

    def __init__(self, settings: SatelliteSettings, clock: SimulationClock) -> None:
        self.tap = unheard()
        self._settings, self._clock = settings, clock
        self._run = 0
        self._simulation: Simulation | None = None
        self._perigee_s = 0.0

    identity = {"model": "drag-free satellite", "serial": "simulated", "firmware": "1"}
    columns = ("t_s", *COLUMNS, "temperature_1_k", "temperature_2_k")

    def ensemble(self) -> Ensemble:
        """All satellites of this kind."""
        return Ensemble(self._settings)

    @property
    def sample_period_s(self) -> float:
        """Of the telemetry."""
        return self._settings.sample_period_s

    def announce_run(self, number: int) -> None:
        """The key of the next session's randomness."""
        self._run = number

    def choose(self, draw: int) -> float:
        """Be another satellite of the ensemble, from the next session on; the rig time of that."""
        self._settings = self._settings.model_copy(update={"draw": draw})
        return self._clock.now_s()

    def begin(self, command: Mapping[str, Any]) -> float:
        """Carry out a session from the first perigee for which the loops can settle; its rig time.

        Keys: `duration_s`, `hold`, and `target`, `axis`, `amplitude`, `frequency_hz`, `phase_rad` of the stimulus.
        """
        # The compiler takes a second to load: not before a session asks for it.
        from simulators.worlds.satellite.simulation import Simulation

        settings = self._settings
        asked = command_of(settings, command)
        self.tap.begin()
        self._simulation = Simulation(settings, [settings.draw], self._run, asked)
        orbits = math.ceil((self._clock.now_s() + settings.settle_s) / settings.orbit_period_s)
        self._perigee_s = orbits * settings.orbit_period_s
        return self._perigee_s

    def fetch(self) -> FloatArray:
        """What came down since the last call, (samples, columns): a sample comes when its period is over."""
        if self._simulation is None:
            return np.empty((0, len(self.columns)))
        settings, first = self._settings, self._simulation.taken
        # Rounding must not lose the sample whose period ends right now.
        over = math.floor((self._clock.now_s() - self._perigee_s) / settings.sample_period_s + 1e-6)
        if over <= first:
            return np.empty((0, len(self.columns)))
        sent = self._simulation.take(over - first)[:, :, 0]
        time_s = settings.sample_period_s * np.arange(first, first + len(sent), dtype=np.float64)
        # The temperature comes in the same packets.
        warm_k = np.where(np.isnan(sent[:, 0]), np.nan, ROOM_K + temperature_k(settings, time_s))
        rows = np.column_stack([time_s, sent, warm_k, warm_k])
        self._note(rows)
        return rows

    def _note(self, rows: FloatArray) -> None:
        if self.tap.heard:
            for column, values in zip(self.columns, rows.T, strict=True):
                self.tap.note(column, rows[:, 0], values)

    def end(self) -> None:
        """End a session early."""
        self._simulation = None
