"""How far each run lies from the model as it is: one fit and no search, cheap enough to be asked while runs come."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.run_misfit import RunMisfit
from rigctl.core.arrays import BoolArray, IntArray
from rigctl.core.threads import one_thread
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.fitted_model import fit_with_given_noise

_FEWEST = 8
"""Fewer data tell no scatter of their own."""

_OF_MEDIAN = 1.4826
"""The standard deviation of a normal distribution over its median of absolute deviations."""


@one_thread
def run_misfits(study: Study, terms: Sequence[Term]) -> list[RunMisfit]:
    """Every run's largest residual, in the order of the recording.

    The unit is the noise that a run's own samples show, or the scatter of its series where that is larger: a run
    stands out from the others, whatever they all have that the model lacks. Series of fewer than eight data are
    judged together with the others of their channel. `DataError` or `ProcedureError` as long as the runs do not
    determine the model.
    """
    model = study.model(terms)
    given = model.observations
    left = np.array(fit_with_given_noise(model, {}).whitened())
    for rows in _alike(given.series_of, [series.channel for series in given.series]):
        left[rows] /= max(1.0, _OF_MEDIAN * float(np.median(np.abs(left[rows]))))
    farthest: dict[str, int] = {}
    # What an experiment takes for a run of its own may be a part of one.
    for at in np.argsort(np.abs(left)).tolist():
        farthest[given.run_ids[given.run_of[at]]] = at
    return [
        RunMisfit(run_id, float(left[at]), series.channel, series.component)
        for run_id in dict.fromkeys(given.run_ids)
        if (at := farthest.get(run_id)) is not None
        for series in [given.series[given.series_of[at]]]
    ]


def _alike(series_of: IntArray, channels: Sequence[str]) -> list[BoolArray]:
    """Data whose scatter is one: those of a series, or of all short ones of a channel."""
    counts = np.bincount(series_of, minlength=len(channels))
    short = counts < _FEWEST
    of_channel = np.array(channels)
    each = [series_of == number for number in np.flatnonzero(~short)]
    return each + [
        (short & (of_channel == name))[series_of] for name in dict.fromkeys(of_channel[short & (counts > 0)].tolist())
    ]
