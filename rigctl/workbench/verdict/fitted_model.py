"""A model fitted to its data: parameters, the noise it was fitted with, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rigctl.analysis.least_squares import FitResult, Parameter
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import UNFIT, ProcedureError
from rigctl.workbench.findings import Estimate
from rigctl.workbench.known_inputs import HasKnownInputs, KnownInputs
from rigctl.workbench.other_minima import HasOtherMinima
from rigctl.workbench.study import Model
from rigctl.workbench.verdict.absorbed import absorbed_parameters
from rigctl.workbench.verdict.first_order import found_at_least
from rigctl.workbench.verdict.held_out import HeldOut, error_ratio
from rigctl.workbench.verdict.noise import Noise, orthonormal
from rigctl.workbench.verdict.propagated import propagated
from rigctl.workbench.verdict.score import UNDETERMINED, Projector, p_of
from rigctl.workbench.verdict.whitened_fit import whitened_least_squares

_ELSEWHERE = 3.0
"""Sigmas beyond which another place is another minimum."""

_TOLD_APART = 9.0
"""Difference of chi-square, three sigma, by which the data themselves choose between two minima."""

_SAME_CHI2 = 1e-6


@dataclass(frozen=True)
class Uncertainty:
    """The covariance of all parameters about their values; by place in it an interval (low, high) of 68 % of those of
    which standard uncertainties are no fair picture."""

    covariance: FloatArray
    intervals: Mapping[int, tuple[float, float]]


class FittedModel:
    """A model with `noise`, the parameters that are `held` at zero while the rest is fitted, and the `result`."""

    def __init__(self, model: Model, noise: Noise, held: frozenset[str], result: FitResult) -> None:
        self.model = model
        self.noise = noise
        self.held = held
        self.result = result

    @classmethod
    def where_it_ended(
        cls, model: Model, noise: Noise, held: frozenset[str], values: Mapping[str, float]
    ) -> FittedModel:
        """A fit that has been made, from the values where it ended: the same bit for bit."""
        parameters = _from(model, held, values)
        return cls(model, noise, held, whitened_least_squares(model, noise, parameters, max_iterations=0))

    def with_noise(self, noise: Noise) -> FittedModel:
        """The model fitted anew from here with another noise."""
        return FittedModel(self.model, noise, self.held, _fit(self.model, noise, self.held, self.values, fitted=True))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return self.result.names

    @property
    def values(self) -> dict[str, float]:
        """Of the parameters by name."""
        return dict(zip(self.names, map(float, self.result.values), strict=True))

    @cached_property
    def scanned(self) -> frozenset[str]:
        """Parameters of terms that a scan has found; they have priors."""
        return scanned_parameters(self.model)

    def unexplained(self) -> FloatArray:
        """Data - model at the fit, in the data's units, shape (n,)."""
        return np.asarray(self.model.observations.value - self.model.predict(self.result.values))

    def whitened(self) -> FloatArray:
        """W (data - model), shape (n,): unit variance where the model is right."""
        return self.result.residuals

    def let_go(self) -> None:
        """Keep nothing as long as several columns of the data; what is asked again is worked out again, the same."""
        self.result = replace(self.result, jacobian=self.result.jacobian[:0].copy())
        for name in ("slopes", "projector", "held_out"):
            self.__dict__.pop(name, None)

    @cached_property
    def slopes(self) -> FloatArray:
        """d (whitened model) / d parameters, shape (n, m)."""
        of_fit = self.result.jacobian
        if len(of_fit) == len(self.result.residuals):
            return of_fit
        return self.noise.whiten(self.model.jacobian(self.result.values))

    @property
    def jacobian(self) -> FloatArray:
        """d (whitened model) / d parameters with the priors' rows below the data, shape (n + priors, m)."""
        priors = [
            (column, each.prior.sigma)
            for column, each in enumerate(self.model.parameters)
            if each.prior is not None and not each.fixed
        ]
        if not priors:
            return self.slopes
        below = np.zeros((len(priors), len(self.model.parameters)), order="F")
        for row, (column, sigma) in enumerate(priors):
            below[row, column] = 1.0 / sigma
        return np.vstack([self.slopes, below])

    @cached_property
    def left(self) -> FloatArray:
        """Whitened residuals with the priors' below, shape (n + priors,)."""
        pulls = [
            (each.prior.mean - value) / each.prior.sigma
            for each, value in zip(self.model.parameters, self.result.values, strict=True)
            if each.prior is not None and not each.fixed
        ]
        if not pulls:
            return self.result.residuals
        return np.concatenate([self.result.residuals, np.array(pulls, dtype=np.float64)])

    @cached_property
    def projector(self) -> Projector:
        """What the fitted parameters leave free."""
        return Projector(self.jacobian, self.left, self.noise.dof, len(self.result.residuals), self.noise.between)

    def projector_with(self, columns: FloatArray) -> Projector:
        """The same with whitened columns (n + priors, k) among what is fitted."""
        jacobian = np.hstack([self.jacobian, columns])
        return Projector(jacobian, self.left, self.noise.dof, len(self.result.residuals), self.noise.between)

    def padded(self, columns: FloatArray) -> FloatArray:
        """Zero rows for the priors below."""
        return np.vstack([columns, np.zeros((len(self.left) - len(columns), columns.shape[1]))])

    def whitened_columns(self, columns: FloatArray) -> FloatArray:
        """Derivatives (n, k) whitened, with rows for the priors, shape (n + priors, k)."""
        return self.padded(self.noise.whiten(columns))

    def shown(self, effect: str) -> tuple[FloatArray, FloatArray]:
        """What the fitted amplitudes of an effect show, whitened, (n + priors,), and the derivatives by all else.

        What the effect was scanned for is part of all else.
        """
        chosen = {f"{term.effect}.{name}" for term in self.model.terms for name in term.choice}
        pairs = zip(self.names, self.model.owners, strict=True)
        sizes = [place for place, (name, owner) in enumerate(pairs) if owner == effect and name not in chosen]
        jacobian = self.jacobian
        return jacobian[:, sizes] @ self.result.values[sizes], np.delete(jacobian, sizes, axis=1)

    def p_without(self, effect: str) -> float:
        """Of the rise of chi-square, at most, without an effect and all else fitted anew: no fit is made.

        To first order it rises by the Wald statistic of the amplitudes (Trans. Am. Math. Soc. 54 (1943) 426).
        """
        shown, rest = self.shown(effect)
        projector = Projector(rest, shown, self.noise.dof, len(self.result.residuals), self.noise.between)
        return self.p_of_shown(effect, shown, projector)

    def p_of_shown(self, effect: str, shown: FloatArray, projector: Projector, imitated: float = 0.0) -> float:
        """P-value at most of what a projector has left of what an effect shows, less what others imitate of it."""
        wald = float(projector.left @ projector.left)
        basis = projector.left[:, None] / np.sqrt(max(wald, np.finfo(float).tiny))
        rise = found_at_least(max(wald - imitated, 0.0), float(shown @ shown))
        return float(p_of(rise, max(self.model.owners.count(effect), 1), projector.dof_of(basis)))

    @cached_property
    def held_out(self) -> HeldOut:
        """The blocks, each predicted from the others."""
        return HeldOut(self.model.observations, self.projector.basis, self.projector.left)

    @cached_property
    def held_out_error(self) -> float:
        """Rms of what is left in units of the noise of blocks that the others predict; NaN where none can."""
        return self.held_out.error()

    @property
    def uncertainty(self) -> Uncertainty:
        """How well the parameters are known: by the data, and by the model's inputs."""
        by_inputs = sum((covariance for _, covariance in self.by_inputs), np.zeros_like(self.result.covariance))
        return Uncertainty(self.result.covariance + by_inputs, {})

    @cached_property
    def by_inputs(self) -> Sequence[tuple[KnownInputs, FloatArray]]:
        """Each group of inputs of the model, and the covariance (m, m) of the parameters that comes from it."""
        model = self.model
        if not isinstance(model, HasKnownInputs):
            return ()
        return [(each, propagated(model, self.noise, self.result, each)) for each in model.known_inputs]

    def estimates(self) -> dict[str, Estimate]:
        """Parameters by name."""
        known = self.uncertainty
        sigmas = np.sqrt(np.maximum(np.diag(known.covariance), 0.0))
        sigmas[[name in self.held for name in self.names]] = np.nan
        rows = zip(self.names, self.result.values, sigmas, self.model.units, strict=True)
        return {
            name: Estimate(float(value), float(sigma), unit, known.intervals.get(place))
            for place, (name, value, sigma, unit) in enumerate(rows)
        }

    def chi2_p_value(self, told: float = 0.0) -> float:
        """Of all that is left, the noise being known no better than it is; NaN without degrees of freedom.

        Of these data `told` degrees of freedom told the scale of their own noise, and say nothing more.
        """
        if self.result.dof <= 0:
            return float("nan")
        if self.result.dof <= told:
            return 1.0
        counts = zip(*np.unique(self.noise.dof, return_counts=True), strict=True)
        # Satterthwaite: each group of data has a scale of its own, known from so many degrees of freedom.
        spread = sum(float(number) ** 2 / dof for dof, number in counts if np.isfinite(dof))
        dof = len(self.noise.dof) ** 2 / spread if spread > 0.0 else np.inf
        return float(p_of(max(self.result.chi2 - told, 0.0), self.result.dof - told, dof))

    def error(self) -> float:
        """Rms of what is left in units of the noise, degrees of freedom considered; NaN without any."""
        return float(np.sqrt(self.result.chi2_per_dof))

    def chi2_with(self, noise: Noise) -> float:
        """Chi-square of what is left and of the priors in units of another noise, at the fit as it is."""
        white = noise.whiten(self.unexplained())
        pulls = self.left[len(white) :]
        return float(white @ white + pulls @ pulls)


