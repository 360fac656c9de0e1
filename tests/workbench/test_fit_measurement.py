"""What each source does to a fit, taken together, is the fit's own covariance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.composition import opened_workbench
from rigctl.workbench.fit_measurement import parameter_sources

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"


def test_sources_add_up_to_the_covariance_of_the_fit(desk: Any) -> None:
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    assert desk.rigctl("model", "add", desk.store, "power2[load_lb]").status == 0
    with opened_workbench(desk.store, ()) as workbench:
        attempt = workbench.attempt(workbench.current)
        total = sum(each.covariance for each in parameter_sources(attempt))
        u = np.sqrt(np.diag(attempt.uncertainty.covariance))
    np.testing.assert_allclose(total / np.outer(u, u), attempt.uncertainty.covariance / np.outer(u, u), atol=1e-6)
