"""What is uncertain of the rotation from the cube into the host's frame, as contributions to a budget."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigctl.analysis.budget import Contribution
from rigctl.analysis.rotation import FrameRotation
from rigctl.core.arrays import FloatArray


def host_turns(host: FrameRotation) -> list[tuple[Contribution, FloatArray]]:
    """What is uncertain of the rotation into the host's frame, as independent turns [rad] about directions in it."""
    measured = host.dof > 0
    kind: Literal["A", "B"] = "A" if measured else "B"
    source = "directions measured in both frames" if measured else "rig file"
    return [
        (Contribution(f"host frame about {_words(about)}", 0.0, u_rad, "rad", type=kind, source=source), about)
        for about, u_rad in host.turns()
    ]


def _words(direction: FloatArray) -> str:
    nearest = int(np.argmax(np.abs(direction)))
    if abs(direction[nearest]) > 1.0 - 1e-9:
        return "xyz"[nearest]
    return " ".join(f"{component:+.2f}" for component in direction)