def stated_noise(model: Model) -> Noise:
    """The noise as a model's observations state it."""
    given = model.observations
    return Noise(given.sigma, np.full(len(given.value), np.inf), given.factors, ())


def fit_with_given_noise(
    model: Model, start: Mapping[str, float], noise: Noise | None = None, held: frozenset[str] = frozenset()
) -> FittedModel:
    """Fit a model from `start`, by name, with `noise`, by default as stated; `ProcedureError`.

    `held` parameters stay at zero, by default those that others imitate.
    """
    scanned, noise = scanned_parameters(model), noise or stated_noise(model)
    # Another choice of the same name is nowhere to start from.
    usable = {name: value for name, value in start.items() if name not in scanned}
    with suppress(*UNFIT):
        if held:
            return _fitted_from(model, noise, held, usable)
        found = _held_where_it_ends(
            _fitted_from(model, noise, absorbed_parameters(model, noise, scanned, usable), usable)
        )
        return found if usable else _freed_where_effects_end(found)
    # Where another model ended may be nowhere to start from.
    if usable:
        with suppress(*UNFIT):
            return _fitted_from(model, noise, absorbed_parameters(model, noise, scanned, {}), {})
    # An effect may be determined only where the model without effects fits.
    effects = frozenset(each.name for each, owner in zip(model.parameters, model.owners, strict=True) if owner)
    without = _fitted_from(model, noise, effects, {}).values
    return _freed_where_effects_end(
        _fitted_from(model, noise, absorbed_parameters(model, noise, scanned, without), without)
    )


