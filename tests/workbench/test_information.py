"""What runs would tell, by updates of one factor: the same as refitting everything on all runs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.next.information import Asked, Information, Precision
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.triangle import SECOND_ORDER, triangle_of
from rigctl.workbench.study import Candidate, Term
from rigctl.workbench.verdict.score import ABSORBED

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

    @property
    def names(self) -> list[str]:
        return [f"p{i}" for i in range(self.fitted.shape[1])]

    @property
    def of_effects(self) -> list[bool]:
        return [False] * self.fitted.shape[1]

    def columns(self, term: Term) -> FloatArray | None:
        return self.effects.get(term.effect)

    def rows(self, *runs: int) -> IntArray:
        """Those of the runs that were made and of these."""
        return np.concatenate([np.arange(self.made), *(self.rows_of[run] for run in runs)])

    def length(self, effect: str) -> float:
        """Of an effect's column where runs were made, and in the run ahead that tells most of it."""
        squares = self.effects[effect][:, 0] ** 2
        return float(np.sqrt(squares[: self.made].sum() + max(squares[rows].sum() for rows in self.rows_of)))


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
    """The noncentrality by projection, off an orthonormal basis of everything fitted."""
    basis, size, _ = np.linalg.svd(beside / np.linalg.norm(beside, axis=0), full_matrices=False)
    basis = basis[:, size > 1e-12 * size[0]]
    left = asked - basis @ (basis.T @ asked)
    left -= basis @ (basis.T @ left)
    return float(left @ left)


def asked(made: Design, size: FloatArray, rival: Term | None = None) -> tuple[Information, Asked]:
    information = Information(triangle_of(made, [J, K]))  # type: ignore[arg-type]
    found = information.asked(Question(J, rival, size, "typical"))
    assert found is not None
    return information, found


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([1.0, ABSORBED]))
def test_lambda_by_updates_is_that_of_a_full_refit(seed: int, hidden: float) -> None:
    made = design(seed, hidden)
    size = np.array([2.0, -3.0])
    information, question = asked(made, size, rival=K)
    beside, effect = np.hstack([made.fitted, made.effects["k"]]), made.effects["j"] @ size
    belief = np.zeros((1, beside.shape[1]))
    belief[0, -1] = SECOND_ORDER * made.length("k")

    def direct(*runs: int) -> float:
        rows = made.rows(*runs)
        return refitted(np.vstack([beside[rows], belief]), np.append(effect[rows], 0.0))

    chosen: tuple[int, ...] = ()
    for _ in range(3):
        assert information.noncentralities([question]) == pytest.approx([direct(*chosen)], rel=AGREES)
        expected = [direct(*chosen, run) for run in range(len(made.rows_of))]
        assert information.noncentralities_with_each([question])[0] == pytest.approx(np.array(expected), rel=AGREES)
        chosen = (*chosen, int(np.argmax(expected)))
        information.add(chosen[-1])


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6))
def test_what_no_run_has_told_yet_takes_its_share_of_the_next(seed: int) -> None:
    """A parameter that the runs there are do not see, beside an effect that they see: its first rows fix it."""
    made = design(seed)
    made.fitted[: made.made, -1] = 0.0
    size = np.array([1.0, 1.0])
    information, question = asked(made, size)
    effect = made.effects["j"] @ size
    expected = [refitted(made.fitted[rows], effect[rows]) for rows in map(made.rows, range(len(made.rows_of)))]
    assert information.noncentralities_with_each([question])[0] == pytest.approx(np.array(expected), rel=0.05)
    information.add(0)
    assert information.noncentralities([question]) == pytest.approx(expected[:1], rel=AGREES)


def test_a_parameter_that_is_not_in_question_is_free() -> None:
    made = design(3)
    information, question = asked(made, np.array([0.0, 1.0]))
    beside = np.hstack([made.fitted, made.effects["j"][:, :1]])[: made.made]
    expected = refitted(beside, made.effects["j"][: made.made, 1])
    assert information.noncentralities([question]) == pytest.approx([expected], rel=AGREES)


