"""Trying an effect out on made-up runs: shape, numbers, nothing at zero, every parameter used.

Only what is wrong whatever the recording is a flaw here. Whether an effect is a number in every run, and whether it
does anything there, a jump or a column of one's own for instance, is for the recording to say.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Any, Protocol

import numpy as np

from rigctl.effects.catalogue import POINTS, Effect, FloatArray

_READINGS = 24
_SAMPLES = 240
_NOTHING = 1e-12
_DIFFERENT = 1e-12


class _Signalled(Protocol):
    signal: FloatArray


class AnyColumns(dict[str, FloatArray]):
    """Every column there might be, filled with numbers between 1 and 2 that depend on its name.

    `asked` are the names of those that were looked at.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self.asked: list[str] = []

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str)

    def __getitem__(self, name: str) -> FloatArray:
        self.asked.append(name)
        rng = np.random.default_rng(list(name.encode()))
        return rng.uniform(1.0, 2.0, self._shape)


@dataclass
class MadeUpReadings:
    """What an effect on `response` may ask of a table: columns of numbers and the response so far, shape (n,)."""

    signal: FloatArray = field(default_factory=lambda: np.linspace(0.5, 2.0, _READINGS))
    columns: AnyColumns = field(default_factory=lambda: AnyColumns((_READINGS,)))

    def column(self, name: str) -> FloatArray:
        """A column of readings.csv, shape (n,)."""
        return self.columns[name]


def flaw_of_function(effect: Effect) -> str | None:
    """What is wrong with what the function returns; None when nothing is. Lets the function's own errors through."""
    run = made_up(effect)
    shape = _shape_of(run)
    sizes = _sizes(effect)
    absent = {name: np.asarray(0.0) for name in sizes}
    before = run.signal.copy()
    for parameters, how in ((absent, "with its parameters at zero"), (sizes, "at its typical size")):
        added = _returned(effect, run, parameters)
        flaw = _flaw_of_values(added, shape)
        if flaw:
            return f"{how} {flaw}"
        if not run.columns.asked and not _is_a_number_somewhere(added, shape):
            return f"{how} it returns nan or inf in every run"
    if not np.array_equal(before, run.signal):
        return "it changes run.signal in place; return what is added instead"
    if np.any(np.abs(_returned(effect, run, absent)) > _NOTHING * np.abs(run.signal).max()):
        return "it adds something with its parameters at zero; choose parameters so that zero means absent"
    for name in sizes:
        if not _depends(effect, run, sizes, name) and not _uses(effect, run, sizes, name):
            return f"what it adds does not depend on {name}; use it, or leave it out"
    return None


def columns_of(effect: Effect) -> tuple[str, ...]:
    """The columns of a laboratory's own that an effect asks for, in the order in which it does."""
    run = made_up(effect)
    _returned(effect, run, _sizes(effect))
    return tuple(dict.fromkeys(run.columns.asked))


def _shape_of(run: Any) -> tuple[int, ...]:
    """Runs by points of a period, masses by axes by samples, or readings."""
    return np.broadcast_shapes(np.shape(run.t), np.shape(run.signal)) if hasattr(run, "t") else np.shape(run.signal)


def _sizes(effect: Effect) -> dict[str, FloatArray]:
    return {name: np.asarray(size, dtype=np.float64) for name, size in effect.typical.items()}


