"""The first runs of an investigation, chosen before anything is known: they are to determine the baseline and show
as much of the catalogue as so few runs can."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.threads import one_thread
from rigctl.workbench.next.plan import shuffled
from rigctl.workbench.study import Plannable, Proposal, Term

LOOSE = 1e3
"""How far beyond what all options together would tell the baseline's parameters are unknown."""

# Of sigma: beyond, an effect cannot be missed anyway.
_MOST = 30.0


@one_thread
def first_design(
    study: Plannable,
    terms: Sequence[Term],
    options: Sequence[Proposal],
    count: int,
    seed: int,
    run_price_s: float = 0.0,
) -> tuple[Proposal, ...]:
    """So many of the options, D-optimal for baseline, terms and catalogue: effects are expected at typical sizes.

    The largest gain of log det (1 + C' C) per second of rig time, one run after the other (Chaloner and Verdinelli
    1995, Statistical Science 10, section 2.2); in random order.
    """
    imagined = study.extended(options)
    model = imagined.model(terms)
    values = np.array([each.start for each in model.parameters])
    given = model.observations
    fitted = model.jacobian(values) / given.sigma[:, None]
    fitted = fitted[:, np.linalg.norm(fitted, axis=0) > 0.0]
    # All columns in units of what is believed beforehand: the spread then begins as the unit matrix.
    columns = [LOOSE * fitted / np.linalg.norm(fitted, axis=0)]
    columns += [
        _bounded(candidate.derivative * candidate.typical / given.sigma[:, None])
        for candidate in imagined.candidates(model, values)[0]
    ]
    rows = np.hstack(columns)
    bounds = np.searchsorted(given.run_of, np.arange(len(options) + 1))
    parts = [rows[bounds[i] : bounds[i + 1]] for i in range(len(options))]
    takes_s = np.array([each.takes_s for each in options]) + run_price_s
    spread = np.eye(rows.shape[1])
    chosen: list[int] = []
    while len(chosen) < count:
        gains = np.array([_gain(part, spread) for part in parts]) / takes_s
        best = int(np.argmax(gains))
        chosen.append(best)
        spread = _narrowed(spread, parts[best])
    return shuffled([options[i] for i in chosen], seed)


def _bounded(columns: FloatArray) -> FloatArray:
    """Columns no longer than what is clearly significant: a larger typical size adds nothing to the design."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(columns * np.where(size > _MOST, _MOST / np.where(size > 0.0, size, 1.0), 1.0))


def _gain(rows: FloatArray, spread: FloatArray) -> float:
    # Sylvester's identity: the determinant of a matrix of the run's rows instead of one of all parameters.
    return float(np.linalg.slogdet(np.eye(len(rows)) + rows @ spread @ rows.T)[1])


def _narrowed(spread: FloatArray, rows: FloatArray) -> FloatArray:
    # Woodbury, for the same reason.
    along = spread @ rows.T
    return np.asarray(spread - along @ np.linalg.solve(np.eye(len(rows)) + rows @ along, along.T))
