"""A run that stands out from the others is told, and none that does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.analysis.run_misfit import FAR_SIGMA, RunMisfit
from rigctl.core.errors import DataError, ProcedureError
from rigctl.report.watch import misfit_picture
from rigctl.workbench.misfits import run_misfits
from tests.workbench.conftest import RUNS

DRAWS = 100


def test_chance_makes_no_run_far(made_up: Any) -> None:
    # Of 100 times 144 data a hundredth of a datum lies so far by chance.
    found = [each for seed in range(DRAWS) for each in run_misfits(made_up.study(seed), ())]
    assert len(found) == DRAWS * RUNS
    assert not [each for each in found if each.far]
    # The largest of three normal data has a root mean square of 1.451; the unit is at least their noise.
    assert 0.85 * 1.451 < np.sqrt(np.mean([each.sigma**2 for each in found])) < 1.451


@pytest.mark.parametrize("size", [-12.0, 12.0])
@pytest.mark.parametrize(("series", "component"), [(0, "nu in-phase"), (2, "DC")])
def test_a_run_that_is_off_is_told_where_and_by_how_much(
    made_up: Any, size: float, series: int, component: str
) -> None:
    study = made_up.study(7)
    study.value[series * RUNS + 20] += size
    (far,) = [each for each in run_misfits(study, ()) if each.far]
    # Its own noise, and what the fit gives way.
    assert far == RunMisfit("r20", pytest.approx(size, abs=4.0), "v", component)


def test_what_all_runs_have_puts_none_of_them_out(made_up: Any) -> None:
    """An effect that the model lacks is for the diagnosis: against the scatter it makes no run stands out."""
    study = made_up.study(3, {"warm-gain": 200.0, "warm-bias": 200.0})
    assert not [each for each in run_misfits(study, ()) if each.far]


def test_runs_that_do_not_determine_the_model_are_not_judged(made_up: Any) -> None:
    with pytest.raises((DataError, ProcedureError)):
        run_misfits(made_up.study(1, refused=frozenset({"roll"})), study_terms("roll"))


def study_terms(*names: str) -> list[Any]:
    from rigctl.workbench.study import Term

    return [Term(name) for name in names]


def test_far_runs_have_a_mark_of_their_own() -> None:
    misfits = [RunMisfit(str(n), sigma, "v", "DC") for n, sigma in enumerate((0.3, -FAR_SIGMA - 2.0, 1.0))]
    near, far = misfit_picture(misfits).lines
    assert (list(near.x), list(far.x)) == ([1.0, 3.0], [2.0])
    assert far.mark != near.mark
    (only,) = misfit_picture(misfits[:1]).lines
    assert list(only.y) == [0.3]
