"""What nature is like in orbit: the `[world]` table of a rig file with `kind = "drag-free-satellite"`.

Defaults are those of Hardy et al. (arXiv 1707.07630) or follow from its tables, except where that says nothing; loops
and densities are chosen. What is drawn is uniform within plus or minus the bounds. Only simulators read this.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from simulators.benches import WorldTable
from simulators.worlds import effect_sizes
from simulators.worlds.effect_sizes import Scope
from simulators.worlds.satellite.drag_file import ExternalAcceleration, external_acceleration
from simulators.worlds.satellite.effect_ids import EFFECTS, MASSES, NEVER_ZERO


class Bounds(WorldTable):
    """Half-widths of what a draw is drawn from; `_c` and `_d` are half sum and half difference of the masses."""

    off_centring_m: float = Field(default=20e-6, ge=0.0)
    centre_m: float = Field(default=2e-3, ge=0.0)
    scale: float = Field(default=1e-2, ge=0.0, lt=0.5)
    theta_c_rad: float = Field(default=2.5e-3, ge=0.0, lt=0.1)
    theta_d_rad: float = Field(default=1.5e-3, ge=0.0, lt=0.1)
    eta_rad: float = Field(default=1e-4, ge=0.0, lt=0.1)
    quadratic_s2_m: float = Field(default=14000.0, ge=0.0)
    parasitic_c_m_s2: float = Field(default=1e-8, ge=0.0)
    parasitic_d_m_s2: float = Field(default=1.4e-8, ge=0.0)
    bias_c_m_s2: float = Field(default=2e-8, ge=0.0)
    bias_d_m_s2: float = Field(default=1e-8, ge=0.0)
    gyro_bias_rad_s2: float = Field(default=1e-6, ge=0.0)
    tracker_bias_rad: float = Field(default=1e-4, ge=0.0)
    """One sigma of a normal distribution, not a bound."""
    thruster: float = Field(default=0.02, ge=0.0, lt=0.5)
    """Entries of the matrix from what is asked of the thrusters to what they do, times the lever arms."""


class Noise(WorldTable):
    """One-sided amplitude densities."""

    sensor_x_m_s2_rthz: float = Field(default=1.2e-12, ge=0.0)
    sensor_x_corner_hz: float = Field(default=5e-4, ge=0.0)
    readout_x_m_rthz: float = Field(default=3e-11, ge=0.0)
    sensor_yz_m_s2_rthz: float = Field(default=5e-12, ge=0.0)
    angular_rad_s2_rthz: float = Field(default=1e-9, ge=0.0)
    tracker_rad_rthz: float = Field(default=1.7e-5, ge=0.0)
    thrust_m_s2_rthz: float = Field(default=3e-9, ge=0.0)
    torque_rad_s2_rthz: float = Field(default=4e-8, ge=0.0)


class Loops(WorldTable):
    """Drag-free and attitude control."""

    drag_free_rad_s: float = Field(default=2.0 * math.pi * 0.05, gt=0.0)
    integral_rad_s: float = Field(default=2.0 * math.pi * 0.01, ge=0.0)
    thruster_lag_s: float = Field(default=1.0, gt=0.0)
    attitude_rad_s: float = Field(default=2.0 * math.pi * 0.02, gt=0.0)
    """sqrt(kp)."""
    attitude_damping: float = 1.6
    """kd / sqrt(kp)."""
    hybrid_rad_s: float = Field(default=2.0 * math.pi * 0.005, gt=0.0)


class Drag(WorldTable):
    """What acts from outside: levels, and amplitudes at the orbit's frequency and twice that; or forces of a file."""

    file: Path | None = None
    """In the place of the three forces. Torques stay."""
    area_m2: float = Field(default=2.0, gt=0.0)
    drag_coefficient: float = Field(default=2.2, gt=0.0)
    """Both for a file of the air's density and velocity."""
    force_m_s2: tuple[float, float, float] = (2e-8, -1e-8, 3e-8)
    force_1_m_s2: tuple[float, float, float] = (2e-8, 5e-9, -2e-8)
    """On cos M, sin M, sin M."""
    force_2_m_s2: tuple[float, float, float] = (5e-9, 2e-9, 5e-9)
    """On sin 2M, cos 2M, cos 2M."""
    torque_rad_s2: tuple[float, float, float] = (1e-7, -1e-7, 5e-8)
    torque_1_rad_s2: tuple[float, float, float] = (3e-8, 3e-8, 3e-8)
    """On cos M, sin M, cos M."""
    torque_2_rad_s2: tuple[float, float, float] = (1e-8, 3e-8, 2e-8)
    """On sin 2M, cos 2M, sin 2M."""


class Temperature(WorldTable):
    """How the sensors' temperature goes with the orbit: amplitudes at its frequency and twice that."""

    orbit_k: float = 1e-4
    orbit_phase_rad: float = 0.0
    twice_k: float = 1e-5
    twice_phase_rad: float = 0.0


class Missing(WorldTable):
    """Telemetry that never arrives: a fraction of the samples, in bursts of a length up to `burst_s`."""

    fraction: float = Field(default=0.0, ge=0.0, le=0.9)
    burst_s: float = Field(default=20.0, gt=0.0)


class SatelliteSettings(WorldTable):
    """The `[world]` table of a satellite's rig.

    `draw` numbers the instrument in the ensemble that `seed` makes. `effects` maps an effect's id to its parameters'
    sizes in SI units, each for both masses (`lambda`) or for one (`lambda[1]`).
    """

    kind: Literal["drag-free-satellite"]
    seed: int
    draw: int = Field(default=0, ge=0)
    orbit_period_s: float = Field(default=5950.0, gt=0.0)
    eccentricity: float = Field(default=5e-3, ge=0.0, lt=0.5)
    sample_period_s: float = Field(default=0.25, gt=0.0)
    settle_s: float = Field(default=6000.0, ge=0.0)
    noise_on: bool = True
    eotvos: float = Field(default=0.0, ge=-1e-6, le=1e-6)
    """How much more mass 2 falls than mass 1, over g: the electrodes push mass 1 along g by so much more."""
    range_m_s2: float = Field(default=1e-6, gt=0.0)
    """Where a sensor saturates."""
    mass_kg: tuple[float, float] = (0.4, 1.36)
    satellite_kg: float = Field(default=300.0, gt=0.0)
    bounds: Bounds = Bounds()
    noise: Noise = Noise()
    loops: Loops = Loops()
    drag: Drag = Drag()
    temperature: Temperature = Temperature()
    missing: Missing = Missing()
    effects: dict[str, dict[str, float]] = {}

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        effect_sizes.check(self.effects, EFFECTS, {Scope.MASS: set(MASSES)})
        for effect, parameter in NEVER_ZERO:
            if effect in self.effects and not all(self.size(effect, parameter, mass) > 0.0 for mass in MASSES):
                raise ValueError(f"effect '{effect}' needs a {parameter} above zero; write {parameter}")
        return self

    @model_validator(mode="after")
    def _readable_drag(self) -> Self:
        # A file that is wrong is told of when the rig file is, and not in the middle of a session.
        self.external()
        return self

    def external(self) -> ExternalAcceleration | None:
        """What the file says of the external acceleration; None without one."""
        drag = self.drag
        if drag.file is None:
            return None
        return external_acceleration(drag.file, drag.area_m2, drag.drag_coefficient, self.satellite_kg)

    def size(self, effect: str, parameter: str, mass: str = "") -> float:
        """The size of an effect's parameter for one mass; 0 when absent."""
        return effect_sizes.size(self.effects, effect, parameter, mass)
