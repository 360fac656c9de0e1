"""Many satellites of one kind, by number: telemetry in lock step, and what a calibration of each should find."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.forcing import Command, Injection
from simulators.worlds.satellite.instrument import truths
from simulators.worlds.satellite.layout import COLUMNS, LANES
from simulators.worlds.satellite.settings import SatelliteSettings


class Ensemble:
    """The satellites that a seed makes; settings are all there is to it."""

    at_once = LANES
    columns: tuple[str, ...] = COLUMNS

    def __init__(self, settings: SatelliteSettings) -> None:
        self._settings = settings
        self.sample_period_s = settings.sample_period_s
        self.complete = settings.missing.fraction == 0.0

    def telemetry(self, draws: Sequence[int], run: int, session: Any, chunk: int) -> Iterator[FloatArray]:
        """A session of some draws, (samples, columns, draws), `chunk` samples at a time; the last ones fewer.

        All chunks are in the same memory: one is there until the next is asked for. `session` has
        `duration_s`, `hold` and a `stimulus` with the fields of an `Injection`.
        """
        # The compiler takes a second to load: not before somebody asks for it.
        from simulators.worlds.satellite.simulation import Simulation

        injected = {field.name: getattr(session.stimulus, field.name) for field in fields(Injection)}
        command = command_of(
            self._settings,
            {"duration_s": session.duration_s, "hold": session.hold, "spin_hz": session.spin_hz, **injected},
        )
        simulation = Simulation(self._settings, draws, run, command)
        memory = np.empty((chunk, len(COLUMNS) * LANES))
        while simulation.taken < command.samples:
            yield simulation.take(chunk, memory)

    def truths(self, draw: int) -> dict[str, Mapping[str, float]]:
        """The parameters of a draw, by `exact_truth` and `paper_truth`."""
        return truths(self._settings, draw)


def command_of(settings: SatelliteSettings, told: Mapping[str, Any]) -> Command:
    """A telecommand: `duration_s`, `hold`, and what is injected."""
    injection = Injection(**{field.name: told[field.name] for field in fields(Injection)})
    return Command(
        round(float(told["duration_s"]) / settings.sample_period_s), injection, told["hold"], told.get("spin_hz", 0.0)
    )