def _held_where_it_ends(fitted: FittedModel) -> FittedModel:
    """The fit with those parameters held that others imitate where it ends: a scan's place may be far from there.

    Amplitudes at a period that a recording has one cycle of are told apart at a third of it, where the fit goes.
    """
    model, noise = fitted.model, fitted.noise
    if not fitted.held or not fitted.scanned:
        return fitted
    with suppress(*UNFIT):
        held = fitted.held & absorbed_parameters(model, noise, fitted.scanned, fitted.values)
        if held < fitted.held:
            freed = _fitted_from(model, noise, held, fitted.values)
            if freed.result.chi2 <= fitted.result.chi2:
                return freed
    return fitted


def _freed_where_effects_end(fitted: FittedModel) -> FittedModel:
    """The best fit from where one of the effects alone ends, if fewer parameters are imitated there.

    Near zero a delay does what damping does, and one of them is held; at the size that damping has they differ.
    """
    model, best = fitted.model, fitted
    effects = dict.fromkeys(owner for owner in model.owners if owner)
    if not fitted.held or len(effects) < 2:
        return fitted
    names = [each.name for each in model.parameters]
    for effect in effects:
        others = frozenset(name for name, owner in zip(names, model.owners, strict=True) if owner not in ("", effect))
        with suppress(*UNFIT):
            alone = _fitted_from(model, fitted.noise, others, {}).values
            held = absorbed_parameters(model, fitted.noise, fitted.scanned, alone)
            if held < best.held:
                freed = _fitted_from(model, fitted.noise, held, alone)
                best = min(best, freed, key=lambda each: each.result.chi2)
    return best


