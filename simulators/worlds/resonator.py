"""The sensor's second-order response, integrated in time."""

from __future__ import annotations

import cmath
import math
from typing import Protocol

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from simulators.worlds.recursion import first_order


class Response(Protocol):
    """What turns the force on a sensor into its deflection, step by step."""

    def begin(self, force: float) -> None:
        """Settle under a constant force."""
        ...

    def advance(self, force: FloatArray) -> FloatArray:
        """Deflections after each step, in the force's unit; `force` at the middle and end of each step."""
        ...


class Ideal:
    """A sensor that follows at once."""

    def begin(self, force: float) -> None:
        """Settle under a constant force."""

    def advance(self, force: FloatArray) -> FloatArray:
        """Deflections after each step, in the force's unit; `force` at the middle and end of each step."""
        return force[1::2]


class _Pole:
    """z' = p z + f, exact for a force that is quadratic in time within a step."""

    def __init__(self, pole: complex, step_s: float) -> None:
        self._pole = pole
        growth = pole * step_s
        self._decay = cmath.exp(growth)
        # Integrals of exp(p (h - s)) (s / h)^n over a step.
        flat = (self._decay - 1.0) / pole
        linear = flat / growth - 1.0 / pole
        square = 2.0 * linear / growth - 1.0 / pole
        self._weights = (
            flat - 3.0 * linear + 2.0 * square,
            4.0 * linear - 4.0 * square,
            2.0 * square - linear,
        )
        self._force = 0.0
        self._state = 0.0 + 0.0j

    def begin(self, force: float) -> None:
        """Settle under a constant force."""
        self._force = force
        self._state = -force / self._pole

    def states(self, force: FloatArray) -> ComplexArray:
        """z after each step; `force` at the middle and end of each step."""
        middle, end = force[0::2], force[1::2]
        start = np.concatenate([[self._force], end[:-1]])
        at_start, at_middle, at_end = self._weights
        driven = at_start * start + at_middle * middle + at_end * end
        states = first_order(self._decay, driven, self._state)
        self._force, self._state = float(end[-1]), complex(states[-1])
        return states


class Resonator(_Pole):
    """y'' inv_w0_squared + y' damping + y = f, exact for a force that is quadratic in time within a step.

    With p the pole in the upper half plane, y is the imaginary part of w0^2 / Im(p) times z, z' = p z + f.
    With w0 = 2 pi 3.5 Hz and a step of 10 ms the gain at 1 Hz is right to 2e-8.
    """

    def __init__(self, inv_w0_squared: float, damping: float, step_s: float) -> None:
        half = 0.5 * damping / inv_w0_squared
        pole = complex(-half, math.sqrt(1.0 / inv_w0_squared - half**2))
        self._gain = 1.0 / (inv_w0_squared * pole.imag)
        super().__init__(pole, step_s)

    def advance(self, force: FloatArray) -> FloatArray:
        """Deflections after each step, in the force's unit; `force` at the middle and end of each step."""
        return np.asarray(self._gain * self.states(force).imag, dtype=np.float64)


class Lag(_Pole):
    """y' tau + y = f, in the same way."""

    def __init__(self, tau_s: float, step_s: float) -> None:
        super().__init__(complex(-1.0 / tau_s), step_s)
        self._tau_s = tau_s

    def advance(self, force: FloatArray) -> FloatArray:
        """What follows, after each step; `force` at the middle and end of each step."""
        return np.asarray(self.states(force).real / self._tau_s, dtype=np.float64)


def response(inv_w0_squared: float, damping: float, step_s: float) -> Response:
    """A resonator, or an ideal sensor when both numbers are zero."""
    return Resonator(inv_w0_squared, damping, step_s) if inv_w0_squared > 0.0 else Ideal()
