"""The Soloist's socket: that of an Ensemble."""

from __future__ import annotations

from simulators.aerotech_ensemble.instrument import SimulatedEnsemble


class SimulatedSoloist(SimulatedEnsemble):
    """A Soloist whose axis is `axis` and whose capture input is `trigger`; its settings make it one."""

    kind = "aerotech-soloist"
