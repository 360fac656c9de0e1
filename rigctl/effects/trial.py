"""Trying an effect out on made-up runs: shape, numbers, nothing at zero, every parameter used.

Only what is wrong whatever the recording is a flaw here. Whether an effect is a number in every run, and whether it
does anything there, a jump or a column of one's own for instance, is for the recording to say.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect, experiment_of

# Of the largest signal, and of the effect's own size: rounding.
_NOTHING = 1e-12
_DIFFERENT = 1e-12


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
        # Never zero nor negative: an effect may divide by a column or take its logarithm.
        return rng.uniform(1.0, 2.0, self._shape)


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
        # One that asks for columns of the laboratory's own is judged on the recording: those here are made up.
        if not run.columns.asked and not _is_a_number_somewhere(added, shape):
            return f"{how} it returns nan or inf in every run"
    if not np.array_equal(before, run.signal):
        return "it changes run.signal in place; return what is added instead"
    once, again = (np.asarray(_returned(effect, run, sizes), dtype=np.float64) for _ in range(2))
    if not np.array_equal(once, again, equal_nan=True):
        return "it returns other numbers when it is called again; leave chance, time and memory out of it"
    if np.any(np.abs(_returned(effect, run, absent)) > _NOTHING * np.abs(run.signal).max()):
        return "it adds something with its parameters at zero; choose parameters so that zero means absent"
    for name in sizes:
        # Two ways: a parameter may act on other runs only (after a time, above a limit), but still be used.
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
    if np.iscomplexobj(values):
        return "it returns complex numbers, not real ones; return the part that is added"
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
    experiment = experiment_of(effect)
    return experiment.load(experiment.trial_run)(effect.on)


def _returned(effect: Effect, run: Any, parameters: dict[str, FloatArray]) -> Any:
    with np.errstate(all="ignore"):
        return effect.function(run, **parameters)


def _depends(effect: Effect, run: Any, sizes: dict[str, FloatArray], name: str) -> bool:
    """Whether doubling or dropping one parameter makes a difference."""
    here, *others = (
        np.broadcast_to(_returned(effect, run, {**sizes, name: factor * sizes[name]}), _shape_of(run))
        # Two changes: an effect that is periodic in a parameter may be the same after one of them.
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
