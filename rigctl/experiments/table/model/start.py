"""Start values of a table's fit: linear parameters are solved for, the others searched for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from rigctl.analysis.column_sums import StepSums
from rigctl.analysis.decomposition import svd
from rigctl.analysis.least_squares import FitResult, Parameter
from rigctl.campaign.recording import TableFlaw
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.model.descent import descend
from rigctl.experiments.table.model.scanned import Scanned, Step
from rigctl.experiments.table.observe.expression import refuse_undefined
from rigctl.experiments.table.observe.readings import Readings

POINTS_MAX = 1500
"""The longest grid of a scan."""

_DRAWS, _TRIED = 400, 8
_MODEST = 8
_PLACES_AT_ONCE = 32
_RANK = 1e-13
FREE = 1e-9
"""Of a step's square: with less left beside all else that is fitted it is no step of its own."""
_PLACED = 1e-3
"""Of the way between a value's neighbours on the grid: the fit goes on from there."""
# Squares beyond overflow when they are summed.
_HUGE = 1e100


class TooLarge(DataError, np.linalg.LinAlgError):
    """Terms or parameters overflow 64-bit numbers: a search tries other values."""


def solve(design: FloatArray, target: FloatArray) -> FloatArray:
    """Least squares with columns brought to one size and one step of refinement; shape (m,). Raises `TooLarge`."""
    norms = _sizes(design)
    if np.isfinite(norms).all() and np.isfinite(target).all():
        scale = np.where(norms > 0.0, norms, 1.0)
        scaled = np.where(norms > 0.0, design / scale, 0.0)
        first = np.linalg.lstsq(scaled, target, rcond=_RANK)[0]
        with np.errstate(over="ignore"):
            found = (first + np.linalg.lstsq(scaled, target - scaled @ first, rcond=_RANK)[0]) / scale
        if np.isfinite(found).all():
            return np.asarray(found)
    raise TooLarge(
        "the baseline's terms are too large or too small to be fitted to this response:"
        " write the columns in other units, or mend the expression"
    )


def _sizes(design: FloatArray) -> FloatArray:
    """The norms of the columns, without overflow; 0 for a column of zeros, infinite where a number is."""
    peaks = np.abs(design).max(axis=0, initial=0.0)
    known = np.isfinite(peaks) & (peaks > np.finfo(float).tiny)
    norms = np.where(np.isfinite(peaks), 0.0, np.inf)
    with np.errstate(over="ignore"):
        # By the largest value first: squares of it may overflow, or vanish.
        norms[known] = peaks[known] * np.linalg.norm(design[:, known] / peaks[known], axis=0)
    return norms


def span_of(design: FloatArray) -> FloatArray:
    """An orthonormal basis of what the columns span, (n, rank)."""
    norms = np.linalg.norm(design, axis=0)
    design = design[:, norms > 0.0] / norms[norms > 0.0]
    if not design.shape[1]:
        return design
    left, sizes, _ = svd(design)
    return np.asarray(left[:, sizes > _RANK * sizes[0]])


def baseline_start(readings: Readings) -> FloatArray:
    """Values of the baseline's parameters where a fit of it alone ends, or as near as is known; shape (m,).

    `DataError` when start values are missing and none can be found, or a value is undefined at those given.
    """
    expression, given = readings.expression, readings.spec.start
    nonlinear = [name for name in expression.parameters if name not in expression.linear_in()]
    missing = [name for name in nonlinear if name not in given]
    _refuse_without_influence(readings)
    if not nonlinear:
        return _linear_part(readings, {})
    if missing:
        return _searched(readings, missing)
    asked = {name: given.get(name, 0.0) for name in expression.parameters}
    # Both as given and with the linear parameters solved for: either may lie in the better valley.
    starts = [] if any(name not in given for name in expression.parameters) else [_array(readings, asked)]
    solved = _linear_part(readings, {name: given[name] for name in nonlinear})
    starts += [solved] if np.isfinite(_chi2(readings, solved)) else []
    starts = [start for start in starts if np.isfinite(_chi2(readings, start))]
    if not starts:
        refuse_undefined(expression, readings.numbers, asked, readings.labels)
    fits = [fit for start in starts if (fit := _fitted(readings, start))]
    # Where all valleys are too narrow: first their floors alone, then from elsewhere.
    if not _converged(fits):
        fits += _separated(readings, {name: given[name] for name in nonlinear})
    if not _converged(fits):
        fits += _from_drawn(readings, nonlinear)
    if fits:
        return min(fits, key=lambda fit: fit.chi2).values
    return min(starts, key=lambda start: _chi2(readings, start))


