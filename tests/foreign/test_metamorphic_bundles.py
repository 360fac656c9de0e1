"""A small recording of each second world, written in another way (metamorphic_bundles.py): the same is found."""

from __future__ import annotations

import pytest

from tests.foreign.metamorphic_bundles import drawn, shortened, tried


# Few runs, of which each world makes quick ones.
@pytest.mark.parametrize(("kind", "seed", "runs"), [("sensing-axis", 3, 18), ("platform", 3, 5), ("satellite", 4, 3)])
def test_what_is_found_does_not_depend_on_how_runs_are_written(kind: str, seed: int, runs: int) -> None:
    assert tried(kind, seed, shortened(drawn(kind, seed), runs))["differed"] == {}
