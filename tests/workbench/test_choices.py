"""What `model add` takes of a diagnosis: the term that was fitted, not another of the same name."""

from rigctl.workbench.study import Term
from rigctl.workbench.verdict.choices import diagnosed

SHARED, EACH = {"effect": "thermal-bias", "choice": {}}, {"effect": "thermal-bias", "choice": {"of": "each sensor"}}


def test_a_rival_is_added_as_it_was_fitted_and_not_as_it_is_ranked_beside_what_it_stands_for() -> None:
    said = {"ranking": [SHARED], "joint_fit": {"terms": [EACH]}}
    assert diagnosed(said, "thermal-bias") == Term("thermal-bias", {"of": "each sensor"})


def test_what_was_not_suggested_is_added_as_it_is_ranked() -> None:
    said = {"ranking": [SHARED], "joint_fit": None}
    assert diagnosed(said, "thermal-bias") == Term("thermal-bias")
    assert diagnosed(said, "glitches") is None
    assert diagnosed(None, "glitches") is None