def place(form: Scanned, held: FloatArray, residual: FloatArray, weight: FloatArray, near: float | None) -> float:
    """The scanned value that, with its linear parameters, leaves least of `residual` beside the columns `held`.

    From `near` to its neighbours on the grid, or over the whole grid; `weight` (n,) is one over the readings' sigma.
    """
    space = span_of(weight[:, None] * held)
    left = weight * residual
    left = left - space @ (space.T @ left)

    def misfit(value: float) -> float:
        basis = weight[:, None] * form.basis(form.full_choice(float(value)))
        basis = basis - space @ (space.T @ basis)
        # By the few columns' Gram matrix: this is asked a hundred times for every model.
        square, vectors = np.linalg.eigh(basis.T @ basis)
        seen = square > _RANK * square[-1]
        along = (basis @ vectors[:, seen]).T @ left
        return float(left @ left - np.sum(along**2 / square[seen]))

    grid = form.grid(POINTS_MAX)
    if isinstance(form, Step):
        start = near if near is not None else _best_step(form, grid, space, left, weight)
    else:
        start = near if near is not None else float(min(grid, key=misfit))
    low, high = _neighbours(grid, start)
    # The misfit of a step is constant between neighbouring values: all places are looked at.
    if isinstance(form, Step):
        places = form.places(low, high)
        return _best_step(form, places, space, left, weight) if places.size else start
    low, high = (edge if np.isfinite(edge) else start * factor for edge, factor in ((low, 0.8), (high, 1.25)))
    best = minimize_scalar(
        misfit,
        bounds=(min(low, high), max(low, high)),
        method="bounded",
        options={"xatol": _PLACED * abs(high - low)},
    )
    return float(best.x) if best.fun <= misfit(start) else start