@pytest.mark.parametrize(("hidden", "absorbed"), [(1e-4, True), (1.0, False)])
def test_what_is_absorbed_promises_nothing(hidden: float, absorbed: bool) -> None:
    made = design(5, hidden)
    size = np.array([1.0, 1.0])
    information, question = asked(made, size)
    assert information.is_absorbed(question) == absorbed
    for runs in ((), (0,)):
        rows = made.rows(*runs)
        effect = (made.effects["j"] @ size)[rows]
        free = refitted(made.fitted[rows], effect)
        share = free / float(effect @ effect) / ABSORBED**2
        expected = free * min(share, 1.0) ** 2
        found = (
            information.noncentralities_with_each([question])[0, 0]
            if runs
            else information.noncentralities([question])[0]
        )
        assert found == pytest.approx(expected, rel=1e-4)


def test_what_is_left_of_an_absorbed_rival_imitates_nothing() -> None:
    """A rival is a parameter but for a millionth of it, and that part is the effect itself."""
    made = design(2)
    made.effects["k"] = made.fitted[:, -1:] + 1e-6 * np.linalg.norm(made.fitted[:, -1]) * made.effects["j"][:, :1]
    information, question = asked(made, np.array([1.0, 0.0]), rival=K)
    there = slice(made.made)
    beside = np.hstack([made.fitted, made.effects["j"][:, 1:]])[there]
    expected = refitted(beside, made.effects["j"][there, 0])
    assert information.noncentralities([question]) == pytest.approx([expected], rel=1e-2)


def test_a_term_that_no_run_can_be_asked_about_is_no_question() -> None:
    made = design(1)
    del made.effects["k"]
    information = Information(triangle_of(made, [J, K]))  # type: ignore[arg-type]
    assert information.asked(Question(J, K, np.ones(2), "typical")) is None
    assert information.asked(Question(K, None, np.ones(1), "typical")) is None
    assert information.asked(Question(J, None, np.ones(2), "typical")) is not None


@pytest.mark.parametrize("recorded", [True, False])
def test_what_else_may_act_is_believed_to_be_of_its_typical_size(recorded: bool) -> None:
    made = design(4)
    if not recorded:
        del made.effects["k"]
    other = Candidate(K, ("k",), ("V",), np.zeros((0, 1)), np.array([0.3]))
    information = Information(triangle_of(made, [J], others=[other]))  # type: ignore[arg-type]
    question = information.asked(Question(J, None, np.ones(2), "typical"))
    assert question is not None
    there = slice(made.made)
    column = made.effects["k"][there] if recorded else np.zeros((made.made, 1))
    belief = np.append(np.zeros(made.fitted.shape[1]), 1.0 / 0.3)
    beside = np.vstack([np.hstack([made.fitted[there], column]), belief])
    expected = refitted(beside, np.append(made.effects["j"][there] @ np.ones(2), 0.0))
    assert information.noncentralities([question]) == pytest.approx([expected], rel=AGREES)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6))
def test_precision_by_updates_is_that_of_a_full_refit(seed: int) -> None:
    made = design(seed)
    wanted = [made.names[0], made.names[-1]]
    precision = Precision(triangle_of(made, wanted=wanted), wanted)  # type: ignore[arg-type]
    scale = np.linalg.norm(made.fitted, axis=0)

    def direct(*runs: int) -> FloatArray:
        rows = made.fitted[made.rows(*runs)] / scale
        return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))[[0, -1]] / scale[[0, -1]]

    for chosen in ((), (0,)):
        for run in chosen:
            precision.add(run)
        assert precision.sigmas() == pytest.approx(direct(*chosen), rel=AGREES)
        expected = np.array([direct(*chosen, run) for run in range(len(made.rows_of))])
        assert precision.sigmas_with_each() == pytest.approx(expected.T, rel=AGREES)
