"""What both estimates miss without noise, on the simulated satellite with its loops, of sixteen instruments."""

from __future__ import annotations

import numpy as np

from procedures.inflight.monte_carlo import Unit, reduce_unit
from procedures.inflight.tables import MonteCarlo
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.draws import estimated
from simulators.worlds.satellite.ensemble import Ensemble
from simulators.worlds.satellite.instrument import drawn
from simulators.worlds.satellite.settings import Bounds, SatelliteSettings

ORBIT_S, STEP_S = 5950.0, 1.0
TOLERANCE = np.array([1e-9, 1e-9, 1e-9, 3e-6, 3e-6, 5e-8, 1e-8, 1e-8, 1.0, 1.0])
DRAWS = tuple(range(16))


def test_without_noise_every_parameter_is_the_exact_one() -> None:
    nature = SatelliteSettings(
        kind="drag-free-satellite",
        seed=3,
        noise_on=False,
        sample_period_s=STEP_S,
        bounds=Bounds(eta_rad=0.0, tracker_bias_rad=0.0),
    )
    ensemble, study = Ensemble(nature), MonteCarlo(name="monte-carlo")
    units = {name: Unit(ensemble, study, ORBIT_S, name, run, DRAWS) for run, name in enumerate(study.sessions, 1)}
    flown = {name: unit.flown for name, unit in units.items()}
    reduced = {name: reduce_unit(unit) for name, unit in units.items()}
    missed: dict[str, list[list[float]]] = {"paper": [], "joint": []}
    for draw in DRAWS:
        scores = estimated(draw, flown, reduced, ensemble.truths(draw))
        truth = scores.truths["exact_truth"]
        for estimate, rows in missed.items():
            rows.append([scores.estimates[estimate][name] - truth[name] for name in NAMES])
    for estimate, rows in missed.items():
        worst = np.abs(rows).max(axis=0)
        assert np.all(worst < TOLERANCE), (estimate, dict(zip(NAMES, worst, strict=True)))
    # What is left of a_c12 and a_c13 is the product of two rotations that no session tells apart.
    turned = np.array([0.5 * (one.theta_rad[0] - one.theta_rad[1]) for one in (drawn(nature, d) for d in DRAWS)])
    left = np.array(missed["paper"])[:, 3:5] - turned[:, :1] * turned[:, 1:] * (1.0, 0.5)
    assert np.sqrt(np.mean(left**2)) < 5e-7
