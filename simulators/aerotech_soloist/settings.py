"""What a simulated Soloist is like: its stage and its set-up are described as an Ensemble's."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.aerotech_soloist.addressing import SoleAxis
from simulators.aerotech_soloist.dialect import SoloistDialect

FIRST_NUMBERS = {
    3: "COUNTS_PER_UNIT",
    47: "SOFTWARE_LIMIT_LOW",
    48: "SOFTWARE_LIMIT_HIGH",
    58: "POSITION_FEEDBACK_TYPE",
    102: "DEFAULT_SPEED",
    103: "DEFAULT_RAMP_RATE",
    106: "HOME_SETUP",
    107: "HOME_SPEED",
    108: "HOME_OFFSET",
    257: "AXIS_NAME",
}
"""As EPICS' drvSoloist.cc and devSoloist.cc use them, under the names that the Ensemble has for the same."""


class SoloistSimulatorSettings(StageSimulatorSettings):
    """Keys of a simulated Soloist."""

    dialect: SoloistDialect = SoloistDialect()

    @property
    def addressing(self) -> SoleAxis:
        """The axis is never named."""
        return SoleAxis(self.dialect.questions)

    @property
    def parameter_numbers(self) -> Mapping[int, str]:
        """The names of parameters by number, where they are not those of EnsembleParameterId.h."""
        return FIRST_NUMBERS if self.dialect.parameters == "first" else {}

    @property
    def not_understood(self) -> frozenset[str]:
        """There are no planes, and what the dialect leaves out."""
        ramp = set() if self.dialect.ramp_command else {"RAMP"}
        return super().not_understood | {"PLANESTATUS", "LINEAR"} | ramp

    @property
    def home_statement(self) -> str:
        """HOME as a program for one axis has it."""
        return "HOME"

    @property
    def program_source(self) -> str:
        """Which of our programs the operator has loaded."""
        return "soloist.ab"
