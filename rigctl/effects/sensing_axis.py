"""Effects of the sensing-axis experiment, in SI (Lucente et al. 2022; signs as in docs/physics.md)."""

from __future__ import annotations

import numpy as np

from rigctl.effects.catalogue import FloatArray, effect
from rigctl.experiments.sensing_axis.chain import Runs


@effect(
    "roll-gravity",
    on="specific_force_m_s2",
    parameters={"rho1": "rad/m"},
    typical={"rho1": 1e-4},
    source="Lucente et al. 2022, eq. 5",
)
def roll_gravity(run: Runs, rho1: FloatArray) -> FloatArray:
    """Guide twist tilts the sensor sideways: gravity enters, whatever the frequency."""
    return rho1 * run.x * run.g * np.cos(run.theta - run.theta0)


@effect(
    "resonance",
    on="sensor_output_v",
    parameters={"inv_w0_squared": "s2", "damping": "s"},
    typical={"inv_w0_squared": 2e-3, "damping": 4.5e-3},
    source="Lucente et al. 2022, eq. 1, normalised to unit gain at DC",
    scope="axis-configuration",
)
def resonance(run: Runs, inv_w0_squared: FloatArray, damping: FloatArray) -> FloatArray:
    """The proof mass is a damped spring: response grows towards its resonance and lags."""
    return run.filtered(lambda s: 1.0 / (1.0 + s**2 * inv_w0_squared + s * damping)) - run.signal
