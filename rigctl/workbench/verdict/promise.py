"""What a diagnosis promised of a set of terms, and whether the fit keeps it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.held_out import rise_beyond_chance

MOST_ABOVE = 1.01
"""Of the promised chi-square: a fit that ends higher is told with a warning."""

# A warning and no test: a rise within reach of chance is worth a word.
_STANDARD_ERRORS = 1.0


def joint_fit(
    diagnosis: Mapping[str, Any] | None, added: Sequence[Term]
) -> tuple[dict[str, float], list[str]] | None:
    """The parameters by name where a diagnosis (its JSON) had fitted exactly these terms, and those of them that it
    had held; None when it had not."""
    joint = (diagnosis or {}).get("joint_fit")
    if not joint or sorted(map(repr, joint["terms"])) != sorted(repr(term.as_json()) for term in added):
        return None
    return {name: float(each["value"]) for name, each in joint["parameters"].items()}, list(joint["held"])


def warnings(attempt: Attempt, parent: Attempt | None, promised: Mapping[str, float] | None) -> list[str]:
    """Sentences on what speaks against a fit: `promised` are parameters at which its chi-square was lower, `parent`
    is the fit without the last term."""
    sentences = []
    if promised is not None and attempt.result.chi2 > MOST_ABOVE * (chi2 := _chi2_at(attempt, promised)):
        sentences.append(
            f"chi-square ends at {attempt.result.chi2:.4g}, above the {chi2:.4g} that the diagnosis promised: "
            "the fit has ended elsewhere; diagnose again"
        )
    # One noise for both, the account's, so that the errors compare.
    if parent is not None and rise_beyond_chance(attempt.held_out, parent.held_out) > _STANDARD_ERRORS:
        sentences.append(
            f"the error on runs held out rises from {parent.held_out_error:.4g} to {attempt.held_out_error:.4g}, "
            "by more than its standard error: the term predicts nothing"
        )
    return sentences


def _chi2_at(attempt: Attempt, values: Mapping[str, float]) -> float:
    """Chi-square with other values of the parameters."""
    at = np.array([values.get(each.name, each.start) for each in attempt.model.parameters])
    white = attempt.noise.whiten(attempt.model.observations.value - attempt.model.predict(at))
    pulls = [
        (each.prior.mean - value) / each.prior.sigma
        for each, value in zip(attempt.model.parameters, at, strict=True)
        if each.prior is not None and not each.fixed
    ]
    return float(white @ white + np.sum(np.square(pulls)))
