"""One measuring chain on the platform: a horizontal accelerometer, its amplifier, its filter and its converter."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray, Int64Array
from simulators.keyed_random import generator
from simulators.worlds.platform_effects import EFFECTS
from simulators.worlds.platform_filter import RingingFilter
from simulators.worlds.platform_noise import BLOCK, NoiseStream, PowerLaw, RisingNoise
from simulators.worlds.platform_pendulum import Pendulum
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.platform_turntable import Attitude, Turntable
from simulators.worlds.temperature import Room

CHAINS = {"q_a_v": "z", "q_b_v": "y"}
"""The chains by the column they fill, and the channel each is."""

REFERENCE_C = 22.0
"""Where the thermal bias is zero."""


class IndexedNoise:
    """A stream by sample number; numbers come in any order within the last block or so, and never much before."""

    def __init__(self, stream: NoiseStream) -> None:
        self._stream = stream
        self._begin = 0
        self._kept = np.empty(0)

    def at(self, index: Int64Array) -> FloatArray:
        """The noise at sample numbers of the record."""
        if not index.size:
            return np.empty(0)
        first, last = int(index.min()), int(index.max())
        if first < self._begin:
            raise ValueError(f"the noise of sample {first} is forgotten; ask in order of time")
        while (missing := last + 1 - self._begin - len(self._kept)) > 0:
            # In pieces: the noise of a gap is made and forgotten, and need not be in memory at once.
            fresh = self._stream.take(min(missing, 64 * BLOCK))
            self._kept = np.concatenate([self._kept, fresh])
            self._forget(first - BLOCK)
        self._forget(first - BLOCK)
        return self._kept[index - self._begin]

    def _forget(self, before: int) -> None:
        needless = min(max(before - self._begin, 0), len(self._kept))
        self._kept = self._kept[needless:]
        self._begin += needless


class ChainRecord:
    """The output of one chain along a record, sample by sample from `first_s` on; its randomness by `key` alone."""

    def __init__(
        self,
        settings: PlatformSettings,
        turntable: Turntable,
        pendulum: Pendulum,
        room: Room,
        column: str,
        first_s: float,
        period_s: float,
        key: tuple[int | str, ...],
    ) -> None:
        self._settings = settings
        self._channel = CHAINS[column]
        self._sizes = {
            (effect, parameter): settings.size(effect, parameter, self._channel)
            for effect in settings.effects
            for parameter in EFFECTS[effect].parameters
        }
        self._chain = settings.chain_a if self._channel == "z" else settings.chain_b
        self._turntable, self._pendulum, self._room = turntable, pendulum, room
        self._first_s, self._period_s = first_s, period_s
        self._line_phase = generator(*key, "line", self._channel).uniform(-math.pi, math.pi)
        self._noise = _chain_noise(settings, 1.0 / period_s, *key, "chain", column)
        self._shaking = {axis: _pendulum_noise(settings, 1.0 / period_s, *key, "pendulum", axis) for axis in "yz"}
        self._lever = self._lever_m()
        cutoff_hz = self._size("filter-ringing", "cutoff")
        self._ringing = RingingFilter(cutoff_hz, turntable, self._inertial) if cutoff_hz else None

    def output_v(self, times_s: FloatArray, flipped: int = 0) -> FloatArray:
        """What is read [V]; with `flipped` +1 or -1 the sensor feels g alone, read past amplifier and converter.

        Without the amplifier's noise the converter's steps, of a few times the bias, would be all there is to see.
        """
        index = np.rint((times_s - self._first_s) / self._period_s).astype(np.int64)
        noise_v = self._noise.at(index) if self._noise else np.zeros(times_s.shape)
        if flipped:
            felt = np.full(times_s.shape, flipped * self._settings.g_m_s2)
            return (self._amplified(felt, times_s) + noise_v) / self._chain.amplifier
        return self._converted(self._amplified(self._felt(times_s, index), times_s) + noise_v)

    def _felt(self, times_s: FloatArray, index: Int64Array) -> FloatArray:
        """Force along the sensing axis [m/s2]."""
        own_s = self._turntable.own_time(times_s)
        attitude = self._turntable.attitude(own_s)
        along, across = self._external(times_s, index, attitude)
        felt = along + self._size("cross-axis", "k") * across - self._settings.g_m_s2 * self._chain.wobble_rad
        if self._ringing is not None:
            felt += self._ringing.answer(own_s)
        else:
            felt += self._inertial(attitude.speed_rad_s, attitude.acceleration_rad_s2)
        return felt + self._turning_with(attitude) + self._recovering(attitude) + self._line(times_s)

    def _external(self, times_s: FloatArray, index: Int64Array, attitude: Attitude) -> tuple[FloatArray, FloatArray]:
        """The laboratory's acceleration along the sensing axis and across it."""
        # The platform turns from Y towards Z; at zero sensors and laboratory agree.
        cos, sin = np.cos(attitude.angle_rad), np.sin(attitude.angle_rad)
        y, z = (self._laboratory(axis, times_s, index) for axis in "yz")
        along_y, along_z = y * cos + z * sin, z * cos - y * sin
        return (along_y, along_z) if self._channel == "y" else (along_z, along_y)

    def _laboratory(self, axis: str, times_s: FloatArray, index: Int64Array) -> FloatArray:
        shaking = self._shaking[axis]
        steady = self._pendulum.accel_m_s2(axis, times_s)
        return steady + shaking.at(index) if shaking else steady

    def _inertial(self, speed_rad_s: FloatArray, acceleration_rad_s2: FloatArray) -> FloatArray:
        """Centripetal and Euler force at the sensor's distance from the axis."""
        # Felt is the sensor's own acceleration, which is towards the axis: hence the sign.
        r_cos, r_sin = self._lever
        return -(r_cos * speed_rad_s**2 + r_sin * acceleration_rad_s2)

    def _turning_with(self, attitude: Attitude) -> FloatArray:
        """What goes with the angle and is no acceleration of the laboratory, or only looks like one."""
        e1 = self._size("theta-locked-bias", "e1") + self._settings.g_m_s2 * self._size("pendulum-reaction", "d")
        e2 = self._size("theta-locked-bias", "e2")
        if not e1 and not e2:
            return np.zeros(attitude.angle_rad.shape)
        return e1 * np.cos(attitude.angle_rad) + e2 * np.sin(attitude.angle_rad)

    def _recovering(self, attitude: Attitude) -> FloatArray:
        """What dies away after a turn, the same each time or with the sign of its direction."""
        total = np.zeros(attitude.angle_rad.shape)
        # While the platform turns nothing recovers, as before the first turn.
        since_s = np.where(np.isnan(attitude.dwelt_s), math.inf, attitude.dwelt_s)
        for effect, sign in (("recovery", 1.0), ("recovery-signed", attitude.direction)):
            size = self._size(effect, "e")
            if size:
                total += size * sign * np.exp(-since_s / self._size(effect, "t_r"))
        return total

    def _line(self, times_s: FloatArray) -> FloatArray | float:
        size = self._size("line", "amplitude")
        if not size:
            return 0.0
        turn = 2.0 * math.pi * self._size("line", "frequency") * (times_s - self._first_s)
        return size * np.sin(turn + self._line_phase)

    def _amplified(self, felt_m_s2: FloatArray, times_s: FloatArray) -> FloatArray:
        """Volts at the end of the chain, its noise left out."""
        gain = 1.0 + self._size("gain-drift", "k0") + self._size("gain-drift", "k1") * times_s
        b1, b2, b3 = (self._size("thermal-bias", name) for name in ("b1", "b2", "b3"))
        warmer = self._room.temperature_c(times_s) - REFERENCE_C if b1 or b2 or b3 else np.zeros(times_s.shape)
        read = gain * felt_m_s2 + warmer * (b1 + warmer * (b2 + warmer * b3))
        read += self._chain.bias_v / self._chain.scale_v_per_m_s2
        # Behind the bias: what is not linear acts on all that is read.
        read += self._size("quadratic", "K2") * read**2 + self._size("gain-asymmetry", "e") * np.abs(read)
        return self._chain.scale_v_per_m_s2 * read

    def _converted(self, volts: FloatArray) -> FloatArray:
        adc = self._settings.adc
        return np.clip(np.rint(volts / adc.step_v) * adc.step_v, -adc.range_v, adc.range_v)

    def _lever_m(self) -> tuple[float, float]:
        """Where the sensor sits off the axis: r cos psi, r sin psi, whichever effect asks for it."""
        effects = ("off-centre", "clock-skew", "filter-ringing")
        return sum(self._size(e, "r_cos") for e in effects), sum(self._size(e, "r_sin") for e in effects)

    def _size(self, effect: str, parameter: str) -> float:
        return self._sizes.get((effect, parameter), 0.0)


def _chain_noise(settings: PlatformSettings, rate_hz: float, *key: int | str) -> IndexedNoise | None:
    """Folding adds white noise alone: what is red is gone long before the Nyquist frequency."""
    noise = settings.chain_noise
    if not noise.white_v2_hz:
        return None
    density = PowerLaw(noise.folding * noise.white_v2_hz, noise.red_v2_hz, noise.exponent, noise.knee_hz)
    return IndexedNoise(NoiseStream(density, rate_hz, *key, from_zero=True))


def _pendulum_noise(settings: PlatformSettings, rate_hz: float, *key: int | str) -> IndexedNoise | None:
    noise = settings.pendulum_noise
    if not noise.asd_m_s2_rthz:
        return None
    # An amplitude density is one-sided: half of its square on either side.
    return IndexedNoise(
        NoiseStream(RisingNoise(0.5 * noise.asd_m_s2_rthz**2, noise.corner_hz, noise.cap), rate_hz, *key)
    )
