"""A Newport XPS motion controller as seen from its TCP port 5001.

Grammar, argument checking, motion state machine and gathering memory are separate files;
`SimulatedXps` puts them behind a wire.
"""

from simulators.newport_xps.controller import SimulatedXps
from simulators.newport_xps.settings import XPS_D, XpsSimulatorSettings

__all__ = ["XPS_D", "SimulatedXps", "XpsSimulatorSettings"]
