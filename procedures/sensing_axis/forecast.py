"""What a plan's runs would tell, before any of them is made."""

from __future__ import annotations

from typing import Any

from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.bench import Bench, SetPoint
from rigctl.analysis.plane import ARCSEC
from rigctl.core.errors import DataError, ProcedureError
from rigctl.experiments.sensing_axis.imagined import imagined
from rigctl.experiments.sensing_axis.model.fit import forecast
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.set_points import Limits
from rigctl.workbench.study import Proposal


def theta0_sigma_arcsec(bench: Bench, plan: sensing_axes.Plan) -> float | None:
    """What the runs of a plan would tell of the nulls, the worst of all mountings; None: not determined.

    In noise as it is assumed before anything is measured.
    """
    limits = Limits(bench.package, bench.heads, bench.readout.channels()[0].full_scale, known=True)
    runs = imagined([Proposal(_settings(point)) for point in plan.points], (), limits)
    try:
        fit = forecast(RecordingModel(runs, bench.package, bench.heads, bench.g_m_s2, plan.effects))
    except (ProcedureError, DataError):
        return None
    return float(f"{max(null.theta0_sigma_rad for null in fit.nulls()) / ARCSEC:.3g}")


def _settings(point: SetPoint) -> dict[str, Any]:
    """A set-point as a proposal says it."""
    return {
        "axis": point.axis,
        "configuration": point.configuration,
        "mounting": point.mounting,
        "theta_deg": point.theta_deg,
        "frequency_hz": point.frequency_hz,
        "amplitude_mm": point.amplitude_mm,
        "dwell_s": point.dwell_s,
        "approach": point.approach,
    }
