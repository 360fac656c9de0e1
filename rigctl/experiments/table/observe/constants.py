"""The constants of a baseline as input quantities of its fit."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

from rigctl.campaign.table_constants import TableConstants, correlation_matrix
from rigctl.workbench.known_inputs import KnownInputs


def known_inputs(constants: TableConstants) -> tuple[KnownInputs, ...]:
    """Groups of constants that are correlated, in the order of their first; those that are certain are in none.

    Of a group the fewest degrees of freedom count.
    """
    correlations = correlation_matrix(constants)
    names, given = list(constants), list(constants.values())
    _, group_of = connected_components(correlations != 0.0, directed=False)
    groups = []
    for group in dict.fromkeys(group_of.tolist()):
        places = [place for place in np.flatnonzero(group_of == group) if given[place].u > 0.0]
        if not places:
            continue
        u = np.array([given[place].u for place in places])
        groups.append(
            KnownInputs(
                tuple(names[place] for place in places),
                np.array([given[place].value for place in places]),
                correlations[np.ix_(places, places)] * np.outer(u, u),
                min(given[place].dof for place in places),
            )
        )
    return tuple(groups)
