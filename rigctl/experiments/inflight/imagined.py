"""Sessions that could be flown: a recorded one as it would be with a stronger stimulus, or one of another frequency
or phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.observe.reduction import ReducedRun, halves_of
from rigctl.experiments.inflight.observe.sessions import Line, Session
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.observe.weights import amplitudes, weights

STIMULUS_SETTINGS = ("amplitude", "calibration_frequency_hz", "phase_rad")
STRONGER = 2.0
FREQUENCIES = (0.5, 2.0)
"""The frequencies that may be injected next, over the one that was."""

_HIGHEST_HZ, _LOWEST_ORBITS = 1.2e-2, 3.5
"""Thinned samples follow three times the one; the sidebands of the other stay above the lines of the orbit."""

_FOLLOWS = (
    *(Line(1, orbital) for orbital in range(-3, 4)),
    *(Line(2, orbital) for orbital in range(-1, 2)),
    Line(3, 0),
)


def other_stimuli(run: ReducedRun) -> list[dict[str, float]]:
    """Stimuli of a session that could be flown next: as it was, stronger, of another frequency, or of another phase.

    A frequency has a whole number of periods in the run, and is as far from a line of the orbit as two lines are.
    """
    session, duration_s = run.session, run.duration_s
    as_it_was = dict(
        zip(STIMULUS_SETTINGS, (session.amplitude, session.frequency_hz, session.phase_rad), strict=True)
    )
    periods = round(duration_s * session.orbital_hz)
    others = []
    for ratio in FREQUENCIES:
        cycles = round(ratio * session.frequency_hz * duration_s)
        f_hz = (cycles + (1 if cycles % periods == 0 else 0)) / duration_s
        if _LOWEST_ORBITS * session.orbital_hz < f_hz < _HIGHEST_HZ:
            others.append(f_hz)
    return [
        as_it_was,
        {**as_it_was, "amplitude": STRONGER * session.amplitude},
        *({**as_it_was, "calibration_frequency_hz": f_hz} for f_hz in others),
        {**as_it_was, "phase_rad": session.phase_rad + 0.5 * np.pi},
    ]


def flown_again(run: ReducedRun, run_id: str, settings: Mapping[str, Any]) -> ReducedRun:
    """A run as if the stimulus had the `settings` of `STIMULUS_SETTINGS` that are given.

    In every column the lines at and beside the stimulus go with it to another frequency and phase, and grow as its
    amplitude; those at its harmonics as powers of that. What is an acceleration of something that the session moves
    grows as the square of the frequency too.
    """
    session = run.session
    wanted = replace(
        session,
        amplitude=float(settings.get("amplitude", session.amplitude)),
        frequency_hz=float(settings.get("calibration_frequency_hz", session.frequency_hz)),
        phase_rad=float(settings.get("phase_rad", session.phase_rad)),
    )
    # Flown again as it was: the very same run, whose reduction there is already.
    if wanted == session:
        return replace(run, run_id=run_id)
    conditions = {**run.conditions, **{name: settings[name] for name in STIMULUS_SETTINGS if name in settings}}
    coarse = replace(run.coarse, columns=_columns(run, wanted))
    halves = halves_of(wanted, coarse)
    return replace(run, run_id=run_id, session=wanted, conditions=conditions, halves=halves, coarse=coarse)


def _columns(run: ReducedRun, wanted: Session) -> dict[str, FloatArray]:
    grid, session = run.coarse, run.session
    before_hz, after_hz = ([each.frequency_of(line) for line in _FOLLOWS] for each in (session, wanted))
    rows, before, after = (
        weights(grid.t_s, before_hz, grid.present),
        *(templates(grid.t_s, lines_hz) for lines_hz in (before_hz, after_hz)),
    )
    harmonic = np.array([line.harmonic for line in _FOLLOWS])
    at_stimulus = np.array([line.orbital == 0 for line in _FOLLOWS])
    ratio = wanted.amplitude / session.amplitude * np.exp(1j * (wanted.phase_rad - session.phase_rad))
    faster = (wanted.frequency_hz / session.frequency_hz) ** 2
    columns = {}
    for name, column in grid.columns.items():
        # A displacement's acceleration goes as w^2 of it: of moved masses, and of the angle in the turning session.
        accelerates = name[0] == "m" if session.moves_masses else name.startswith("dw_") and session.name == "dy"
        growth = (ratio * np.where(at_stimulus, faster, 1.0) if accelerates else ratio) ** harmonic
        lines = amplitudes(rows, column)
        changed = _parts(growth * lines) @ after - _parts(lines) @ before
        columns[name] = np.where(grid.present, column + changed, 0.0)
    return columns


def _parts(lines: ComplexArray) -> FloatArray:
    """Factors of cosines and sines in turn, for amplitudes c - i s."""
    return np.stack([lines.real, -lines.imag], axis=1).ravel()
