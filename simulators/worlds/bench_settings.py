"""What nature is like on the sensing-axis bench: the `[world]` table of a rig file.

Numbers without another source are those of Lucente et al. 2022 (Planetary and Space Science 211) or chosen
for the twin. Only simulators read this.
"""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from simulators.benches import WorldTable
from simulators.worlds import effect_sizes
from simulators.worlds.effect_sizes import Scope
from simulators.worlds.rotations import Configuration, CubeAxis


class SensorConfiguration(WorldTable):
    """The sensor's second-order response in one configuration; `ideal` leaves only its gain."""

    frequency_hz: float = Field(ge=1e-3, le=1e6)
    # Above 0.5 a sensor rings; the integrator is one for such.
    q: float = Field(default=10.0, gt=0.5)
    gain_v_per_m_s2: float = Field(gt=0.0)
    ideal: bool = False


class SensorSettings(WorldTable):
    """One sensor of the package; `true_axis` is its sensing axis in the cube's frame (made a unit vector)."""

    cube_axis: CubeAxis
    true_axis: tuple[float, float, float]
    bias_v: float | None = None
    # Gravity stiffens the hanging sensor: its gain falls as the square of its frequency rises.
    pendulum: SensorConfiguration = SensorConfiguration(frequency_hz=4.53, gain_v_per_m_s2=59.7)
    flag: SensorConfiguration = SensorConfiguration(frequency_hz=3.5, gain_v_per_m_s2=100.0)

    @field_validator("true_axis")
    @classmethod
    def _unit(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        length = math.hypot(*axis)
        # Not `<= 0.0`, which would let NaN pass.
        if not length > 0.0:
            raise ValueError("true_axis has no direction; give three numbers, not all zero")
        x, y, z = axis
        return x / length, y / length, z / length

    def response(self, configuration: Configuration) -> SensorConfiguration:
        """The response in one configuration."""
        return self.pendulum if configuration == "pendulum" else self.flag


class LaserSettings(WorldTable):
    """One triangulation head: where it stands in the lab, how its beam is tilted, how well it reads."""

    position: Literal["+x", "+y", "+z"]
    # Tilted on purpose: seen head-on, a mirror-like face would blind the head.
    tilt_deg: float = Field(default=5.0, gt=-30.0, lt=30.0)
    noise_um: float = Field(default=0.05, ge=0.0)


class GroundNoiseSettings(WorldTable):
    """Ground acceleration, each component: white, and a microseism bump of its own height and full width."""

    asd_m_s2_rthz: float = Field(default=1e-6, ge=0.0)
    bump_frequency_hz: float = Field(default=0.2, gt=0.0, lt=10.0)
    bump_asd_m_s2_rthz: float = Field(default=3e-6, ge=0.0)
    bump_width_hz: float = Field(default=0.03, gt=0.0)


class TemperatureSettings(WorldTable):
    """mean + daily_k sin(2 pi t / day) + cycle_k sin(2 pi t / cycle_s) + drift_k_per_day t, t the rig time.

    In `room_s` it follows the operator.
    """

    mean_c: float = 20.0
    daily_k: float = 0.3
    cycle_k: float = 0.0
    cycle_s: float = Field(default=1200.0, gt=0.0)
    drift_k_per_day: float = 0.1
    room_s: float = Field(default=3600.0, ge=0.0)


class AngleSettings(WorldTable):
    """The rotation stage's encoder: its step, and how far a position may be off, in steps."""

    resolution_deg: float = Field(default=0.0001, gt=0.0)
    error_steps: float = Field(default=0.0, ge=0.0)


class BenchSettings(WorldTable):
    """The `[world]` table of a sensing-axis rig.

    `effects` maps an effect's id to its parameters' sizes in SI units, each for all (`kT`) or for one
    (`kT[X]`, `inv_w0_squared[X,pendulum]`, `dt[laser_2_mm]`). The sensors' own resonance needs no entry;
    an entry `resonance` replaces it. The lasers are aimed at the cube as it stands with the linear stage at
    `aim_mm` and the rotation stage at zero.
    """

    kind: Literal["sensing-axis"] = "sensing-axis"
    seed: int
    # Rome's.
    g_m_s2: float = Field(default=9.803, gt=0.0)
    sensors: dict[str, SensorSettings]
    lasers: dict[str, LaserSettings]
    # Two such angles at every mounting make the paper's 25 arcsec (2 sigma).
    scatter_arcsec: float = Field(default=12.5, ge=0.0)
    mounting_sigma_rad: float = Field(default=2e-3, ge=0.0)
    bias_sigma_v: float = Field(default=0.1, ge=0.0)
    range_v: float = Field(default=10.0, gt=0.0)
    level_residual_v: float = Field(default=0.5, ge=0.0, lt=1.0)
    cube_half_mm: float = Field(default=7.5, gt=0.0)
    lever_mm: float = 72.0
    aim_mm: float = 0.0
    laser_zero_mm: float = Field(default=1.0, ge=0.0)
    ground: GroundNoiseSettings = GroundNoiseSettings()
    temperature: TemperatureSettings = TemperatureSettings()
    angle: AngleSettings = AngleSettings()
    remount_s: float = Field(default=900.0, ge=0.0)
    level_s: float = Field(default=120.0, ge=0.0)
    effects: dict[str, dict[str, float]] = {}

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        members = {
            Scope.AXIS: set(self.sensors),
            Scope.AXIS_CONFIGURATION: {f"{axis},{c}" for axis in self.sensors for c in ("pendulum", "flag")},
            Scope.HEAD: set(self.lasers),
        }
        effect_sizes.check(self.effects, effect_sizes.EFFECTS, members)
        for axis in self.sensors:
            for configuration in ("pendulum", "flag"):
                inv_w0_squared, damping = self.resonance(axis, configuration)
                if (inv_w0_squared, damping) != (0.0, 0.0) and not 0.0 < damping**2 < 4.0 * inv_w0_squared:
                    raise ValueError(
                        f"effect 'resonance' of {axis}, {configuration}: a sensor that rings needs "
                        f"0 < damping < 2 sqrt(inv_w0_squared), or both zero for an ideal one"
                    )
        return self

    def size(self, effect: str, parameter: str, member: str = "") -> float:
        """The size of an effect's parameter for one axis, "axis,configuration" or head; 0 when absent."""
        return effect_sizes.size(self.effects, effect, parameter, member)

    def resonance(self, axis: str, configuration: Configuration) -> tuple[float, float]:
        """1 / w0^2 [s2] and 1 / (w0 Q) [s] of H = 1 / (1 - w^2 inv_w0_squared + j w damping)."""
        if "resonance" in self.effects:
            member = f"{axis},{configuration}"
            return self.size("resonance", "inv_w0_squared", member), self.size("resonance", "damping", member)
        response = self.sensors[axis].response(configuration)
        if response.ideal:
            return 0.0, 0.0
        w0 = 2.0 * math.pi * response.frequency_hz
        return w0**-2, 1.0 / (w0 * response.q)


def isa_twin(seed: int = 1) -> BenchSettings:
    """The twin of the rig of Lucente et al. 2022: axes of its Table 1, roll of its stage's specification."""
    return BenchSettings(
        seed=seed,
        sensors={
            "X": SensorSettings(cube_axis="X", true_axis=(0.99992, 1.4503e-3, 1.2822e-2)),
            "Y": SensorSettings(cube_axis="Y", true_axis=(-6.7925e-3, 0.99997, -1.9907e-3)),
            "Z": SensorSettings(cube_axis="Z", true_axis=(-1.2242e-2, 2.4100e-3, 0.99992)),
        },
        lasers={
            "laser_1_mm": LaserSettings(position="+x"),
            "laser_2_mm": LaserSettings(position="+y"),
            "laser_3_mm": LaserSettings(position="+z"),
        },
        # 0.5 arcsec over 25 mm.
        effects={"roll-gravity": {"rho1": 9.7e-5}},
    )
