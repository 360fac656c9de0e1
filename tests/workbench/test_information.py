"""What runs would tell, by updates of one factor: the same as refitting everything on all runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.workbench.information import Precision, Triangle
from rigctl.workbench.questions import Question
from rigctl.workbench.score import ABSORBED
from rigctl.workbench.study import FloatArray, IntArray, Term

J, K = Term("j"), Term("k")
AGREES = 1e-6


@dataclass
class Design:
    """Rows as `Imagined` has them: blocks with nuisances of their own, the last of which goes on."""

    fitted: FloatArray
    effects: dict[str, FloatArray]
    made: int
    rows_of: list[IntArray]
    beliefs: int = 0
    names: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.names = [f"p{i}" for i in range(self.fitted.shape[1])]

    def columns(self, term: Term) -> FloatArray | None:
        return self.effects.get(term.effect)

    def rows(self, *runs: int) -> IntArray:
        """Those of the runs that were made and of these."""
        return np.concatenate([np.arange(self.made), *(self.rows_of[run] for run in runs)])


def design(seed: int, hidden: float = 1.0) -> Design:
    """Of any sizes and scales; of effect j a share of about `hidden` escapes the parameters where runs were made."""
    rng = np.random.default_rng(seed)
    blocks, width, shared = rng.integers(1, 5), rng.integers(1, 4), rng.integers(1, 5)
    per_block, lengths = width + shared + rng.integers(3, 8), rng.integers(1, 5, rng.integers(1, 7))
    made = blocks * per_block
    rows = made + lengths.sum()
    block = np.append(np.repeat(np.arange(blocks), per_block), np.full(lengths.sum(), blocks - 1))
    local = [np.where((block == b)[:, None], rng.standard_normal((rows, width)), 0.0) for b in range(blocks)]
    fitted = np.hstack([*local, rng.standard_normal((rows, shared))])
    effects = {"j": rng.standard_normal((rows, 2)), "k": rng.standard_normal((rows, 1))}
    imitated = fitted @ rng.standard_normal((fitted.shape[1], 2))
    effects["j"][:made] = hidden * effects["j"][:made] + imitated[:made]
    fitted = fitted * 10.0 ** rng.uniform(-6.0, 6.0, fitted.shape[1])
    bounds = made + np.cumsum([0, *lengths])
    return Design(fitted, effects, made, [np.arange(a, b) for a, b in pairwise(bounds)])


def refitted(beside: FloatArray, asked: FloatArray) -> float:
    """The noncentrality by projection, out of an orthonormal basis of everything fitted."""
    basis, size, _ = np.linalg.svd(beside / np.linalg.norm(beside, axis=0), full_matrices=False)
    basis = basis[:, size > 1e-12 * size[0]]
    left = asked - basis @ (basis.T @ asked)
    left -= basis @ (basis.T @ left)
    return float(left @ left)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([1.0, ABSORBED]))
def test_lambda_by_updates_is_that_of_a_full_refit(seed: int, hidden: float) -> None:
    made = design(seed, hidden)
    size = np.array([2.0, -3.0])
    known = Triangle(made, [J, K]).about(Question(J, K, size, "typical"))  # type: ignore[arg-type]
    assert known is not None
    beside, asked = np.hstack([made.fitted, made.effects["k"]]), made.effects["j"] @ size

    def direct(*runs: int) -> float:
        rows = made.rows(*runs)
        return refitted(beside[rows], asked[rows])

    chosen: tuple[int, ...] = ()
    for _ in range(3):
        assert known.lambda_now() == pytest.approx(direct(*chosen), rel=AGREES)
        ahead = range(len(made.rows_of))
        expected = [direct(*chosen, run) for run in ahead]
        assert known.lambda_with(ahead) == pytest.approx(np.array(expected), rel=AGREES)
        chosen = (*chosen, int(np.argmax(expected)))
        known.add(chosen[-1])


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6))
def test_what_no_run_has_told_yet_takes_its_share_of_the_next(seed: int) -> None:
    """A rival that the runs there are do not see, beside an effect that they see: its first rows fix it."""
    made = design(seed)
    made.effects["k"][: made.made] = 0.0
    size = np.array([1.0, 1.0])
    known = Triangle(made, [J, K]).about(Question(J, K, size, "typical"))  # type: ignore[arg-type]
    assert known is not None
    beside, asked = np.hstack([made.fitted, made.effects["k"]]), made.effects["j"] @ size
    ahead = range(len(made.rows_of))
    expected = [refitted(beside[made.rows(run)], asked[made.rows(run)]) for run in ahead]
    assert known.lambda_with(ahead) == pytest.approx(np.array(expected), rel=AGREES)


def test_a_parameter_that_is_not_in_question_is_free() -> None:
    made = design(3)
    size = np.array([0.0, 1.0])
    known = Triangle(made, [J]).about(Question(J, None, size, "typical"))  # type: ignore[arg-type]
    assert known is not None
    beside = np.hstack([made.fitted, made.effects["j"][:, :1]])[: made.made]
    assert known.lambda_now() == pytest.approx(refitted(beside, made.effects["j"][: made.made, 1]), rel=AGREES)


def test_what_is_absorbed_promises_nothing() -> None:
    size = np.array([1.0, 1.0])
    for hidden, absorbed in ((1e-4, True), (1.0, False)):
        made = design(5, hidden)
        known = Triangle(made, [J]).about(Question(J, None, size, "typical"))  # type: ignore[arg-type]
        assert known is not None
        assert known.absorbed == absorbed
        asked = (made.effects["j"] @ size)[: made.made]
        free = refitted(made.fitted[: made.made], asked)
        share = free / float(asked @ asked) / ABSORBED**2
        assert known.lambda_now() == pytest.approx(free * min(share, 1.0) ** 2, rel=AGREES)


def test_a_term_that_cannot_be_asked_about_has_no_information() -> None:
    made = design(1)
    del made.effects["k"]
    assert Triangle(made, [J, K]).about(Question(J, K, np.ones(2), "typical")) is None  # type: ignore[arg-type]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6))
def test_precision_by_updates_is_that_of_a_full_refit(seed: int) -> None:
    made = design(seed)
    wanted = [made.names[0], made.names[-1]]
    precision: Precision = Triangle(made, wanted=wanted).precision()  # type: ignore[arg-type]
    scale = np.linalg.norm(made.fitted, axis=0)

    def direct(*runs: int) -> FloatArray:
        rows = made.fitted[made.rows(*runs)] / scale
        return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))[[0, -1]] / scale[[0, -1]]

    for chosen in ((), (0,)):
        for run in chosen:
            precision.add(run)
        assert precision.sigma_now() == pytest.approx(direct(*chosen), rel=AGREES)
        expected = np.array([direct(*chosen, run) for run in range(len(made.rows_of))])
        assert precision.sigma_with(range(len(made.rows_of))) == pytest.approx(expected, rel=AGREES)
