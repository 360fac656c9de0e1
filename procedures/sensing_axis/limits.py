"""Which runs of a scan a rig can carry out: its stages' limits, its recorders' memories, the sensor's range."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from procedures.sensing_axis.bench import Bench, SetPoint
from procedures.sensing_axis.tables import Procedure
from rigctl.core.errors import ConfigError, LimitError
from rigctl.workbench.study import Allowed, Proposal


def within(bench: Bench, procedure: Procedure, axis: str, configuration: str) -> Allowed:
    """Whether a bench can carry out a proposal; what that does not say is as in `procedure`."""

    def allowed(proposal: Proposal) -> bool:
        return _possible(bench, _set_point(proposal.settings, procedure, axis, configuration))

    return allowed


def _set_point(settings: Mapping[str, Any], procedure: Procedure, axis: str, configuration: str) -> SetPoint:
    return SetPoint(
        axis,
        configuration,
        0,
        float(settings["theta_deg"]),
        float(settings["frequency_hz"]),
        float(settings.get("amplitude_mm", procedure.amplitude_mm)),
        float(settings.get("dwell_s", procedure.dwell_s)),
        procedure.sample_rate_hz,
        int(settings.get("approach", 1)),
    )


def _possible(bench: Bench, point: SetPoint) -> bool:
    try:
        bench.check(point, lasers=bench.spots_stay(point))
        bench.check_level(point)
    except (LimitError, ConfigError):
        return False
    return True
