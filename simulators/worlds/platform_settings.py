"""What nature is like on the rotating platform: the `[world]` table of a rig file with `kind = "rotating-platform"`.

Numbers without another source are those of Lenoir, Christophe, Reynaud 2013 (Measurement 46, 1411), or follow
from them: with these the recording has its eq. 6 and eq. 13. Only simulators read this.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from simulators.benches import WorldTable
from simulators.worlds import effect_sizes
from simulators.worlds.bench_settings import TemperatureSettings
from simulators.worlds.effect_sizes import Scope
from simulators.worlds.platform_effects import CHANNELS, EFFECTS, NEVER_ZERO


class ChainSettings(WorldTable):
    """A Q-Flex, its amplifier and filter: true scale factor and electrical bias at the output; its axis' elevation.

    `amplifier` is the amplifier's gain, left out when the sensor is turned over to feel all of g.
    """

    scale_v_per_m_s2: float = Field(gt=0.0)
    amplifier: float = Field(gt=0.0)
    bias_v: float = 0.0
    wobble_rad: float = 0.0


class ServoSettings(WorldTable):
    """The servo accelerometer that holds the pendulum: it follows (command - bias) / scale, off by g misalignment."""

    scale_v_per_m_s2: float = Field(gt=0.0)
    bias_v: float = 0.0
    misalignment_rad: float = 0.0


class ChainNoiseSettings(WorldTable):
    """Two-sided density at the output of a chain: white + red / f^exponent.

    `folding` is how often the band above the Nyquist frequency is folded down: 1 behind a good anti-alias filter.
    """

    white_v2_hz: float = Field(default=3.1925e-5, ge=0.0)
    red_v2_hz: float = Field(default=9.052e-8, ge=0.0)
    exponent: float = Field(default=1.6384, gt=0.0, lt=2.0)
    knee_hz: float = Field(default=1e-7, gt=0.0, lt=1e-3)
    folding: float = Field(default=1.0, ge=1.0)

    @model_validator(mode="after")
    def _red_needs_white(self) -> Self:
        # The filter's design divides by the white part.
        if self.red_v2_hz > 0.0 and self.white_v2_hz == 0.0:
            raise ValueError("red_v2_hz needs some white_v2_hz beside it")
        return self


class PendulumNoiseSettings(WorldTable):
    """One-sided amplitude density of the pendulum's acceleration, rising as f^2 above the corner to a cap."""

    asd_m_s2_rthz: float = Field(default=3e-8, ge=0.0)
    corner_hz: float = Field(default=0.2, gt=0.0)
    cap: float = Field(default=100.0, ge=1.0)


class AdcSettings(WorldTable):
    """The converter at the end of a chain: 2^bits steps over its range, beyond which it saturates."""

    range_v: float = Field(default=10.0, gt=0.0)
    bits: int = Field(default=16, ge=8, le=32)

    @property
    def step_v(self) -> float:
        """One step."""
        return 2.0 * self.range_v / 2.0**self.bits


class PlatformSettings(WorldTable):
    """The `[world]` table of a rotating-platform rig.

    Chain A is the z channel, chain B the y channel. `effects` maps an effect's id to its parameters' sizes in SI
    units, each for both channels (`e1`) or for one (`e1[z]`).
    """

    kind: Literal["rotating-platform"]
    seed: int
    g_m_s2: float = Field(default=9.81, gt=0.0)
    # The paper prints biases of -224.50 V and -52.19 V. Over the amplifier's gain, and with the signs that its
    # wobbles ask for, they are these.
    chain_a: ChainSettings = ChainSettings(
        scale_v_per_m_s2=846.73, amplifier=1010.9, bias_v=0.2221, wobble_rad=-8.07e-5
    )
    chain_b: ChainSettings = ChainSettings(
        scale_v_per_m_s2=804.32, amplifier=990.54, bias_v=-0.0527, wobble_rad=1.394e-4
    )
    servo_y: ServoSettings = ServoSettings(scale_v_per_m_s2=805.0, misalignment_rad=3.0377e-5)
    servo_z: ServoSettings = ServoSettings(scale_v_per_m_s2=855.81, bias_v=-0.53195, misalignment_rad=3.4047e-5)
    chain_noise: ChainNoiseSettings = ChainNoiseSettings()
    pendulum_noise: PendulumNoiseSettings = PendulumNoiseSettings()
    adc: AdcSettings = AdcSettings()
    repeatability_rad: float = Field(default=5.2e-6, ge=0.0)
    temperature: TemperatureSettings = TemperatureSettings(mean_c=22.0, drift_k_per_day=0.0)
    flip_s: float = Field(default=600.0, ge=0.0)
    effects: dict[str, dict[str, float]] = {}

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        effect_sizes.check(self.effects, EFFECTS, {Scope.CHANNEL: set(CHANNELS)})
        for effect, parameter in NEVER_ZERO:
            sizes = self.effects.get(effect)
            if sizes is not None and any(not self.size(effect, parameter, channel) > 0.0 for channel in CHANNELS):
                raise ValueError(f"effect '{effect}' needs a {parameter} above zero; write {parameter}")
        if any(self.size("clock-skew", name, channel) < 0.0 for name in ("delay", "drift") for channel in CHANNELS):
            raise ValueError("effect 'clock-skew' makes the motion late: delay and drift cannot be negative")
        return self

    def size(self, effect: str, parameter: str, channel: str = "") -> float:
        """The size of an effect's parameter in one channel; 0 when absent."""
        return effect_sizes.size(self.effects, effect, parameter, channel)
