"""Candidates scored beside a fitted model, one by one or all choices of a scan together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from rigctl.analysis.sketch import sketch_of
from rigctl.analysis.summed_columns import SummedColumns, SummedScan
from rigctl.analysis.unit_columns import Scan, UnitColumns
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.groups import ScanChoices
from rigctl.workbench.study import Candidate
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.scan import TOGETHER, OwnNoise, ScanScores, asked_along
from rigctl.workbench.verdict.score import Projector, Score, p_of
from rigctl.workbench.verdict.shared import common_ratio

_TOGETHER_AT_MOST = 4_000_000
"""Numbers of columns that are whitened and projected at once."""


class Scoring:
    """The scores of candidates in what a `projector` has left beside a `fitted` model.

    `frame` spans all that was projected out where the noise was estimated; without it the noise counts as known.
    """

    def __init__(self, fitted: FittedModel, projector: Projector, frame: FloatArray | None = None) -> None:
        self._fitted, self._noise = fitted, fitted.noise
        self._projector, self._frame = projector, frame
        self._sketches: dict[int, FloatArray] = {}

    def of_each(self, candidates: Sequence[Candidate]) -> list[Score]:
        """Of several; those whose columns are there together."""
        columns = [each.derivative for each in candidates if isinstance(each.columns, np.ndarray)]
        if not columns or len(columns) < len(candidates) or sum(map(np.size, columns)) > _TOGETHER_AT_MOST:
            return list(map(self.of, candidates))
        ends = np.cumsum([each.shape[1] for each in columns])[:-1]
        white = np.split(self._fitted.whitened_columns(np.hstack(columns)), ends, axis=1)
        return [self._judged(score) for score in self._projector.scores(white)]

    def _judged(self, score: Score) -> Score:
        return score if self._own is None else self._by_own_noise(score, self._own)

    def of(self, candidate: Candidate) -> Score:
        """Of one candidate."""
        columns = self._fitted.whitened_columns(candidate.derivative)
        score = self._judged(self._projector.score(columns))
        if isinstance(candidate.columns, np.ndarray | Scan):
            return score
        # Of columns that are made when they are asked for a sketch is kept, and the basis made again.
        self._sketches[id(candidate)] = sketch_of(len(columns)).of(columns)
        return replace(score, of=partial(self._basis, candidate))

    def most_explained(self, choices: Sequence[Candidate]) -> float:
        """The largest statistic of some choices."""
        if len(choices) >= TOGETHER:
            return self.of_scan(choices).largest
        return max(self.of(each).statistic for each in choices)

    def done(self) -> None:
        """All scans have been scored: what they were scored with is as long as some columns."""
        self.__dict__.pop("_along", None)

    def sketches(self, candidates: Sequence[Candidate]) -> list[FloatArray]:
        """Sketches of candidates' whitened columns, (buckets, d) each."""
        missing = [each for each in candidates if id(each) not in self._sketches]
        # Correlated noise is taken off many columns in little more time than off one.
        together = max(_TOGETHER_AT_MOST // (len(self._fitted.left) * len(missing[0].names)), 1) if missing else 1
        for first in range(0, len(missing), together):
            some = missing[first : first + together]
            columns = [each.derivative for each in some]
            ends = np.cumsum([each.shape[1] for each in columns])[:-1]
            white = np.split(self._fitted.whitened_columns(np.hstack(columns)), ends, axis=1)
            made = (sketch_of(len(each)).of(each) for each in white)
            self._sketches.update(zip(map(id, some), made, strict=True))
        return [self._sketches[id(each)] for each in candidates]

    def _basis(self, candidate: Candidate) -> FloatArray:
        return self._projector.score(self._fitted.whitened_columns(candidate.derivative)).basis

    def of_scan(self, choices: Sequence[Candidate]) -> ScanScores:
        """Of all choices of a scan."""
        scan, asked = choices[0].columns, _places(choices)
        # Sums over the rows cannot be whitened across them.
        summed = isinstance(scan, SummedScan) and bool(self._noise.factors)
        if summed or not isinstance(scan, Scan | SummedScan):
            scan, asked = Scan(np.stack([each.derivative for each in choices], axis=1)), np.arange(len(choices))
        unit, scale = self.unit_columns(scan)
        scores = ScanScores(self._projector, unit, scale, self._own, self._along, asked)
        if summed and isinstance(unit, UnitColumns):
            self._keep_sketches(choices, unit)
        return scores

    def _keep_sketches(self, choices: Sequence[Candidate], unit: UnitColumns) -> None:
        """Of whitened columns, which are too many to be kept and take long to make again."""
        data, sketch = self._projector.data, sketch_of(len(self._fitted.left))
        for number, each in enumerate(choices):
            self._sketches[id(each)] = sketch.of(unit.columns(number) * unit.size[number], slice(data))
        unit.let_go(lambda place: self._fitted.whitened_columns(choices[place].derivative)[:data])

    @cached_property
    def _in_frame(self) -> FloatArray:
        """What of the residuals goes along the frame."""
        assert self._frame is not None
        return np.asarray(self._frame.T @ self._fitted.left[: len(self._frame)])

    @cached_property
    def _own(self) -> OwnNoise | None:
        return None if self._frame is None else OwnNoise(self._frame, float(self._noise.dof[0]), self._noise.least)

    @cached_property
    def _along(self) -> FloatArray:
        return asked_along(self._projector, self._own)

    def unit_columns(self, scan: Scan | SummedScan) -> tuple[UnitColumns | SummedColumns, float]:
        """The whitened columns of a scan at unit length, and the factor by which they are longer than kept ones."""
        given = self._fitted.model.observations
        scale = None if self._noise.factors else common_ratio(given.sigma, self._noise.sigma)
        if scale is None:
            return scan.whitened(self._noise, self._noise.whiten), 1.0
        # The same columns in every model, but for one factor.
        return scan.whitened(given, lambda columns: columns / given.sigma[:, None]), scale

    def _by_own_noise(self, score: Score, own: OwnNoise) -> Score:
        """With the scale of the noise as it is once the candidate is in: what it explains inflates it before."""
        frame = own.frame
        basis, left = score.basis[: len(frame)], self._fitted.left[: len(frame)]
        # What of the candidate was not projected out when the noise was estimated: it is in the noise's square sum.
        inside = frame.T @ basis
        explained = float(np.sum((basis.T @ left - inside.T @ self._in_frame) ** 2))
        taken = max(float(np.sum(basis**2) - np.sum(inside**2)), 0.0)
        rest = own.dof - taken
        if rest < 1.0 or not score.dimension:
            return score
        # The scale was 1, so that `dof` is the square sum before; `explained` is what the candidate takes of it.
        p_value = p_of(score.statistic / own.variance(explained, rest), score.dimension, rest)
        return replace(score, dof=rest, p_value=float(p_value))


def _places(choices: Sequence[Candidate]) -> IntArray:
    """Of candidates in their scan."""
    if isinstance(choices, ScanChoices):
        return choices.places
    return np.array([each.place for each in choices], dtype=np.intp)
