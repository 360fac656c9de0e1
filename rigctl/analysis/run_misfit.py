"""How far a run lies from a model."""

from __future__ import annotations

from dataclasses import dataclass

FAR_SIGMA = 5.0
"""Of ten thousand data that fit, one lies farther in one recording out of two hundred."""


@dataclass(frozen=True)
class RunMisfit:
    """The datum of a run that lies farthest from the fitted model, `sigma` of its noise above or below it."""

    run_id: str
    sigma: float
    channel: str
    component: str

    @property
    def far(self) -> bool:
        """Whether that is more than chance makes of a whole recording."""
        return abs(self.sigma) > FAR_SIGMA
