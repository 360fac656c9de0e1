"""What a dry run says, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.report.quantities import duration


def plan_told(found: Mapping[str, Any]) -> str:
    """A dry run in words: what is known of every plan, then what its experiment says beyond."""
    mountings = list(found.get("mountings", ()))
    seated = f" in {len(mountings)} mounting{'s' if len(mountings) > 1 else ''}" if mountings else ""
    lines = [f"{found['experiment']}, {found['procedure']}: {found['runs_planned']} runs{seated}"]
    if mountings:
        shown = ", ".join(mountings[:6]) + (f", … {mountings[-1]}" if len(mountings) > 6 else "")
        lines.append(f"mountings   {shown}")
    lines.append(f"model       baseline{''.join(f' + {effect}' for effect in found['effects'])}")
    if found.get("theta0_sigma_arcsec") is not None:
        lines.append(f"accuracy    sigma(theta0) {found['theta0_sigma_arcsec']:.3g} arcsec in each mounting")
    elif "theta0_sigma_arcsec" in found:
        lines.append("accuracy    these runs do not determine theta0")
    if "rig_time_s" in found:
        lines.append(
            f"rig time    {duration(found['rig_time_s'])} in a room as noisy as allowed; mounting not counted"
        )
    known = {"experiment", "procedure", "mountings", "runs_planned", "effects", "theta0_sigma_arcsec", "rig_time_s"}
    for key, value in found.items():
        if key not in known:
            several = "\n            ".join(map(str, value)) if isinstance(value, list) else value
            lines.append(f"{key:11} {several}")
    return "\n".join([*lines, "", "Checked against the rig's limits: everything can be reached. Nothing was moved."])
