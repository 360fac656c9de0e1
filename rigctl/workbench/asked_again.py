"""What a model was asked last: a fit that goes on from where another ended, and noise told beside it, ask again."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar
from weakref import ref

import numpy as np

from rigctl.core.arrays import FloatArray

M = TypeVar("M")


def once_in_a_row(method: Callable[[M, FloatArray], FloatArray]) -> Callable[[M, FloatArray], FloatArray]:
    """A model's method of parameter values: at the values of the last call the array of the last call, which is not
    to be written to. One array is kept for all models: those of long tables are large."""
    last: list[tuple[Callable[[], Any], bytes, FloatArray]] = []

    @wraps(method)
    def asked(model: M, values: FloatArray) -> FloatArray:
        at = np.asarray(values, dtype=np.float64)
        for whose, where, found in last:
            if whose() is model and where == at.tobytes():
                return found
        made = method(model, at)
        made.flags.writeable = False
        last[:] = [(ref(model), at.tobytes(), made)]
        return made

    return asked
