"""Sessions of many draws, simulated in lock step: telemetry in chunks, the same however it is taken.

What nature does to a draw in a run follows from the seed, the draw's number and the run's, and from nothing else: not
from the other draws, nor from which process simulates it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.worlds.platform_noise import PowerLaw, power_law_filter
from simulators.worlds.satellite.events import Events
from simulators.worlds.satellite.forcing import AXES, ROOM_K, Command, forcing
from simulators.worlds.satellite.instrument import Instrument, drawn
from simulators.worlds.satellite.layout import (
    COLUMNS,
    CONSTANT,
    CONSTANTS,
    LANES,
    PARAMETER,
    PARAMETERS,
    POLES,
    STATE,
    STATES,
)
from simulators.worlds.satellite.loop import advance
from simulators.worlds.satellite.normals import key_of
from simulators.worlds.satellite.radio import Radio
from simulators.worlds.satellite.settings import SatelliteSettings

BOLTZMANN_J_K = 1.380649e-23
SETTLED_AT_ONCE = 4096
KNEE_HZ, HIGHEST_HZ = 1e-6, 0.1
"""The 1/f noise goes down to here, some hundred hours, and is followed up to here, where white is all there is."""
PER_DECADE = 2.0


class Simulation:
    """One run of up to LANES draws, from `settle_s` before perigee on."""

    def __init__(self, settings: SatelliteSettings, draws: Sequence[int], run: int, command: Command) -> None:
        if not 0 < len(draws) <= LANES:
            raise ValueError(f"{len(draws)} draws in lock step; there are 1 to {LANES} lanes")
        self._settings, self._command = settings, command
        self._draws = len(draws)
        # Idle lanes do what the last draw does.
        lanes = [*draws, *[draws[-1]] * (LANES - len(draws))]
        axis = AXES[command.injection.axis]
        self._parameter = np.empty(PARAMETERS * LANES)
        for lane, draw in enumerate(lanes):
            self._parameter[lane::LANES] = _parameters(drawn(settings, draw), axis)
        self._constant = _constants(settings, command)
        self._red = np.stack([_coloured(settings, mass) for mass in ("1", "2")])
        self._keys = np.array([key_of(settings.seed, draw, run, "noise") for draw in lanes], dtype=np.uint64)
        self._state = np.zeros(STATES * LANES)
        for lane, draw in enumerate(lanes):
            for mass in range(2):
                at = STATE[f"red_{mass + 1}"] * LANES + lane
                rng = generator(settings.seed, draw, run, "red", mass)
                self._state[at : at + POLES * LANES : LANES] = _old_noise(self._red[mass], rng)
        self._events = Events(settings, lanes, run, command)
        self._radio = Radio(settings, draws, run, command)
        self._first = self._step = -round(settings.settle_s / settings.sample_period_s)

    @property
    def taken(self) -> int:
        """How many samples have come down."""
        return max(self._step, 0)

    def settle(self) -> None:
        """Let the loops come to rest, until perigee."""
        nobody = np.empty((0, len(COLUMNS) * LANES))
        while self._step < 0:
            self._advance(nobody, min(SETTLED_AT_ONCE, -self._step))

    def take(self, count: int, memory: FloatArray | None = None) -> FloatArray:
        """The next samples, (samples, columns, draws); fewer than `count` at the session's end.

        They are in `memory`, if given, of shape (`count` at least, columns * LANES).
        """
        self.settle()
        first = self._step
        count = max(min(count, self._command.samples - first), 0)
        out = np.empty((count, len(COLUMNS) * LANES)) if memory is None else memory[:count]
        self._advance(out, count)
        return self._radio.received(out.reshape(count, len(COLUMNS), LANES)[:, :, : self._draws], first)

    def _advance(self, out: FloatArray, count: int) -> None:
        time_s = np.arange(self._step, self._step + count, dtype=np.float64) * self._settings.sample_period_s
        shared = forcing(self._settings, self._command, time_s)
        extra = self._events.at(time_s)
        # The noise counts from the first step that is simulated.
        counter = self._step - self._first
        advance(out, counter, shared, extra, self._parameter, self._state, self._constant, self._red, self._keys)
        self._step += count


def _parameters(instrument: Instrument, axis: int) -> FloatArray:
    """One lane, as `layout.PARAMETER` has it; `axis` is the one along which masses are moved, their own."""
    made = np.zeros(PARAMETERS)

    def put(name: str, values: FloatArray) -> None:
        made[PARAMETER[name] : PARAMETER[name] + values.size] = values.ravel()

    matrices, couplings = instrument.matrices, instrument.couplings
    for k in range(2):
        parasitic = instrument.parasitic_m_s2[k]
        put(f"position_{k + 1}", instrument.positions_m[k])
        put(f"matrix_{k + 1}", matrices[k])
        # A parasitic force is along the sensor's own axes (eq. 9): what M turns too much is taken off.
        put(f"offset_{k + 1}", couplings[k] @ parasitic - matrices[k] @ parasitic)
        put(f"bias_{k + 1}", instrument.bias_m_s2[k])
        put(f"parasitic_{k + 1}", parasitic)
        put(f"quadratic_{k + 1}", instrument.quadratic_s2_m[k])
        put(f"axis_{k + 1}", instrument.rotations[k][axis])
    put("gyro", instrument.gyro_bias_rad_s2)
    put("tracker", instrument.tracker_bias_rad)
    put("thruster", instrument.thruster)
    return made


def _constants(settings: SatelliteSettings, command: Command) -> FloatArray:
    loops, noise, step_s = settings.loops, settings.noise, settings.sample_period_s
    # White noise of one-sided density S has variance S / (2 step).
    rms = math.sqrt(0.5 / step_s) if settings.noise_on else 0.0
    stiffness = loops.attitude_rad_s**2
    named = {
        "step": step_s,
        "range": settings.range_m_s2,
        "spin": 2.0 * math.pi * command.spin_hz,
        "input_1": command.inputs[0],
        "input_2": command.inputs[1],
        "gain": loops.drag_free_rad_s,
        "integral": loops.integral_rad_s,
        "lag": loops.thruster_lag_s,
        "stiffness": stiffness,
        "damping": loops.attitude_damping * math.sqrt(stiffness),
        "hybrid": loops.hybrid_rad_s,
        "sensor_yz": rms * noise.sensor_yz_m_s2_rthz,
        # A position noise, which the loop differentiates twice.
        "readout": rms * noise.readout_x_m_rthz / step_s**2,
        "angular": rms * noise.angular_rad_s2_rthz,
        "tracker": rms * noise.tracker_rad_rthz,
        "thrust": rms * noise.thrust_m_s2_rthz,
        "torque": rms * noise.torque_rad_s2_rthz,
        "least": settings.size("thrust-quantisation", "step"),
        "smallest": settings.size("thrust-quantisation", "minimum"),
        "largest": settings.size("thrust-quantisation", "maximum"),
    }
    made = np.zeros(CONSTANTS)
    for name, value in named.items():
        made[CONSTANT[name]] = value
    for k, mass in enumerate(("1", "2")):
        made[CONSTANT["cubic"] + k] = settings.size("cubic-electrode", "k3", mass)
        made[CONSTANT["cross"] + k] = settings.size("cross-quadratic", "kxy", mass)
    return made


def _coloured(settings: SatelliteSettings, mass: str) -> FloatArray:
    """Poles, residues and amplitude of the filter behind a mass' x noise, (3, POLES).

    With H(z) = 1 + sum r / (z - p), white noise of unit variance, times the amplitude, has the density's colour.
    """
    noise, made = settings.noise, np.zeros((3, POLES))
    white = noise.sensor_x_m_s2_rthz**2
    red = white * noise.sensor_x_corner_hz + _spring_m2_s4(settings, mass)
    if not settings.noise_on or (white == 0.0 and red == 0.0):
        return made
    # Two-sided, as the filter's design has it; some white to stand on, if there is none, at the Nyquist frequency.
    rate_hz = 1.0 / settings.sample_period_s
    floor = max(white, 1e-3 * red * settings.sample_period_s)
    poles, zeros, gain = power_law_filter(
        PowerLaw(0.5 * floor, 0.5 * red, 1.0, KNEE_HZ), rate_hz, PER_DECADE, HIGHEST_HZ
    )
    for i, pole in enumerate(poles):
        others = np.prod([pole - other for j, other in enumerate(poles) if j != i])
        made[0, i] = pole
        # A pole at zero only fills up the filter.
        made[1, i] = np.prod([pole - zero for zero in zeros]) / others if pole != 0.0 else 0.0
    made[2, 0] = math.sqrt(gain * rate_hz)
    return made


def _spring_m2_s4(settings: SatelliteSettings, mass: str) -> float:
    """4 kB T kappa / (m^2 Q 2 pi): over the frequency, the one-sided density of a lossy spring's push [m2/s4]."""
    kappa = settings.size("spring-noise", "kappa", mass)
    if kappa == 0.0:
        return 0.0
    mass_kg = settings.mass_kg[int(mass) - 1]
    quality = settings.size("spring-noise", "quality", mass)
    return 4.0 * BOLTZMANN_J_K * ROOM_K * kappa / (mass_kg**2 * quality * 2.0 * math.pi)


def _old_noise(red: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A state that the filter could have after running for ever."""
    poles = red[0]
    used = red[1] != 0.0
    state = np.zeros(POLES)
    if used.any():
        # Each state is the sum of p^k w(-1 - k): they have the covariance 1 / (1 - p q).
        covariance = 1.0 / (1.0 - np.outer(poles[used], poles[used]))
        scale = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        root = scale[:, np.newaxis] * vectors * np.sqrt(np.maximum(values, 0.0))
        state[used] = root @ rng.standard_normal(int(used.sum()))
    return state
