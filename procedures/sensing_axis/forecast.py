"""What a plan's runs would tell, before any of them is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from procedures.sensing_axis.bench import Bench, SetPoint
from rigctl.analysis.plane import ARCSEC
from rigctl.core.errors import DataError, ProcedureError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.fit import forecast
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.set_points import Limits
from rigctl.experiments.sensing_axis.study_data import imagined
from rigctl.workbench.study import Proposal


def theta0_sigma_arcsec(bench: Bench, points: Sequence[SetPoint], effects: Sequence[Effect]) -> float | None:
    """The uncertainty that runs at these set-points would give the null of the worst mounting; None: not determined.

    In noise as it is assumed before anything is measured.
    """
    limits = Limits(bench.package, bench.heads, bench.readout.channels()[0].full_scale, known=True)
    runs = imagined([Proposal(asdict(point)) for point in points], (), limits)
    try:
        fit = forecast(RecordingModel(runs, bench.package, bench.heads, bench.g_m_s2, effects))
    except (ProcedureError, DataError):
        return None
    return float(f"{max(null.theta0_sigma_rad for null in fit.nulls()) / ARCSEC:.3g}")
