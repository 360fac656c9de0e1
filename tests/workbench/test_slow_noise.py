"""What slow noise may hide is named, and nothing else is."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.diagnose import diagnose

SLOW = {"late-bias", "warm-bias"}


def flicker(rng: np.random.Generator, start_s: FloatArray) -> FloatArray:
    """1/f noise, three times as large as the white noise at one run in two."""
    count = 4096
    frequency = np.fft.rfftfreq(count)
    frequency[0] = frequency[1]
    shaped = np.fft.rfft(rng.standard_normal(count)) * np.sqrt(frequency[-1] / frequency)
    return np.asarray(3.0 * np.fft.irfft(shaped, count)[: len(start_s)])


def test_slow_effects_that_white_noise_would_show_are_named_as_hidden(made_up: Any, at_least: Any) -> None:
    named = 0
    for seed in range(8):
        found = diagnose(made_up.study(seed, {"late-bias": 20.0}, noise=flicker), ())
        assert {each.term.effect for each in found.hidden_in_slow_noise} <= SLOW
        for each in found.hidden_in_slow_noise:
            assert each.order == "start_s"
            assert each.p_value_if_white < found.alpha <= each.p_value_corrected
            (now,), (white,) = each.detectable.values(), each.detectable_if_white.values()
            assert now > 1.3 * white
        named += bool(found.suggested or found.hidden_in_slow_noise)
    # 20 sigma of white noise beside flicker that walks by as much.
    assert at_least(named, 8, 0.9)


def test_in_white_noise_nothing_is_hidden_more_often_than_the_level_says(made_up: Any) -> None:
    named = sum(bool(diagnose(made_up.study(seed), (), alpha=0.05).hidden_in_slow_noise) for seed in range(16))
    # More than four of 16 at 5 % is less likely than 1 in 1000.
    assert named <= 4


def test_where_no_order_is_known_nothing_is_hidden_along_it(made_up: Any) -> None:
    found = diagnose(made_up.study(3, {"late-bias": 4.0}, noise=flicker, order=None), ())
    assert found.hidden_in_slow_noise == ()


def test_what_is_not_slow_is_not_hidden_by_slow_noise(made_up: Any) -> None:
    for seed in range(6):
        study = made_up.study(seed, {"square": 10.0, "roll": 10.0}, noise=flicker)
        found = diagnose(study, ())
        assert not {"square", "roll"} & {each.term.effect for each in found.hidden_in_slow_noise}