def _fitted_from(model: Model, noise: Noise, held: frozenset[str], start: Mapping[str, float]) -> FittedModel:
    return FittedModel(model, noise, held, _fit(model, noise, held, start))


def scanned_parameters(model: Model) -> frozenset[str]:
    """Parameters of terms that a scan has found; they have priors."""
    pairs = zip(model.parameters, model.owners, strict=True)
    return frozenset(each.name for each, owner in pairs if owner and each.prior is not None)


def scanned_places(model: Model, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """By effect what was scanned for of it, at these values by name."""
    places: dict[str, dict[str, float]] = {}
    chosen = {term.effect: term.choice for term in model.terms}
    for each, owner in zip(model.parameters, model.owners, strict=True):
        name = each.name.rpartition(".")[2]
        if name in chosen.get(owner, {}):
            places.setdefault(owner, {})[name] = values[each.name]
    return places


def _fit(
    model: Model, noise: Noise, held: frozenset[str], start: Mapping[str, float], *, fitted: bool = False
) -> FitResult:
    """`fitted`: all of `start` is where a fit of this model has ended."""
    parameters = _from(model, held, start)
    if (scanned := scanned_parameters(model)) and not fitted:
        # A time or a frequency means something where its amplitude is right: that first.
        amplitudes_free = [replace(each, fixed=each.fixed or each.name in scanned) for each in parameters]
        sizes = np.nan_to_num(whitened_least_squares(model, noise, amplitudes_free).values)
        parameters = [replace(each, start=float(size)) for each, size in zip(parameters, sizes, strict=True)]
    result = _of_the_best_minimum(model, noise, parameters, whitened_least_squares(model, noise, parameters))
    if result.verdict == "ill-conditioned":
        raise ProcedureError(f"the fit is singular: {result.reason}")
    if not np.isfinite(result.values).all():
        raise ProcedureError(f"the runs do not determine the model: {result.reason}")
    return result


def _from(model: Model, held: frozenset[str], start: Mapping[str, float]) -> list[Parameter]:
    chosen = {f"{term.effect}.{name}" for term in model.terms for name in term.choice}
    return [
        # A period that is not determined stays the one that was chosen; an amplitude is none.
        replace(each, start=each.start if each.name in chosen else 0.0, fixed=True)
        if each.name in held
        else replace(each, start=float(np.clip(start.get(each.name, each.start), each.lower, each.upper)))
        for each in model.parameters
    ]


def _of_the_best_minimum(model: Model, noise: Noise, parameters: Sequence[Parameter], result: FitResult) -> FitResult:
    """The result of a fit, or of one that ends in another minimum where the data do not speak for this one."""
    if not isinstance(model, HasOtherMinima) or not np.isfinite(result.values).all():
        return result
    for place in [each.of for each in model.elsewhere(result.values)]:
        # Seen from where the fit is by now; one that was there before may be gone.
        other = next((each for each in model.elsewhere(result.values) if each.of == place), None)
        if other is None:
            continue
        sigma = float(np.sqrt(result.covariance[other.of, other.of]))
        # A parameter that is held, and one that is there already.
        if not abs(other.values[other.of] - result.values[other.of]) > _ELSEWHERE * sigma > 0.0:
            continue
        there = [
            each if each.fixed else replace(each, start=other.values.get(number, float(result.values[number])))
            for number, each in enumerate(parameters)
        ]
        found = whitened_least_squares(model, noise, there)
        less = found.chi2 < result.chi2 + (_TOLD_APART if other.likelier else -_SAME_CHI2)
        if found.verdict != "ill-conditioned" and np.isfinite(found.values).all() and less:
            result = found
    return result


def refitted_values(model: Model, noise: Noise, held: frozenset[str], start: Mapping[str, float]) -> dict[str, float]:
    """Parameters by name where a fit from exactly `start` ends, which never explains less than `start` does.

    What a scan has chosen is held at first: it means nothing while its amplitude is zero.
    """
    chosen = {f"{term.effect}.{name}" for term in model.terms for name in term.choice}
    values = dict(start)
    # Amplitudes first, then what was scanned for too.
    for waiting in (chosen, set[str]()):
        parameters = [
            # Where a smaller model ended, a scan may have been placed elsewhere.
            replace(
                each,
                start=float(np.clip(values[each.name], each.lower, each.upper)),
                fixed=each.fixed or each.name in held or each.name in waiting,
            )
            for each in model.parameters
        ]
        found = whitened_least_squares(model, noise, parameters).values
        if np.isfinite(found).all():
            values = {each.name: float(value) for each, value in zip(model.parameters, found, strict=True)}
    return values


def fit_that_explains_no_less(
    model: Model, noise: Noise, held: frozenset[str], start: Mapping[str, float]
) -> FittedModel:
    """A fit from exactly `start`, which explains no less than that does; `ProcedureError` where it is singular."""
    ended = refitted_values(model, noise, held, start)
    return FittedModel(model, noise, held, _fit(model, noise, held, ended, fitted=True))


def held_out_ratio(after: FittedModel, before: FittedModel) -> float:
    """Held-out error after over before, in the series that changed, with one noise for both; NaN if unknown."""
    data = len(after.result.residuals)
    if len(after.left) < data or data != len(before.result.residuals):
        return float("nan")
    touched = _touched(after, before)
    # The model before in the noise of the one after: two estimates of the noise would not compare.
    jacobian = np.vstack([after.noise.whiten(before.model.jacobian(before.result.values)), before.jacobian[data:]])
    basis = orthonormal(jacobian, UNDETERMINED)
    left = np.concatenate([after.noise.whiten(before.unexplained()), before.left[data:]])
    earlier = HeldOut(before.model.observations, basis, left - basis @ (basis.T @ left))
    return error_ratio(after.held_out.error(series=touched), earlier.error(series=touched))


def _touched(after: FittedModel, before: FittedModel) -> IntArray:
    """Series in which the two models differ at all."""
    change = np.abs(after.noise.whiten(after.unexplained() - before.unexplained()))
    given = after.model.observations
    largest = np.zeros(len(given.series))
    np.maximum.at(largest, given.series_of, change)
    # What an effect does in the other series is rounding, or less than anybody would see.
    return np.flatnonzero(largest > 1e-3 * largest.max())
