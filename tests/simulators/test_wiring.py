"""Wires between simulated instruments."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.stretches import stretches
from simulators.wiring import LINE_HISTORY_S, StretchedLine, Train, TriggerLine, VoltageLine


@given(
    st.floats(-1e3, 1e3),
    st.sampled_from([0.005, 0.01, 0.1, 1.0, 3.7]),
    st.integers(0, 50),
    st.floats(-10.0, 200.0),
    st.floats(-10.0, 200.0),
)
def test_the_edges_of_an_interval_are_those_of_the_whole_train_in_it(
    first_s: float, period_s: float, count: int, after_s: float, until_s: float
) -> None:
    every = first_s + period_s * np.arange(count, dtype=np.float64)
    for after, until in [
        (first_s + after_s, first_s + until_s),
        (-np.inf, np.inf),
        (every[count // 2 :][:1], np.inf),
    ]:
        low = float(np.max(after, initial=-np.inf))
        wanted = every[(every > low) & (every <= until)]
        assert np.array_equal(Train(first_s, period_s, count).edges(low, until), wanted)


def test_a_new_train_ends_the_one_before() -> None:
    line = TriggerLine()
    line.begin(0.0, 1.0, 10)
    line.begin(4.5, 0.5, 3)
    assert line.edges(-1.0, 100.0) == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0, 4.5, 5.0, 5.5])


@given(st.lists(st.integers(0, 4), max_size=30), st.booleans())
def test_stretches_are_every_piece_once_and_all_of_it(pieces: list[int], ordered: bool) -> None:
    piece_of = np.array(sorted(pieces) if ordered else pieces, dtype=np.intp)
    found = np.full(len(piece_of), -1)
    seen = []
    for piece, chosen in stretches(piece_of):
        assert np.all(found[chosen] == -1)
        found[chosen] = piece
        seen.append(piece)
        assert isinstance(chosen, slice) or not ordered
    assert np.array_equal(found, piece_of)
    assert sorted(seen) == sorted(set(pieces))


def test_an_undriven_wire_is_at_zero() -> None:
    assert VoltageLine().sample(np.array([-5.0, 0.0, 1e9])) == pytest.approx([0.0, 0.0, 0.0])


def test_a_wire_follows_what_drives_it_and_remembers() -> None:
    line = VoltageLine()
    line.drive(1.0, lambda times_s: 2.0 * times_s)
    line.drive(3.0, lambda times_s: np.full_like(times_s, -1.0))
    assert line.sample(np.array([0.5, 1.0, 2.0, 3.0, 9.0])) == pytest.approx([0.0, 2.0, 4.0, -1.0, -1.0])
    line.drive(3.0, lambda times_s: np.full_like(times_s, 7.0))
    assert line.sample(np.array([2.0, 3.0])) == pytest.approx([4.0, 7.0])


def test_what_is_long_past_is_forgotten_and_the_rest_is_not() -> None:
    line = VoltageLine()
    for second in range(0, 3 * int(LINE_HISTORY_S), 60):
        line.drive(float(second), lambda times_s, second=second: np.full_like(times_s, second))
    now_s = 3.0 * LINE_HISTORY_S - 60.0
    assert line.sample(np.array([now_s - LINE_HISTORY_S])) == pytest.approx([now_s - LINE_HISTORY_S])
    assert len(line._courses) < LINE_HISTORY_S / 60.0 + 3


def test_a_stretcher_keeps_the_edges_and_makes_the_pulses_longer() -> None:
    line = TriggerLine()
    longer = StretchedLine(line, 4e-3)
    line.begin(1.0, 0.5, 3)
    assert longer.edges(0.0, 9.0).tolist() == line.edges(0.0, 9.0).tolist() == [1.0, 1.5, 2.0]
    assert longer.train is line.train
    assert (line.pulse_s, longer.pulse_s) == (2e-6, 4e-3)