def _flaw_of_values(values: Any, shape: tuple[int, ...]) -> str | None:
    """Why values cannot be added to a signal of `shape`; None when they can."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return f"it returns {type(values).__name__}, not an array of numbers"
    try:
        fits = np.broadcast_shapes(numbers.shape, shape) == shape
    except ValueError:
        fits = False
    if not fits:
        return f"it returns an array of shape {numbers.shape}, which does not fit run.signal's {shape}"
    return None


def _is_a_number_somewhere(values: Any, shape: tuple[int, ...]) -> bool:
    """Whether there is a run, or a reading, all of whose values are finite."""
    by_run = np.broadcast_to(np.asarray(values, dtype=np.float64), shape).reshape(shape[0], -1)
    return bool(np.isfinite(by_run).all(axis=1).any())


def made_up(effect: Effect) -> Any:
    """Runs that differ in every condition, or readings, at the point where the effect acts."""
    if effect.on == "response":
        return MadeUpReadings()
    if effect.on in POINTS["inflight-calibration"]:
        from rigctl.experiments.inflight.flight import made_up_flight

        return made_up_flight(effect.on, AnyColumns((_SAMPLES,)))
    if effect.on in POINTS["rotating-platform"]:
        return _made_up_platform(effect.on)
    return _made_up_runs(effect.on)


def _made_up_platform(point: str) -> Any:
    from rigctl.experiments.rotating_platform.chain import PlatformRuns

    rng = np.random.default_rng(1)
    cells = 48

    def scattered(low: float, high: float) -> FloatArray:
        return np.asarray(rng.uniform(low, high, cells))

    t = np.linspace(0.0, 1410.0, cells)
    sign = np.where(np.arange(cells) % 2, -1.0, 1.0)
    a_z, a_y = scattered(1e-4, 2e-3), scattered(-1e-3, -1e-4)
    force = sign * a_z
    signals = {
        "platform_angle_rad": np.zeros(cells) + 1e-5,
        "force_m_s2": force,
        "reading_m_s2": force + scattered(-2e-3, 2e-3),
    }
    return PlatformRuns(
        channel="z",
        t=t,
        within=t - 720.0,
        cos=sign,
        sin=scattered(-1e-3, 1e-3),
        since=scattered(0.0, 20.0),
        direction=-sign,
        speed_squared=scattered(0.0, 1e-2),
        turning=scattered(-1e-2, 1e-2),
        c_y=scattered(-1e-3, 1e-3),
        c_z=scattered(0.0, 2e-3),
        temperature=scattered(15.0, 30.0),
        period=np.full(cells, 60.0),
        g=9.8,
        columns=AnyColumns((cells,)),
        a_y=a_y,
        a_z=a_z,
        along=force,
        across=sign * a_y,
        signal=signals[point],
    )


def _made_up_runs(point: str) -> Any:
    from rigctl.experiments.sensing_axis.chain import Origins, Runs, periodic_motion

    rows = list(product("XYZ", ("pendulum", "flag"), (0.3, 0.6), (-1.0, 1.0)))
    rng = np.random.default_rng(1)

    def column(values: Any) -> FloatArray:
        return np.asarray(values, dtype=np.float64)[:, None]

    def scattered(low: float, high: float) -> FloatArray:
        return column(rng.uniform(low, high, len(rows)))

    omega = column([2.0 * np.pi * frequency for _, _, frequency, _ in rows])
    amplitude = scattered(3e-3, 6e-3)
    t, x, v, a = periodic_motion(np.asarray(-1j * amplitude, dtype=np.complex128), omega)
    theta, theta0 = scattered(-0.02, 0.02), scattered(-0.01, 0.01)
    force = -np.sin(theta - theta0) * a
    signals = {
        "motion_m": x,
        "angle_rad": theta,
        "null_rad": theta0,
        "specific_force_m_s2": force,
        "sensor_output_v": 80.0 * force + scattered(-1.0, 1.0),
        "laser_m": 0.9 * x,
    }
    start = column(120.0 * np.arange(len(rows)))
    temperature = scattered(-10.0, 50.0)
    return Runs(
        t=t,
        x=x,
        v=v,
        a=a,
        theta=theta,
        theta0=theta0,
        omega=omega,
        amplitude=amplitude,
        g=9.8,
        temperature=temperature,
        approach=column([approach for *_, approach in rows]),
        start=start,
        middle=start + 30.0,
        axis=np.array([[axis] for axis, *_ in rows]),
        configuration=np.array([[configuration] for _, configuration, *_ in rows]),
        origins=Origins(float(temperature.mean()), float(start.mean()) + 30.0),
        columns=AnyColumns((len(rows), 1)),
        signal=signals[point],
        head="laser_2_mm" if point == "laser_m" else "",
        along=np.full((len(rows), 1), 0.999),
        across=scattered(-0.01, 0.01),
        tilt=0.09,
        side=np.ones((len(rows), 1)),
    )


def _returned(effect: Effect, run: _Signalled, parameters: dict[str, FloatArray]) -> Any:
    with np.errstate(all="ignore"):
        return effect.function(run, **parameters)


def _depends(effect: Effect, run: _Signalled, sizes: dict[str, FloatArray], name: str) -> bool:
    """Whether doubling or dropping one parameter makes a difference."""
    here, *others = (
        np.broadcast_to(_returned(effect, run, {**sizes, name: factor * sizes[name]}), _shape_of(run))
        for factor in (1.0, 0.0, 2.0)
    )
    known = np.isfinite(here)
    size = np.max(np.abs(here[known]), initial=0.0)
    return any(np.any(np.abs(there[known] - here[known]) > _DIFFERENT * size) for there in others)


class _Touchstone:
    """No number: whatever works with it fails, or is none either."""


def _uses(effect: Effect, run: Any, sizes: dict[str, FloatArray], name: str) -> bool:
    """Whether the function works with a parameter at all, be it for other runs than these."""
    parameters: dict[str, Any] = {**sizes, name: _Touchstone()}
    try:
        return np.asarray(_returned(effect, run, parameters)).dtype == np.dtype(object)
    except Exception:  # noqa: BLE001 - it fails because it is used
        return True
