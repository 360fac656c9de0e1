"""The plain angle scan: a grid of angles and frequencies. Kept to compare the null search with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.sensing_axis.bench import Bench, SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.session.session import Session
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError
from rigctl.experiments.sensing_axis.observe.observables import RunObservables


@dataclass(frozen=True)
class AngleScan:
    """A grid of runs in one mounting."""

    session: Session
    bench: Bench
    fixture: Fixture
    point: Callable[[Mounting, float, float], SetPoint]

    def measure(
        self, mounting: Mounting, angles_deg: Sequence[float], frequencies_hz: Sequence[float]
    ) -> list[RunRecord]:
        """All angles at each frequency in turn; returns the runs."""
        runs = []
        for frequency_hz in frequencies_hz:
            for theta_deg in angles_deg:
                point = self.point(mounting, theta_deg, frequency_hz)
                key = f"{mounting.key} scan {frequency_hz:g} Hz {theta_deg:g} deg"
                runs.append(self.bench.run(self.session, key, point, before=lambda: self.fixture.confirm(mounting)))
        return runs


def minimum_of_modulus_rad(runs: Sequence[RunObservables]) -> float:
    """The grid's angle with the smallest |S|: the plain reading.

    Roll displaces it by rho g / (A w^2), and it is no finer than the grid; it is what one does without a model.
    """
    ordered = sorted(runs, key=lambda run: run.theta_rad)
    theta = np.array([run.theta_rad for run in ordered])
    size = np.array([abs(run.accel_v.value[1]) for run in ordered])
    lowest = int(np.argmin(size))
    if not 0 < lowest < len(size) - 1:
        raise ProcedureError("the smallest |S| is at the edge of the scan: scan further out")
    return float(theta[lowest])


def line_fit_rad(runs: Sequence[RunObservables]) -> float:
    """Zero of a straight line through the signed in-phase amplitudes of one frequency: no roll in the model."""
    theta = np.array([run.theta_rad for run in runs])
    signed: FloatArray = np.array([run.accel_v.value[1].real for run in runs])
    slope, offset = np.polyfit(theta, signed, 1)
    return float(-offset / slope)
