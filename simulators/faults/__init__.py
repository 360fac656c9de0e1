"""Faults of instruments and their wires: seeded, repeatable, around any simulated instrument.

In a rig file, for the instrument NAME:

    [instruments.NAME.faults]
    seed = 3
    late = { probability = 0.01, delay_s = 2.5 }
    silent = { nth = [12, 40] }
    power_cycle = { at_s = 300.0, lasting_s = 20.0 }
    following_error = { per_hour = 0.2 }
"""

from simulators.faults.draw import random_plans
from simulators.faults.line import FaultyConnection, FaultyInstrument
from simulators.faults.mishaps import Faultable, InstrumentFaults
from simulators.faults.plan import FaultPlan, faults_of
from simulators.faults.when import Event, Fault, Spell
from simulators.faults.wire import WireFaults

__all__ = [
    "Event",
    "Fault",
    "FaultPlan",
    "Faultable",
    "FaultyConnection",
    "FaultyInstrument",
    "InstrumentFaults",
    "Spell",
    "WireFaults",
    "faults_of",
    "random_plans",
]
