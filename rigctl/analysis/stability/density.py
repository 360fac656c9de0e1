"""The one-sided spectral density of a record, and what it is made of: white, flicker, random walk, and lines.

Lines are fitted as sines and taken out. Of the rest, bins of Welch's method are joined to cells; a cell's density is
a chi-squared variable, and the sum of power laws of the largest likelihood is fitted to them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from rigctl.analysis.stability.segments import FIRST_BIN, Bins, parts, welch
from rigctl.analysis.stability.steady_lines import LOBE, SteadyLine, take_out_lines
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import ConfigError, DataError

EVERYWHERE = (0.0, np.inf)

SHORTEST = 256
"""Samples below which no density is given."""

EXPONENTS = (0, -1, -2)
"""White, flicker, random walk: the density of the samples is the sum of h f^exponent."""

_CELL_GROWTH, _CELL_BINS = 1.15, 4
_IMPROBABLE = 1e-3
_ONE_IN_TWENTY = 1.645
_ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a density in unit^2/Hz: centre, mean, degrees of freedom, and the mean of each power law."""

    frequency_hz: FloatArray
    psd: FloatArray
    dof: FloatArray
    shapes: FloatArray


@dataclass(frozen=True)
class PowerLaw:
    """One term h f^exponent: h at 1 Hz in unit^2/Hz with its standard uncertainty; `upper` is exceeded once in 20."""

    exponent: int
    value: float
    sigma: float
    upper: float

    @property
    def resolved(self) -> bool:
        """Whether the term stands out of its uncertainty."""
        return self.value > 2.0 * self.sigma


@dataclass(frozen=True, eq=False)
class Density:
    """A record's density with its fit; where the fit does not describe it, uncertainties are widened by `scale`."""

    cells: Cells
    band_hz: tuple[float, float]
    lines: tuple[SteadyLine, ...]
    terms: tuple[PowerLaw, ...]
    chi2: float
    dof: int
    p_value: float
    scale: float
    rest: FloatArray
    """The samples with the lines taken out."""

    def model(self, frequency_hz: FloatArray) -> FloatArray:
        """The fitted density in unit^2/Hz, lines left out."""
        return np.asarray(sum(term.value * frequency_hz**term.exponent for term in self.terms))


def density(samples: FloatArray, rate_hz: float, band_hz: tuple[float, float] = EVERYWHERE) -> Density:
    """The density of evenly spaced samples without gaps, with its fit between the frequencies of `band_hz`.

    `DataError` for fewer than `SHORTEST` samples or none that vary, `ConfigError` for a band with too little in it.
    """
    if samples.size < SHORTEST:
        raise DataError(f"{samples.size} samples are too few for a spectral density: record at least {SHORTEST}")
    if not np.any(samples != samples[0]):
        raise DataError("all samples are the same: there is no noise to describe")
    rest, lines = take_out_lines(samples, rate_hz)
    # The whole record up to where the shorter segments begin.
    divided = parts(samples.size)
    whole, short = welch(rest, rate_hz, samples.size), welch(rest, rate_hz, samples.size // divided)
    nyquist = short.frequency_hz.size - 1
    cells = [
        *_cells(whole, _without(whole, lines, short.width_hz), divided * FIRST_BIN),
        *_cells(short, _without(short, lines, short.width_hz), nyquist),
    ]
    if len(cells) <= len(EXPONENTS):
        raise DataError("lines leave too little of the spectrum to describe noise: record longer")
    frequency_hz, psd, dof, *shapes = (np.array(each) for each in zip(*cells, strict=True))
    everything = Cells(frequency_hz, psd, dof, np.stack(shapes))
    within = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    if np.count_nonzero(within) <= len(EXPONENTS):
        raise ConfigError(
            f"too little of the density lies between {band_hz[0]:g} and {band_hz[1]:g} Hz; it goes from "
            f"{frequency_hz[0]:.3g} to {frequency_hz[-1]:.3g} Hz: fit a wider band"
        )
    fit = _fitted(Cells(frequency_hz[within], psd[within], dof[within], everything.shapes[:, within]))
    return Density(everything, band_hz, tuple(lines), *fit, rest)


def _without(bins: Bins, lines: list[SteadyLine], width_hz: float) -> BoolArray:
    """The bins to use: those that no line reached, which may not have been as steady as a sine."""
    free = np.ones(bins.frequency_hz.size, dtype=bool)
    for line in lines:
        free &= np.abs(bins.frequency_hz - line.frequency_hz) > (LOBE + 0.5) * width_hz
    return free


def _cells(bins: Bins, free: BoolArray, last: int) -> list[tuple[float, ...]]:
    """Each cell's frequency, density, degrees of freedom and mean of every power law over its bins."""
    found: list[tuple[float, ...]] = []
    start = FIRST_BIN
    while start < last:
        stop = min(max(start + _CELL_BINS, round(start * _CELL_GROWTH)), last)
        # What is left of the band is no cell of its own.
        stop = last if last - stop < _CELL_BINS else stop
        use = start + np.flatnonzero(free[start:stop])
        if use.size:
            f = bins.frequency_hz[use]
            shapes = (float(np.mean(f**exponent)) for exponent in EXPONENTS)
            found.append((float(f.mean()), float(bins.psd[use].mean()), bins.dof(use.size), *shapes))
        start = stop
    return found


def _fitted(cells: Cells) -> tuple[tuple[PowerLaw, ...], float, int, float, float]:
    """Fisher scoring of the gamma likelihood, no term below zero: weighted least squares until weights stay."""
    # In units that all terms share, whatever the samples' own.
    unit = np.array([float(np.median(cells.psd / shape)) for shape in cells.shapes])
    design = (cells.shapes * unit[:, None]).T
    model = cells.psd.copy()
    for _ in range(_ITERATIONS):
        weight = np.sqrt(cells.dof / 2.0) / model
        estimate, _ = optimize.nnls(design * weight[:, None], cells.psd * weight)
        before, model = model, np.maximum(design @ estimate, 1e-12 * cells.psd.min())
        if np.all(np.abs(model / before - 1.0) < 1e-9):
            break
    ratio = cells.psd / model
    chi2 = float(cells.dof @ (ratio - 1.0 - np.log(ratio)))
    positive = estimate > 0.0
    dof = len(ratio) - int(positive.sum())
    p_value = float(stats.chi2.sf(chi2, dof))
    scale = float(np.sqrt(chi2 / dof)) if p_value < _IMPROBABLE else 1.0
    sigma = scale * _sigmas(design, model, cells.dof, positive)
    terms = tuple(
        PowerLaw(exponent, float(h * u), float(s * u), float((h + _ONE_IN_TWENTY * s) * u))
        for exponent, h, s, u in zip(EXPONENTS, estimate, sigma, unit, strict=True)
    )
    return terms, chi2, dof, p_value, scale


def _sigmas(design: FloatArray, model: FloatArray, dof: FloatArray, positive: BoolArray) -> FloatArray:
    """Standard uncertainties: of a term at zero those it would have beside all others."""
    weighted = design * (np.sqrt(dof / 2.0) / model)[:, None]
    information = weighted.T @ weighted
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    # A term that is not there takes nothing from what is known of the others.
    kept = np.flatnonzero(positive)
    sigma[kept] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(kept, kept)])))
    return np.asarray(sigma)
