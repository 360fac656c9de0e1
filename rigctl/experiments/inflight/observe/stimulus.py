"""Whether a run's own channels show the stimulus that its row in runs.csv states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.campaign.layout import UnitFindings, slip_between
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import either
from rigctl.experiments.inflight.observe.sessions import LINEAR, MASS_MOTION, QUADRATIC, Session

AMPLITUDE_UNITS = {
    **dict.fromkeys(LINEAR, "m/s2"),
    **dict.fromkeys((*MASS_MOTION, *QUADRATIC), "m"),
    "dy": "rad",
}
"""Of what each session injects."""

OFF_BY = 2.0
"""The gain of an own channel is 1 within 1e-2: a stimulus off by this factor is another one."""

STIFFEST_S2 = 0.025
"""A spring of 1e-2 N/m on 0.4 kg: a mass moved by x shows the acceleration (spring/mass - w^2) x."""

CERTAIN_SIGMA = 5.0

_X, _Y, _Z = ({f"m{mass}_{axis}": 0.5 for mass in (1, 2)} for axis in "xyz")
_CHANNELS: Mapping[str, tuple[str, Mapping[str, float]]] = {
    "ad11": ("(m1_x + m2_x)/2", _X),
    "k2d": ("(m1_x + m2_x)/2", _X),
    "ad12": ("(m1_y + m2_y)/2", _Y),
    "ad13": ("(m1_z + m2_z)/2", _Z),
    "dy": ("dw_z", {"dw_z": 1.0}),
    "ac12": ("m1_y - m2_y", {"m1_y": 1.0, "m2_y": -1.0}),
    "ac13": ("m1_z - m2_z", {"m1_z": 1.0, "m2_z": -1.0}),
    "k2c_1": ("m1_x", {"m1_x": 1.0}),
    "k2c_2": ("m2_x", {"m2_x": 1.0}),
}
"""Where each session's stimulus is seen: a name, and the columns' factors."""


@dataclass(frozen=True)
class _Seen:
    """The amplitude of a channel at the stimulus, in the unit of what is injected."""

    amplitude: float
    sigma: float

    @property
    def certain(self) -> bool:
        """Whether noise does not make it."""
        return self.amplitude > CERTAIN_SIGMA * self.sigma

    def contradicts(self, stated: float) -> bool:
        """Whether it is off by a factor, and not by noise."""
        margin = CERTAIN_SIGMA * self.sigma
        return self.amplitude + margin < stated / OFF_BY or self.amplitude - margin > stated * OFF_BY


def stimulus_findings(session: Session, columns: Mapping[str, FloatArray]) -> UnitFindings:
    """The stated amplitude against what the session's own channel shows at the stimulus.

    A power of a thousand between them is a unit; what a spring may do to a moved mass is remarked on; anything else
    is another stimulus, perhaps that of another session. The samples must be long enough to tell the stimulus from
    lines of the orbit.
    """
    stated, unit = abs(session.amplitude), AMPLITUDE_UNITS[session.name]
    seen = _seen(session, session.name, columns)
    if not seen.contradicts(stated):
        return UnitFindings()
    channel, _ = _CHANNELS[session.name]
    shown = f"{channel} shows a stimulus of {seen.amplitude:.2g} {unit} at {session.frequency_hz:.4g} Hz"
    if seen.certain and (slip := slip_between(seen.amplitude, stated)):
        return UnitFindings(f"{shown}, amplitude is {stated:g}: one of them is off by {slip:.0e}; write it in {unit}")
    others = [
        name
        for name in _CHANNELS
        if AMPLITUDE_UNITS[name] == unit
        and (other := _seen(session, name, columns)).certain
        and not other.contradicts(stated)
    ]
    said = f"session {session.name} with amplitude {stated:g} {unit} contradicts the samples: {shown}"
    if others:
        return UnitFindings(
            contradiction=f"{said}, {_CHANNELS[others[0]][0]} that one; write session {either(others)}"
        )
    if seen.certain and session.name in (*MASS_MOTION, *QUADRATIC) and seen.amplitude <= _with_spring(session):
        return UnitFindings(
            remarks=(
                f"{shown}, amplitude is {stated:g}: a spring that holds the mass does that (effect wire-stiffness); "
                "if none does, write the amplitude that was flown",
            )
        )
    return UnitFindings(
        contradiction=f"{said}; write the session, calibration_frequency_hz and amplitude that were flown"
    )


def _with_spring(session: Session) -> float:
    """The largest displacement that a moved mass' acceleration shows, held by a spring."""
    return abs(session.amplitude) * (1.0 + STIFFEST_S2 / (2.0 * np.pi * session.frequency_hz) ** 2)


def _seen(session: Session, name: str, columns: Mapping[str, FloatArray]) -> _Seen:
    """What the channel of session `name` shows at this session's frequency; all of its scatter counts as noise."""
    _, factors = _CHANNELS[name]
    channel = sum((factor * columns[column] for column, factor in factors.items()), np.zeros(len(columns["t_s"])))
    w = 2.0 * np.pi * session.frequency_hz
    line, sigma = line_of(columns["t_s"], channel, session.frequency_hz)
    # Angles and displacements are seen by their accelerations.
    scale = 1.0 if name in LINEAR else w**-2
    return _Seen(scale * abs(line), scale * sigma)


def line_of(t_s: FloatArray, channel: FloatArray, frequency_hz: float) -> tuple[complex, float]:
    """A channel's amplitude at a frequency, cosine less i sine, and its uncertainty if all scatter is noise: infinite
    without samples."""
    there = np.isfinite(channel)
    if not there.any():
        return 0.0j, math.inf
    at_s, channel = t_s[there], channel[there]
    # Hann's window: lines of the orbit, some periods beside, leave nothing in it.
    window = 1.0 - np.cos(2.0 * np.pi * (at_s - t_s[0]) / (t_s[-1] - t_s[0]))
    weight = window / np.sum(window)
    channel = channel - weight @ channel
    line = 2.0 * complex(weight @ (channel * np.exp(-2j * np.pi * frequency_hz * at_s)))
    return line, float(np.std(channel)) * math.sqrt(2.0 * float(weight @ weight))
