"""Samples of pages are renewed with what is left out still left out."""

from __future__ import annotations

from tests.doc_samples import renewed

NOW = ["verdict: 2 effects", "+---+", "| a | 1.5 |", "|   b = 2 |", "| c | 0.1 |", "+---+", "held out: note"]


def test_a_sample_without_gaps_is_what_is_printed_now() -> None:
    assert renewed(["verdict: 1 effect", "old"], NOW) == NOW


def test_what_is_left_out_stays_so_whatever_the_numbers() -> None:
    sample = ["verdict: 9 effects", "+---+", "...", "| c | 0.7 |", "..."]
    assert renewed(sample, NOW) == ["verdict: 2 effects", "+---+", "...", "| c | 0.1 |", "..."]


def test_lines_between_two_gaps_may_have_become_more() -> None:
    sample = ["...", "| a | 9.9 |", "| c | 9.9 |", "...", "held out: note"]
    assert renewed(sample, NOW) == ["...", *NOW[2:5], "...", "held out: note"]


def test_a_line_that_is_not_printed_any_more_brings_all_back() -> None:
    assert renewed(["verdict: 9 effects", "...", "nothing alike at all ~~~~~~~~~~"], NOW) == NOW
