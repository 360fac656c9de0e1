"""A Newport ESP301 motion controller as seen from its serial line.

Grammar, error queue, axis state machine and command table are separate files; `SimulatedEsp301` puts them
behind a wire.
"""

from simulators.newport_esp301.controller import SimulatedEsp301
from simulators.newport_esp301.settings import Esp301SimulatorSettings

__all__ = ["Esp301SimulatorSettings", "SimulatedEsp301"]
