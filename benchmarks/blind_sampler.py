"""Samples of the simulated world at a scan's set-points, without instruments: some 60 runs a second.

The physics is the world's own, integrated in the time domain; no model, effect or reduction of the application is in
it. `Perturbation` adds what no catalogue has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from procedures.sensing_axis.bench import SetPoint
from procedures.sensing_axis.mounting import Seated
from procedures.sensing_axis.scan import stretches
from procedures.sensing_axis.tables import Procedure
from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.motion import MotionAxis
from simulators.wiring import Train
from simulators.worlds import mounting as mountings
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.bench_train import BenchTrain
from simulators.worlds.mounting import Mounting
from simulators.worlds.rotations import Configuration, about_z, nominal_table_from_cube
from simulators.worlds.sensor import Electronics
from simulators.worlds.specific_force import vertical_lab
from simulators.worlds.stages import Stages
from simulators.worlds.temperature import Room

REMOUNT_S = 1200.0
SETTLE_S = 24.0
"""The sensor's story begins up to 18 s before a run; the stages move as in the run by then."""

AFTER_S = 3.0
METER_NOISE_V = 2e-5
METER_RANGE_V = 10.0
HEAD_STEP_MM = 1e-4
OVERSHOOT_DEG = 0.05


@dataclass(frozen=True)
class Design:
    """What a blind trial measures: a randomised scan, begun at `start_s` of the world's clock."""

    axes: tuple[str, ...] = ("X", "Y")
    configurations: tuple[str, ...] = ("pendulum", "flag")
    angles_deg: tuple[float, ...] = (-30.0, -20.0, -10.0, -3.0, -1.5, -0.7, 0.7, 1.5, 3.0, 10.0, 20.0, 30.0)
    frequencies_hz: tuple[float, ...] = (0.3, 0.5, 0.6)
    approaches: tuple[int, ...] = (1, -1)
    amplitudes_mm: tuple[float, ...] = (5.0,)
    dwell_s: float = 20.0
    sample_rate_hz: float = 100.0
    order_seed: int = 1
    start_s: float = 18000.0

    @property
    def points(self) -> list[tuple[tuple[str, str, int], list[SetPoint]]]:
        """The set-points by mounting, in the order measured."""
        procedure = Procedure.model_validate(
            {
                "name": "scan",
                "axes": self.axes,
                "configurations": self.configurations,
                "angles_deg": self.angles_deg,
                "frequencies_hz": self.frequencies_hz,
                "approaches": self.approaches,
                "amplitudes_mm": self.amplitudes_mm,
                "dwell_s": self.dwell_s,
                "sample_rate_hz": self.sample_rate_hz,
                "order_seed": self.order_seed,
            }
        )
        return [
            (
                (each.mounting.axis, each.mounting.configuration, each.mounting.number),
                [wanted.point for wanted in each.wanted],
            )
            for each in stretches(procedure, Seated())
        ]


@dataclass(frozen=True)
class Perturbation:
    """What acts on a run beyond the world's catalogue.

    `angle_rad(theta)` is how far the turntable stands beyond its reading; `volts(run)` is added to the output;
    `columns` are further conditions, drawn by run number.
    """

    angle_rad: Callable[[float], float] = lambda _: 0.0
    volts: Callable[[SampledRun], FloatArray] | None = None
    columns: dict[str, Callable[[int], float]] = field(default_factory=dict)


@dataclass(frozen=True)
class SampledRun:
    """One run: its conditions as in runs.csv and its columns."""

    number: int
    conditions: dict[str, Any]
    columns: dict[str, FloatArray]
    gain_v_per_m_s2: float


Tweak = Callable[[Mounting], Mounting]


def sample_world(
    nature: BenchSettings,
    design: Design,
    perturbation: Perturbation | None = None,
    *,
    noisy: bool = True,
    tweak: Tweak | None = None,
) -> list[SampledRun]:
    """Every run of the design in this nature; the same arguments give the same bits.

    Not `noisy` leaves out ground, meter and heads. `tweak` alters each mounting after it was levelled.
    """
    added = perturbation or Perturbation()
    world = nature if noisy else without_noise(nature)
    found: list[SampledRun] = []
    for seated, points in _mountings(world, design):
        mounting = tweak(seated) if tweak else seated
        for point, at_s in points:
            run = _sample(world, mounting, point, len(found) + 1, at_s, added)
            found.append(_read_out(run, world) if noisy else run)
    return found


def nulls_deg(nature: BenchSettings, design: Design) -> dict[tuple[str, str, int], float]:
    """Nature's theta0 of each mounting: the turntable's true angle at which the sensor is square to the motion."""
    found = {}
    for mounting, _ in _mountings(nature, design):
        x, y, _ = mounting.sensing_axis_table
        found[mounting.key] = math.degrees(math.atan2(x, y))
    return found


def _mountings(nature: BenchSettings, design: Design) -> Iterator[tuple[Mounting, list[tuple[SetPoint, float]]]]:
    """Each mounting, levelled, and its set-points with the time at which they are turned to."""
    at_s = design.start_s
    for (axis, configuration, number), points in design.points:
        at_s += REMOUNT_S
        mounting = _mounted(nature, axis, configuration, number, at_s)
        timed = []
        for point in points:
            timed.append((point, at_s))
            at_s += SETTLE_S + point.dwell_s + AFTER_S
        yield mounting, timed


