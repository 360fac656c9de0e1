"""An effect that slow noise may hide, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.workbench.study import Term


@dataclass(frozen=True)
class HiddenInNoise:
    """An effect that would be significant if the noise were white, and is not as it is correlated along `order`.

    P-values are corrected for the trials; `detectable` is by parameter the size these data would have revealed,
    `detectable_if_white` the same if the noise were white; `units` are those of the parameters.
    """

    term: Term
    order: str
    p_value_corrected: float
    p_value_if_white: float
    detectable: Mapping[str, float]
    detectable_if_white: Mapping[str, float]
    units: Mapping[str, str]

    def as_json(self) -> dict[str, Any]:
        """Within `hidden_in_slow_noise` of `rigctl diagnose --json`."""
        return {
            "effect": self.term.effect,
            "choice": dict(self.term.choice),
            "order": self.order,
            "p_value_corrected": self.p_value_corrected,
            "p_value_if_white": self.p_value_if_white,
            "smallest_detectable": dict(self.detectable),
            "smallest_detectable_if_white": dict(self.detectable_if_white),
            "units": dict(self.units),
        }
