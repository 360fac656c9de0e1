"""Normal numbers by counter: normal, independent, and a function of key and place."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.layout import LANES
from simulators.worlds.satellite.normals import PER_STEP, fill, key_of


def numbers(keys: list[int], steps: range) -> FloatArray:
    """(steps, PER_STEP, LANES)."""
    words = np.empty(PER_STEP * LANES, dtype=np.uint64)
    made = np.empty((len(steps), PER_STEP * LANES))
    named = np.array([key_of("test", key) for key in keys], dtype=np.uint64)
    for row, step in enumerate(steps):
        fill(made[row], words, words.view(np.float64), named, step)
    return made.reshape(len(steps), PER_STEP, LANES)


@pytest.fixture(scope="module")
def many() -> FloatArray:
    return numbers(list(range(LANES)), range(6000))


def test_they_are_normal_to_their_tails(many: FloatArray) -> None:
    assert stats.kstest(many.ravel(), "norm").pvalue > 1e-3
    assert 4.6 < np.abs(many).max() < 6.6
    beyond_3 = np.mean(np.abs(many) > 3.0) / (2.0 * stats.norm.sf(3.0))
    assert beyond_3 == pytest.approx(1.0, abs=5.0 / np.sqrt(2.0 * stats.norm.sf(3.0) * many.size))


def test_lanes_channels_and_steps_are_independent(many: FloatArray) -> None:
    columns = many.reshape(len(many), -1)
    correlation = np.corrcoef(columns.T) - np.eye(columns.shape[1])
    assert np.abs(correlation).max() * np.sqrt(len(many)) < 6.0
    following = np.mean(columns[1:] * columns[:-1], axis=0) * np.sqrt(len(many))
    assert np.abs(following).max() < 5.0


def test_a_number_depends_on_its_own_key_and_step_alone() -> None:
    one = numbers([7] * LANES, range(5))
    other = numbers([3, 7, *range(100, 98 + LANES)], range(2, 5))
    assert np.array_equal(one[2:, :, 0], other[:, :, 1])
    assert not np.any(one[2:, :, 0] == other[:, :, 0])


def test_steps_beyond_32_bits_are_not_needed() -> None:
    """The counter's first word is the step: a mission of thirty years at 4 Hz fits into it."""
    assert 30 * 366 * 86400 * 4 < 2**32