def without_noise(nature: BenchSettings) -> BenchSettings:
    """The same nature with ground and heads silent."""
    heads = {name: head.model_copy(update={"noise_um": 0.0}) for name, head in nature.lasers.items()}
    return on_still_ground(nature).model_copy(update={"lasers": heads})


def on_still_ground(nature: BenchSettings) -> BenchSettings:
    """The same nature where only the heads have noise."""
    still = nature.ground.model_copy(update={"asd_m_s2_rthz": 0.0, "bump_asd_m_s2_rthz": 0.0})
    return nature.model_copy(update={"ground": still})


def _mounted(nature: BenchSettings, axis: str, configuration: str, number: int, at_s: float) -> Mounting:
    known: Configuration = "pendulum" if configuration == "pendulum" else "flag"
    seated = mountings.mount(nature, axis, known, number)
    wanted_m_s2 = Electronics(nature, seated, Room(nature.temperature)).felt_m_s2(seated.level_v, at_s)
    angle_rad = float(Stages(nature, MotionAxis(), MotionAxis()).angle_rad(np.array([at_s]))[0])
    vertical = about_z(-angle_rad) @ vertical_lab(nature)
    return mountings.levelled(seated, vertical, wanted_m_s2 / nature.g_m_s2)


def _sample(
    nature: BenchSettings, mounting: Mounting, point: SetPoint, number: int, at_s: float, added: Perturbation
) -> SampledRun:
    stands_deg = point.theta_deg + math.degrees(added.angle_rad(math.radians(point.theta_deg)))
    rotation = MotionAxis(stands_deg - point.approach * OVERSHOOT_DEG)
    rotation.move_to(at_s, stands_deg, 10.0, 40.0)
    linear = MotionAxis(-point.amplitude_mm)
    linear.oscillate(at_s + 1.0, point.frequency_hz, (point.amplitude_mm,), math.inf)
    first_s = at_s + SETTLE_S
    train = Train(first_s, 1.0 / point.sample_rate_hz, point.samples)
    room = Room(nature.temperature)
    key = (nature.seed, *mounting.key, number, "train", 0)
    bench = BenchTrain(nature, Stages(nature, rotation, linear), room, mounting, train, key)
    # From the train's own grid, so that no time falls between two of its steps.
    t_s = train.period_s * np.arange(train.count, dtype=np.float64)
    columns = {"t_s": t_s, "stage_x_mm": linear.sample(first_s + t_s)[0]}
    columns["accel_v"] = bench.sensor.output_v(first_s + t_s)
    heads = {name: bench.displacement_mm(name, first_s + t_s) for name in nature.lasers}
    columns |= {name: values for name, values in heads.items() if np.isfinite(values).all()}
    conditions: dict[str, Any] = {
        "axis": mounting.axis,
        "configuration": mounting.configuration,
        "mounting": mounting.number,
        "theta_deg": point.theta_deg,
        "approach": point.approach,
        "frequency_hz": point.frequency_hz,
        "amplitude_mm": point.amplitude_mm,
        "temperature_c": float(np.round(room.temperature_c(first_s + t_s).mean(), 3)),
        "start_s": first_s,
    }
    conditions |= {name: draw(number) for name, draw in added.columns.items()}
    conditions |= {
        f"{name.removesuffix('_mm')}_face": _face(nature, mounting, head.position)
        for name, head in nature.lasers.items()
    }
    gain = nature.sensors[mounting.axis].response(mounting.configuration).gain_v_per_m_s2
    run = SampledRun(number, conditions, columns, gain)
    if added.volts is None:
        return run
    return replace(run, columns={**columns, "accel_v": columns["accel_v"] + added.volts(run)})


def _read_out(run: SampledRun, nature: BenchSettings) -> SampledRun:
    """The meter's noise and the heads' steps."""
    rng = generator(nature.seed, "meter", run.number)
    columns = dict(run.columns)
    volts = columns["accel_v"] + METER_NOISE_V * rng.standard_normal(len(columns["accel_v"]))
    columns["accel_v"] = np.clip(volts, -METER_RANGE_V, METER_RANGE_V)
    for name in nature.lasers:
        if name in columns:
            columns[name] = HEAD_STEP_MM * np.rint(columns[name] / HEAD_STEP_MM)
    return replace(run, columns=columns)


def _face(nature: BenchSettings, mounting: Mounting, position: str) -> str:
    outward = np.array([float(position[1] == axis) for axis in "xyz"])
    cube = nominal_table_from_cube(nature.sensors[mounting.axis].cube_axis, mounting.configuration).T @ outward
    component = int(np.argmax(np.abs(cube)))
    return ("-" if cube[component] < 0 else "") + "xyz"[component]


def columns_of(runs: Sequence[SampledRun]) -> set[str]:
    """Every sample column that appears."""
    return {name for run in runs for name in run.columns}
