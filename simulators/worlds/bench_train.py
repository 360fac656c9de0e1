"""What happens on the bench along one train of trigger edges."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from simulators.keyed_random import generator
from simulators.wiring import Train
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.laser_head import LaserHead
from simulators.worlds.mounting import Mounting
from simulators.worlds.sensor import SensorRecord
from simulators.worlds.stages import Stages
from simulators.worlds.temperature import Room

_BLOCK = 1024


class BenchTrain:
    """One stretch of ground under the sensor, one noise of each laser per edge; all of it by `key` alone."""

    def __init__(
        self,
        settings: BenchSettings,
        stages: Stages,
        room: Room,
        mounting: Mounting,
        train: Train,
        key: tuple[int | str, ...],
        since_s: float = -math.inf,
    ) -> None:
        self._since_s = since_s
        self._settings = settings
        self._stages = stages
        self._room = room
        self._mounting = mounting
        self._train = train
        self._key = key
        self._heads: dict[str, LaserHead] = {}
        self._noise: dict[tuple[str, int], FloatArray] = {}

    @cached_property
    def sensor(self) -> SensorRecord:
        """The sensor's output along the train."""
        return SensorRecord(
            self._settings,
            self._stages,
            self._room,
            self._mounting,
            self._train.first_s,
            self._train.period_s,
            self._key,
            self._since_s,
        )

    def covers(self, times_s: FloatArray) -> BoolArray:
        """Which times are at or near an edge of the train."""
        edges = self._nearest_edges(times_s)
        return (edges >= 0) & (edges < self._train.count)

    def displacement_mm(self, head: str, times_s: FloatArray) -> FloatArray:
        """What a head reads [mm], with the noise of the nearest edge."""
        if head not in self._heads:
            self._heads[head] = LaserHead(self._settings, self._stages, self._mounting, head)
        noise_mm = 1e-3 * self._settings.lasers[head].noise_um * self._noise_of_edges(head, times_s)
        return 1e3 * self._heads[head].reading_m(times_s) + noise_mm

    def _nearest_edges(self, times_s: FloatArray) -> Int64Array:
        return np.rint((times_s - self._train.first_s) / self._train.period_s).astype(np.int64)

    def _noise_of_edges(self, head: str, times_s: FloatArray) -> FloatArray:
        blocks, places = np.divmod(self._nearest_edges(times_s), _BLOCK)
        noise = np.empty(times_s.shape)
        for block in np.unique(blocks):
            chosen = blocks == block
            noise[chosen] = self._block_of_noise(head, int(block))[places[chosen]]
        return noise

    def _block_of_noise(self, head: str, block: int) -> FloatArray:
        if (head, block) not in self._noise:
            # In blocks by number: the noise of an edge without that of all before it.
            rng = generator(*self._key, "laser", head, block)
            self._noise[head, block] = rng.standard_normal(_BLOCK)
        return self._noise[head, block]
