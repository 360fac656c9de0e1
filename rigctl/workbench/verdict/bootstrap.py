"""P-values where the noise was estimated too: a parametric bootstrap draws noise like it and estimates it again.

The null hypothesis is that no effect is hidden. Everything is linear at the fit, and data whose noise is known enter
through their Gram matrices only: a draw costs some products of small matrices.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Candidate
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.noise_estimate import NoiseEstimator
from rigctl.workbench.verdict.scan import inverse_root
from rigctl.workbench.verdict.score import ABSORBED, Score, p_of

# A law is fitted to them, so that tails beyond 1 / 300 can be told.
DRAWS = 300
# The law is looked for among these: no fewer degrees than a variance needs, no wider than eight times.
DEGREES = (40.0, 25.0, 16.0, 11.0, 8.0, 6.0, 5.0, 4.0, 3.0)
SCALES = np.geomspace(1.0, 8.0, 13)
# Drawn at once at most.
_NUMBERS = 1 << 20
# Draws that are not absorbed, below which no law is fitted.
_FEW = 50
# Of one effect: the choices of a scan meet much the same noise.
_CHOICES = 20
_HIGH = 20.0
"""Where tails are compared: some four sigma."""


@dataclass(frozen=True)
class Law:
    """How a statistic comes out with nothing hidden: T / (scale d) follows F(d, dof)."""

    scale: float
    dof: float

    def p_value(self, statistic: float, dimension: int) -> float:
        """Probability of a larger one."""
        return float(p_of(statistic / self.scale, dimension, self.dof))


class Bootstrap:
    """Laws of the statistics that noise from the scatter has a part in, from draws with nothing hidden.

    `effects` are statistics (draws, k) of each effect's candidates with their dimensions and degrees of freedom,
    `shapes` (draws, k) those of plain shapes.
    """

    def __init__(
        self, effects: Mapping[str, Sequence[tuple[FloatArray, int, float]]], shapes: FloatArray, dof: float
    ) -> None:
        self._effects = effects
        self._shapes = shapes
        self._dof = dof
        self._laws: dict[str, Law] = {}

    def law(self, effect: str) -> Law:
        """Of an effect; of a scanned one the widest of its choices."""
        if effect not in self._laws:
            laws = [_law(drawn, dimension, dof) for drawn, dimension, dof in self._effects[effect]]
            # Conservative: which choice the data will pick is not known beforehand.
            self._laws[effect] = max(laws, key=lambda law: law.p_value(_HIGH, 1))
        return self._laws[effect]

    @cached_property
    def shapes(self) -> Law:
        """Of all plain shapes together."""
        return _law(self._shapes.ravel(), 1, self._dof)


def bootstrap(
    fitted: FittedModel,
    candidates: Sequence[Candidate],
    scores: Sequence[Score],
    estimator: NoiseEstimator,
    generic: Generic,
    seed: int,
) -> Bootstrap:
    """Draws beside one fit, for its `candidates` and for plain shapes; `seed` fixes them."""
    rng = np.random.default_rng([seed, 3])
    noise, scatter = fitted.noise, estimator.rows
    data = len(noise.sigma)
    shapes = generic.main_columns(scatter)
    plain = np.zeros((data, shapes.shape[1]))
    plain[scatter] = shapes
    asked = _asked(candidates)
    tried = [*(candidates[number].derivative for number in asked), *plain.T[:, :, None]]
    widths = np.array([columns.shape[1] for columns in tried], dtype=np.intp)
    jacobian, columns = fitted.model.jacobian(fitted.result.values), np.hstack([np.zeros((data, 0)), *tried])
    # What priors say follows the data.
    rows = len(fitted.left)
    known = np.setdiff1d(np.arange(rows), scatter)
    whitened = fitted.jacobian[known], fitted.whitened_columns(columns)[known]
    # Data of known noise are needed only along the columns. Drawn themselves, and not along this basis: how it is
    # turned hangs on rounding.
    frame = orthonormal(np.hstack(whitened), 1e-9)
    above = frame.T @ whitened[0], frame.T @ whitened[1]
    drawn = np.zeros((DRAWS, len(tried)))
    dimensions = np.ones(len(tried), dtype=np.intp)
    together = max(_NUMBERS // data, 1)
    for start in range(0, DRAWS, together):
        white = rng.standard_normal((min(together, DRAWS - start), rows)).T
        along, noisy = frame.T @ white[known], np.zeros((data, white.shape[1]))
        noisy[scatter] = noise.colour(white[:data])[scatter]
        # Estimated in each draw as it is for the data: the tail is heavy because this estimate scatters.
        for place, estimated in enumerate(estimator.estimates(noisy)):
            below = estimated.whiten(np.hstack([noisy[:, [place]], jacobian, columns]))[scatter]
            drawn[start + place], dimensions = _statistics(
                np.vstack([above[0], below[:, 1 : 1 + jacobian.shape[1]]]),
                np.vstack([above[1], below[:, 1 + jacobian.shape[1] :]]),
                widths,
                np.concatenate([along[:, place], below[:, 0]]),
            )
    effects: dict[str, list[tuple[FloatArray, int, float]]] = {}
    for place, number in enumerate(asked):
        choices = effects.setdefault(candidates[number].term.effect, [])
        choices.append((drawn[:, place], int(dimensions[place]), scores[number].dof))
    return Bootstrap(effects, drawn[:, len(asked) :], float(np.min(noise.dof[scatter])))


def _asked(candidates: Sequence[Candidate]) -> list[int]:
    """Places of the candidates whose statistics are drawn: the first choices of each effect."""
    counts: Counter[str] = Counter()
    asked = []
    for number, candidate in enumerate(candidates):
        counts[candidate.term.effect] += 1
        if counts[candidate.term.effect] <= _CHOICES:
            asked.append(number)
    return asked


def _law(drawn: FloatArray, dimension: int, dof: float) -> Law:
    """Scaled F fitted to draws by likelihood; never narrower than F(d, dof) itself."""
    mean = drawn[drawn > 0.0] / dimension
    if len(mean) < _FEW:
        return Law(1.0, dof)
    # A search on a grid: the likelihood is flat in both directions where draws are few.
    degrees = (dof, *(each for each in DEGREES if each < dof))
    scaled = mean / SCALES[:, None]
    likelihood = np.array([_log_f(scaled, dimension, min(nu, 1e6)) for nu in degrees]) - len(mean) * np.log(SCALES)
    nu, scale = np.unravel_index(np.argmax(likelihood), likelihood.shape)
    return Law(float(SCALES[scale]), degrees[nu])


def _log_f(x: FloatArray, d: int, nu: float) -> FloatArray:
    """Log likelihoods (...) of the F distribution for numbers (..., n), but for what depends on d alone."""
    constant = 0.5 * d * np.log(1.0 / nu) - special.betaln(0.5 * d, 0.5 * nu)
    each = (0.5 * d - 1.0) * np.log(x) - 0.5 * (d + nu) * np.log1p(d * x / nu)
    return np.asarray(x.shape[-1] * constant + np.sum(each, axis=-1))


def _statistics(
    fitted: FloatArray, columns: FloatArray, widths: IntArray, left: FloatArray
) -> tuple[FloatArray, IntArray]:
    """(T, dimensions) of candidates whose columns stand side by side, `widths` of them each."""
    # Within each draw's own whitening: what is fitted is projected out anew.
    basis = orthonormal(fitted, 1e-8)
    free = columns - basis @ (basis.T @ columns)
    along = free.T @ (left - basis @ (basis.T @ left))
    size = np.sum(columns**2, axis=0)
    free_size = np.sum(free**2, axis=0)
    kept = free_size > ABSORBED**2 * np.where(size > 0.0, size, 1.0)
    first = np.concatenate([[0], np.cumsum(widths)[:-1]])
    statistics = np.where(kept, along**2 / np.where(kept, free_size, 1.0), 0.0)[first]
    dimensions = np.ones(len(widths), dtype=np.intp)
    for width in np.unique(widths[widths > 1]):
        numbers = np.flatnonzero(widths == width)
        places = first[numbers, None] + np.arange(width)
        scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, free_size, 1.0)), 0.0)[places]
        stack = free[:, places] * scale
        gram = np.einsum("nki,nkj->kij", stack, stack, optimize=True)
        root, determined = inverse_root(gram, kept[places])
        statistics[numbers] = np.sum(np.einsum("kij,ki->kj", root, along[places] * scale) ** 2, axis=1)
        dimensions[numbers] = np.maximum(determined.sum(axis=1), 1)
    return statistics, dimensions
