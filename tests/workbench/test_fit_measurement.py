"""What each source does to a fit, taken together, is the fit's own covariance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.composition import opened_workbench
from rigctl.workbench import fit_measurement

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"
NILE = Path(__file__).parents[1] / "foreign" / "data" / "nile-ordered"


@pytest.mark.parametrize(("recording", "effects"), [(PONTIUS, ["power2[load_lb]"]), (NILE, [])])
def test_sources_add_up_to_the_covariance_of_the_fit(desk: Any, recording: Path, effects: list[str]) -> None:
    """Of the Nile by year too, whose noise may be correlated."""
    assert desk.rigctl("import", recording, "--store", desk.store).status == 0
    for effect in effects:
        assert desk.rigctl("model", "add", desk.store, effect).status == 0
    with opened_workbench(desk.store, ()) as workbench:
        attempt = workbench.attempt(workbench.current)
        total = sum(each.covariance for each in fit_measurement.parameter_sources(attempt))
        u = np.sqrt(np.diag(attempt.uncertainty.covariance))
    np.testing.assert_allclose(total / np.outer(u, u), attempt.uncertainty.covariance / np.outer(u, u), atol=1e-6)


def test_another_calibration_has_noise_of_its_own_also_where_it_is_stated(
    desk: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    rows = fit_measurement._rows

    def stated(attempt: Any) -> Any:
        return ((name, "B", some, np.inf, "stated uncertainties") for name, _, some, _, _ in rows(attempt))

    monkeypatch.setattr(fit_measurement, "_rows", stated)
    with opened_workbench(desk.store, ()) as workbench:
        sources = fit_measurement.fit_measurement(workbench).sources
    assert [each.type for each in sources] == ["B"]
    assert not sources[0].in_common
