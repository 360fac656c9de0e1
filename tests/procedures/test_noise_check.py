"""The noise check before a campaign: what it can see, and what it says of noise that is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.sensing_axis.noise_check import SAMPLE_RATE_HZ, _density_v_rthz, require_seen
from rigctl.core.errors import ConfigError


def refusal(frequency_hz: float, duration_s: float) -> str:
    try:
        require_seen([frequency_hz], duration_s)
    except ConfigError as refused:
        return str(refused)
    return ""


@given(st.floats(0.01, 20.0), st.floats(0.1, 1000.0), st.integers(0, 2**32 - 1))
def test_what_is_not_refused_is_seen_and_what_is_told_to_be_long_enough_is(
    frequency_hz: float, duration_s: float, seed: int
) -> None:
    if said := refusal(frequency_hz, duration_s):
        assert said.endswith("0 for no check")
        enough_s = said.partition("take ")[2].partition(" s")[0]
        assert not enough_s or not refusal(frequency_hz, float(enough_s))
        return
    volts = np.random.default_rng(seed).standard_normal(max(round(duration_s * SAMPLE_RATE_HZ), 1))
    assert math.isfinite(_density_v_rthz(volts, frequency_hz))


@pytest.mark.parametrize("frequency_hz", [0.04, 0.3, 5.0])
def test_white_noise_has_the_density_it_was_made_with(frequency_hz: float) -> None:
    """Of an hour at 20 Hz; the estimate of a power scatters by the root of 1.06 over the independent values in it."""
    volts = 1e-3 * np.random.default_rng(5).standard_normal(72_000)
    found = _density_v_rthz(volts, frequency_hz)
    values = 0.2316 * frequency_hz * 3600.0
    assert found == pytest.approx(1e-3 * math.sqrt(2.0 / SAMPLE_RATE_HZ), rel=0.5 * 5.0 * math.sqrt(1.06 / values))