def place_of_step(
    step: Step, held: FloatArray, residual: FloatArray, near: float, whiten: Callable[[FloatArray], FloatArray]
) -> float:
    """The same of a step from `near` to its neighbours on the grid, in noise that `whiten` makes independent."""
    places = step.places(*_neighbours(step.grid(POINTS_MAX), near))
    space = span_of(whiten(held))
    left = whiten(residual)
    left = left - space @ (space.T @ left)
    best = near
    # Of very many a few at once, then those between their best and its neighbours.
    while places.size:
        some = places[:: -(-places.size // _PLACES_AT_ONCE)]
        columns = whiten(step.scan([step.full_choice(float(at)) for at in some])[:, :, 0])
        along, square = left @ columns, np.sum(columns**2, axis=0)
        kept = square - np.sum((space.T @ columns) ** 2, axis=0)
        seen = kept > FREE * square
        best = float(some[int(np.argmax(np.where(seen, along**2 / np.where(seen, kept, 1.0), -1.0)))])
        low, high = _neighbours(some, best)
        places = places[(places > low) & (places < high)] if some.size < places.size else places[:0]
    return best


def _neighbours(grid: FloatArray, value: float) -> tuple[float, float]:
    """The points of a grid on either side of a value, infinite beyond its ends."""
    return float(grid[grid < value].max(initial=-np.inf)), float(grid[grid > value].min(initial=np.inf))


def _best_step(step: Step, places: FloatArray, space: FloatArray, left: FloatArray, weight: FloatArray) -> float:
    """Of rising places the one that explains most of what is `left` (n,), weighted, beside an orthonormal `space`
    (n, m)."""
    sums = StepSums(step.column.values, places)
    along = sums.along(weight[:, None] * np.column_stack([left, weight, space]))[:, :, 0]
    square = along[1]
    kept = square - np.sum(along[2:] ** 2, axis=0)
    seen = kept > FREE * square
    return float(places[int(np.argmax(np.where(seen, along[0] ** 2 / np.where(seen, kept, 1.0), -1.0)))])


def _array(readings: Readings, values: Mapping[str, float]) -> FloatArray:
    return np.array([values[name] for name in readings.expression.parameters])


def _chi2(readings: Readings, values: FloatArray) -> float:
    with np.errstate(all="ignore"):
        left = _residuals(readings, values)
        return float(left @ left)


def _residuals(readings: Readings, values: FloatArray) -> FloatArray:
    return np.asarray((readings.response.values - readings.baseline(values)[0]) / readings.sigma)


def _linear_part(readings: Readings, nonlinear: Mapping[str, float]) -> FloatArray:
    """All parameters, the linear ones solved for; `nonlinear` gives the others. NaN where that is undefined."""
    expression = readings.expression
    linear = [name for name in expression.parameters if name not in nonlinear]
    origin = {**dict.fromkeys(linear, 0.0), **nonlinear}
    value, slopes = readings.evaluated(origin)
    which = [expression.parameters.index(name) for name in linear]
    design, target = slopes[:, which], readings.response.values - value
    # NaN compares as false: what is undefined is no better than what is beyond all bounds.
    if not (np.abs(design) < _HUGE).all() or not (np.abs(target) < _HUGE).all():
        if not nonlinear:
            refuse_undefined(expression, readings.numbers, {}, readings.labels)
        return np.full(len(expression.parameters), np.nan)
    solved = solve(design / readings.sigma[:, None], target / readings.sigma) if linear else np.zeros(0)
    return _array(readings, {**origin, **dict(zip(linear, solved, strict=True))})


def _fitted(readings: Readings, start: FloatArray) -> FitResult | None:
    """The baseline fitted from `start`, as far as that gets; None when it goes nowhere."""
    expression = readings.expression

    def jacobian(values: FloatArray) -> FloatArray:
        return np.asarray(readings.baseline(values)[1] / readings.sigma[:, None])

    parameters = [Parameter(name, float(x)) for name, x in zip(expression.parameters, start, strict=True)]
    return descend(lambda values: _residuals(readings, values), jacobian, parameters)


def _converged(fits: Sequence[FitResult]) -> list[FitResult]:
    return [fit for fit in fits if fit.verdict == "converged"]


def _separated(readings: Readings, start: Mapping[str, float]) -> list[FitResult]:
    """The fit of all parameters from where one of the nonlinear ones ends, for each of whose values the linear ones
    are solved for; none when that goes nowhere.

    Golub and Pereyra, SIAM J. Numerical Analysis 10 (1973) 413; Jacobian by Kaufman, BIT 15 (1975) 49.
    """
    names = readings.expression.parameters
    linear = [place for place, name in enumerate(names) if name not in start]
    curved = [names.index(name) for name in start]

    def whole(values: FloatArray) -> FloatArray:
        return _linear_part(readings, dict(zip(start, map(float, values), strict=True)))

    def jacobian(values: FloatArray) -> FloatArray:
        slopes = readings.baseline(whole(values))[1] / readings.sigma[:, None]
        held = span_of(slopes[:, linear])
        return np.asarray(slopes[:, curved] - held @ (held.T @ slopes[:, curved]))

    parameters = [Parameter(name, value) for name, value in start.items()]
    try:
        floor = descend(lambda values: _residuals(readings, whole(values)), jacobian, parameters)
    except (ValueError, np.linalg.LinAlgError):  # undefined, or beyond all numbers, on the way
        return []
    fit = None if floor is None else _fitted(readings, whole(floor.values))
    return [] if fit is None else [fit]


def _searched(readings: Readings, missing: list[str]) -> FloatArray:
    """Start values drawn over many orders of magnitude, the best of them fitted."""
    fits = _from_drawn(readings, missing)
    if not fits:
        raise TableFlaw(
            f"[table] start: the baseline is not linear in {', '.join(missing)}, and no start values could be found"
            " for it; give them in start = { ... }",
            ("table", "start"),
        )
    return min(fits, key=lambda fit: fit.chi2).values


def _from_drawn(readings: Readings, missing: Sequence[str]) -> list[FitResult]:
    """Fits that converge from the best of drawn values of the `missing` parameters."""
    nonlinear = [name for name in readings.expression.parameters if name not in readings.expression.linear_in()]
    drawn = []
    # The same seed always: the same table has the same start.
    for values in _draws(readings, missing, np.random.default_rng(0)):
        start = _linear_part(readings, {name: values[name] for name in nonlinear})
        drawn.append((_chi2(readings, start), start))
    drawn = sorted((each for each in drawn if np.isfinite(each[0])), key=lambda each: each[0])
    return _converged([fit for _, start in drawn[:_TRIED] if (fit := _fitted(readings, start))])


def _draws(readings: Readings, missing: Sequence[str], rng: np.random.Generator) -> Iterator[dict[str, float]]:
    """Values drawn for the `missing` parameters by the sizes of the columns, the others as they were given."""
    known = {name: readings.spec.start[name] for name in readings.spec.start if name not in missing}
    sizes = [float(np.abs(readings.numbers[name]).max()) or 1.0 for name in readings.expression.columns]
    # A shift goes as a column, a rate as one over it, a curvature as one over its square.
    scales = np.array([1.0, *sizes, *(1.0 / size for size in sizes), *(1.0 / size**2 for size in sizes)])
    for _ in range(_DRAWS):
        # Three decades about each of the sizes.
        size = rng.choice(scales, len(missing)) * 10.0 ** rng.uniform(-1.5, 1.5, len(missing))
        sign = rng.choice([-1.0, 1.0], len(missing))
        yield {**known, **dict(zip(missing, size * sign, strict=True))}


def _refuse_without_influence(readings: Readings) -> None:
    """`DataError` for a parameter on which the response does not depend, whatever the others are.

    It is looked for at modest values, at the given start, and at values of the columns' sizes: a narrow peak is all
    but zero wherever it is not.
    """
    names = readings.expression.parameters
    idle = set(range(len(names)))
    for values in _places(readings):
        slopes = readings.baseline(values)[1]
        # A derivative that is undefined is an influence as well.
        idle -= set(np.flatnonzero((~np.isfinite(slopes) | (slopes != 0.0)).any(axis=0)).tolist())
        if not idle:
            return
    raise TableFlaw(
        f"[table] baseline: parameter {names[min(idle)]} drops out, the response does not depend on it; leave it out,"
        " or mend the expression",
        ("table", "baseline"),
    )


def _places(readings: Readings) -> Iterator[FloatArray]:
    """Values of all parameters at which their influence is looked for."""
    names, rng = readings.expression.parameters, np.random.default_rng(1)
    given = readings.spec.start
    for _ in range(_MODEST):
        modest = rng.uniform(0.1, 1.0, len(names))
        yield modest
        yield np.array([given.get(name, value) for name, value in zip(names, modest, strict=True)])
    for values in _draws(readings, [name for name in names if name not in given], rng):
        yield _array(readings, values)
