"""-2 log L never rises from a model to one that contains its terms, whatever the table and the terms.

``RIGCTL_FOREIGN=1`` tries thirty tables instead of three.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from rigctl.core.errors import UNFIT
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.likelihood import Optimum, maximum_likelihood
from tests.foreign.metamorphic_table import drawn

RISES_AT_MOST = 1e-6
LONGEST = 4


def chain(study: TableStudy, random: np.random.Generator) -> list[tuple[Term, ...]]:
    """Sets of effects that can be fitted together, each with one more than the one before, in any order."""
    versions: list[tuple[Term, ...]] = [()]
    for effect in random.permutation(list(study.effects())):
        terms = list(versions[-1])
        terms.insert(int(random.integers(len(terms) + 1)), Term(str(effect)))
        try:
            attempt = Attempt(study, terms)
        except UNFIT:
            continue
        # With the choices of scans, as versions have them.
        versions.append(tuple(attempt.model.terms))
        if len(versions) > LONGEST:
            break
    return versions


def optima(study: TableStudy, versions: Sequence[Sequence[Term]]) -> list[Optimum]:
    """The least -2 log L of each version, every earlier one a parent of it."""
    account = account_of(study, versions)
    found: list[Optimum] = []
    for terms in versions:
        attempt = account.attempt(study, terms)
        found.append(maximum_likelihood(attempt, attempt.estimator, found))
    return found


# Words, an order: tables whose restricted likelihoods, each with its own noise, do rise.
@pytest.mark.parametrize("seed", range(30) if "RIGCTL_FOREIGN" in os.environ else [6, 11])
def test_more_terms_are_never_less_likely(seed: int) -> None:
    study = TableStudy(drawn(seed).recording())
    versions = chain(study, np.random.default_rng([17, seed]))
    assert len(versions) > LONGEST - 1
    ladder = [each.minus_2_log_l for each in optima(study, versions)]
    for before, after in pairwise(ladder):
        assert after <= before + RISES_AT_MOST, (versions[-1], ladder)
