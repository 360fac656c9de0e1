"""Models of long tables are large: one that nobody needs any longer is gone at once."""

from __future__ import annotations

import gc
import weakref
from typing import Any

from rigctl.workbench.verdict.attempt import Attempt


def test_a_model_whose_every_question_was_answered_does_not_wait_for_the_collector(made_up: Any) -> None:
    attempt = Attempt(made_up.study(3, {"lag": 30.0}), ())
    assert attempt.scored
    assert attempt.best_shape is not None
    assert attempt.trials.all > 1.0
    assert attempt.bootstrap.shapes.scale >= 1.0
    seen = weakref.ref(attempt)
    gc.disable()
    try:
        del attempt
        assert seen() is None
    finally:
        gc.enable()
