"""What is looked at while a campaign's runs come: its experiment's plots, and how far each is off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.run_misfit import FAR_SIGMA, RunMisfit
from rigctl.core.arrays import BoolArray
from rigctl.core.errors import UNFIT
from rigctl.report.drawn import DrawingOfProgress, drawing_of
from rigctl.report.picture import Line, Picture
from rigctl.report.shown import Watch
from rigctl.workbench.misfits import run_misfits
from rigctl.workbench.workbench import Workbench


def watch(workbench: Workbench) -> Watch:
    """Of a store as it is now; nothing of what its runs do not tell yet."""
    drawing = drawing_of(workbench.store.header.experiment, workbench.store.path)
    shown = list(drawing.progress(workbench.store)) if isinstance(drawing, DrawingOfProgress) else []
    try:
        misfits = run_misfits(workbench.study, workbench.current.terms)
    except UNFIT:
        # Too few runs as yet, or a study that keeps none.
        return Watch(tuple(shown))
    return Watch((*shown, misfit_picture(misfits)), tuple(each for each in misfits if each.far))


def misfit_picture(misfits: Sequence[RunMisfit]) -> Picture:
    """Every run's largest residual over the runs."""
    place = np.arange(1.0, len(misfits) + 1.0)
    sigmas = np.array([each.sigma for each in misfits])
    far = np.abs(sigmas) > FAR_SIGMA
    lines = [Line(place[~far], sigmas[~far], mark="o", labels=_run_ids(misfits, ~far))]
    if far.any():
        lines.append(Line(place[far], sigmas[far], "far from the model", "#", 4, labels=_run_ids(misfits, far)))
    levels = ((-FAR_SIGMA, f"-{FAR_SIGMA:g}σ"), (0.0, "0"), (FAR_SIGMA, f"+{FAR_SIGMA:g}σ"))
    # A wrong model's residuals reach hundreds of sigma; small ones need room too.
    reach = max(2.0 * FAR_SIGMA, 1.2 * float(np.abs(sigmas).max()))
    return Picture(
        "largest residual / σ",
        tuple(lines),
        "valid run",
        (0.0, len(misfits) + 1.0),
        (-reach, reach),
        levels=levels,
        y_scale="symlog",
    )


def _run_ids(misfits: Sequence[RunMisfit], which: BoolArray) -> tuple[str, ...]:
    return tuple(misfits[at].run_id for at in np.flatnonzero(which).tolist())
