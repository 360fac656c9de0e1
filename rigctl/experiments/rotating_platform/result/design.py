"""The best pattern and modulation period for a noise spectrum, a platform and the drift that must be rejected.

A short period loses time to rotations, a long one lets slow noise in: in between lies the best, in the terms of the
general uncertainty formula (`precision`) and not by the density at the modulation frequency alone (Lenoir,
Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 17), which does not know that rotations take time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.covariance import Sided
from rigctl.experiments.rotating_platform.observe.noise import PowerLawNoise
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, Pattern, named_pattern
from rigctl.experiments.rotating_platform.result.precision import Precision, continuous_precision
from rigctl.experiments.rotating_platform.result.separation import DRIFT, separation

_ROOM = 1.01


@dataclass(frozen=True)
class Design:
    """A pattern at its best period, the drift of the bias that it rejects, and its precision."""

    pattern: Pattern
    order: int
    precision: Precision

    @property
    def sigma(self) -> float:
        """The larger of the two ways to the integration time: it holds for the scatter and for the mean."""
        return max(self.precision.single_period, self.precision.many_periods)


def designs(
    noise: PowerLawNoise,
    rotation_s: float,
    drift_order: int,
    *,
    integration_s: float = 3600.0,
    guard_s: float = 0.0,
    lead_s: float = 0.0,
    longest_s: float = 3600.0,
    step_s: float = 1.0,
    sided: Sided = 2,
) -> list[Design]:
    """The patterns that keep a bias drifting as a polynomial of `drift_order` out of the mean, the best first.

    `rotation_s` is the time of one half turn, to which guard and lead are added. Periods are multiples of `step_s` up
    to `longest_s`. Raises `ConfigError` when no pattern rejects the drift, or none has room within `longest_s`.
    """
    if not 0 <= drift_order < len(DRIFT):
        raise ConfigError(f"drift of order {drift_order}: patterns are known to reject orders 0 to {len(DRIFT) - 1}")
    masked_s = rotation_s + guard_s + lead_s
    best = []
    for name, order in _orders().items():
        fewest = math.ceil(_ROOM * ROTATIONS[name] * masked_s / step_s)
        most = math.floor(longest_s / step_s)
        if order >= drift_order and max(1, fewest) <= most:

            def at(steps: int, name: str = name, order: int = order) -> Design:
                pattern = named_pattern(name, steps * step_s, rotation_s, guard_s=guard_s, lead_s=lead_s)
                return Design(pattern, order, continuous_precision(pattern, noise, integration_s, sided=sided))

            best.append(_best(at, max(1, fewest), most))
    if not best:
        raise ConfigError(
            f"no pattern of at most {longest_s:g} s has time to dwell beside half turns of {masked_s:g} s with "
            "guard: allow a longer period or turn faster"
        )
    return sorted(best, key=lambda each: each.sigma)


def _best(at: Callable[[int], Design], fewest: int, most: int) -> Design:
    """The lowest sigma, which falls towards it from both sides, by thirds on a logarithmic scale."""
    low, high = fewest, most
    while high - low > 3:
        ratio = (high / low) ** (1.0 / 3.0)
        left = min(max(low + 1, round(low * ratio)), high - 2)
        right = max(left + 1, min(round(high / ratio), high - 1))
        if at(left).sigma <= at(right).sigma:
            high = right
        else:
            low = left
    return min((at(steps) for steps in range(low, high + 1)), key=lambda each: each.sigma)


def _orders() -> dict[str, int]:
    """The order of drift that each pattern rejects, whatever its period."""
    return {name: separation(named_pattern(name, 80.0, 0.0).sampled(10.0)).order for name in ROTATIONS}
