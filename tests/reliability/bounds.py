"""How large a rate of failures the trials leave possible."""

from __future__ import annotations

from scipy import stats

CONFIDENCE = 0.95


def upper_bound(failures: int, trials: int) -> float:
    """The one-sided Clopper-Pearson bound of a rate at `CONFIDENCE`: about 3 / trials without a failure."""
    if failures >= trials:
        return 1.0
    return float(stats.beta.ppf(CONFIDENCE, failures + 1, trials - failures))
