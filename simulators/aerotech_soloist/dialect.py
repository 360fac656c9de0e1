"""The readings of the sources on a Soloist, each with the one that makes life hardest as its default."""

from __future__ import annotations

from typing import Literal

from simulators.aerotech_ensemble.dialect import GENTLE as GENTLE_ENSEMBLE
from simulators.aerotech_ensemble.dialect import StageDialect


class SoloistDialect(StageDialect):
    """How this Soloist reads the manual."""

    questions: Literal["bare", "parentheses", "either"] = "bare"
    """What a question without arguments ends with: nothing (`AXISSTATUS`, cockpit), `()` (EPICS), or either."""
    parameters: Literal["first", "ensemble"] = "first"
    """Which numbers parameters have: those of EPICS' drvSoloist.cc, or those of the Ensemble's header."""
    ramp_command: bool = False
    """Is RAMP understood, or has the ramp to be set as the parameter DefaultRampRate?"""


GENTLE = SoloistDialect(
    **GENTLE_ENSEMBLE.model_dump(include=set(StageDialect.model_fields)),
    questions="either",
    parameters="ensemble",
    ramp_command=True,
)
"""The other reading of each."""
