"""A bench under test, driven through its axes, and plain sine fits of what it gives."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from simulators.worlds.accelerometer_bench import AccelerometerBench
from simulators.worlds.bench_settings import BenchSettings, isa_twin


@dataclass
class Harmonics:
    """Complex amplitudes with the phase of the displacement as zero, time as sin(w t): (fundamental, second)."""

    dc: float
    fundamental: complex
    second: complex


@dataclass
class Run:
    """What one train recorded."""

    times_s: FloatArray
    frequency_hz: float
    x_m: FloatArray
    accel_v: FloatArray
    lasers_mm: dict[str, FloatArray]

    @property
    def omega(self) -> float:
        return 2.0 * math.pi * self.frequency_hz

    @property
    def amplitude_m(self) -> float:
        return abs(self._raw(self.x_m)[1])

    def harmonics(self, samples: FloatArray) -> Harmonics:
        phase = self._raw(self.x_m)[1] / self.amplitude_m
        dc, first, second = self._raw(samples)
        return Harmonics(dc.real, first / phase, second / phase**2)

    def _raw(self, samples: FloatArray) -> tuple[complex, complex, complex]:
        wt = self.omega * (self.times_s - self.times_s[0])
        columns = [np.ones_like(wt)]
        for order in (1, 2, 3):
            columns += [np.sin(order * wt), np.cos(order * wt)]
        dc, s1, c1, s2, c2, _, _ = np.linalg.lstsq(np.stack(columns, axis=1), samples, rcond=None)[0]
        return complex(dc), complex(s1, c1), complex(s2, c2)


class BenchUnderTest:
    """A bench with its clock and axes; `run` measures as a rig would."""

    def __init__(self, settings: BenchSettings) -> None:
        self.settings = settings
        self.clock = VirtualClock()
        self.rotation = MotionAxis()
        self.linear = MotionAxis()
        self.trigger = TriggerLine()
        self.bench = AccelerometerBench(settings, self.clock, self.rotation, self.linear, self.trigger)

    def mount(self, axis: str = "X", configuration: str = "flag", mounting: int = 1, level: bool = True) -> None:
        self.wait_until(self.bench.remount(axis, configuration, mounting))
        if level:
            self.wait_until(self.bench.level())

    def wait_until(self, at_s: float) -> None:
        self.clock.sleep_s(at_s - self.clock.now_s())

    def turn_to(self, angle_deg: float) -> None:
        self.wait_until(self.rotation.move_to(self.clock.now_s(), angle_deg, 20.0, 80.0))

    def begin_run(
        self,
        angle_deg: float,
        frequency_hz: float = 0.5,
        amplitude_mm: float = 5.0,
        number: int = 1,
        cycles: int = 10,
        period_s: float = 0.01,
    ) -> FloatArray:
        """Turn, oscillate, and give a train over whole cycles; its edges, which have passed."""
        self.turn_to(angle_deg)
        self.linear.place(self.clock.now_s(), -amplitude_mm)
        self.linear.oscillate(self.clock.now_s(), frequency_hz, [amplitude_mm], math.inf)
        self.bench.announce_run(number)
        # Twenty seconds: what the start of the motion rang up in the sensor is gone.
        count = round(cycles / frequency_hz / period_s)
        self.trigger.begin(self.clock.now_s() + 20.0 + 1.0 / 3.0, period_s, count)
        self.wait_until(self.trigger.train.first_s + count * period_s)
        return self.trigger.edges(-math.inf, math.inf)[-count:]

    def run(self, angle_deg: float, frequency_hz: float = 0.5, **how: Any) -> Run:
        edges = self.begin_run(angle_deg, frequency_hz, **how)
        return Run(
            times_s=edges,
            frequency_hz=frequency_hz,
            x_m=1e-3 * self.linear.sample(edges)[0],
            accel_v=self.bench.accelerometer_v(edges),
            lasers_mm={head: self.bench.displacement_mm(head)(edges) for head in self.settings.lasers},
        )

    def response(self, angle_deg: float, frequency_hz: float = 0.5, **how: Any) -> Harmonics:
        """The accelerometer's harmonics at one setting."""
        run = self.run(angle_deg, frequency_hz, **how)
        return run.harmonics(run.accel_v)

    @property
    def truth(self) -> dict[str, Any]:
        """The truth of the latest mounting."""
        return self.bench.truth()["mountings"][-1]


QUIET = {
    "ground": {"asd_m_s2_rthz": 0.0, "bump_asd_m_s2_rthz": 0.0},
    "angle": {"error_steps": 0.0},
    "temperature": {"daily_k": 0.0, "drift_k_per_day": 0.0},
}


def twin(effects: dict[str, dict[str, float]], *, quiet: bool, ideal: bool, **changes: Any) -> BenchSettings:
    """The twin's settings with other effects; quiet: no noise; ideal: sensors that follow at once."""
    values = isa_twin(seed=5).model_dump() | {"effects": effects}
    if quiet:
        values |= QUIET
        for laser in values["lasers"].values():
            laser["noise_um"] = 0.0
    for sensor in values["sensors"].values():
        sensor["pendulum"]["ideal"] = sensor["flag"]["ideal"] = ideal
    return BenchSettings.model_validate(values | changes)


MakeBench = Callable[..., BenchUnderTest]


@pytest.fixture
def make_bench() -> MakeBench:
    """Builds a bench: `make_bench(effects, quiet=True, ideal=True, **settings)`."""

    def make(
        effects: dict[str, dict[str, float]] | None = None,
        *,
        quiet: bool = True,
        ideal: bool = True,
        **changes: Any,
    ) -> BenchUnderTest:
        return BenchUnderTest(twin(effects or {}, quiet=quiet, ideal=ideal, **changes))

    return make
