"""Residuals of the current model: their size per channel, outliers, and trends along the conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.threads import one_thread
from rigctl.workbench.findings import ChannelFit, Comparison, Outlier, Trend
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.account import LEVEL, Account, account_of
from rigctl.workbench.verdict.adequacy import adequacy
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.covariates import distinct
from rigctl.workbench.verdict.far_reading import far_reading
from rigctl.workbench.verdict.lack_of_fit import lack_of_fit
from rigctl.workbench.verdict.noise_entries import noise_entries
from rigctl.workbench.verdict.offsets import own_sigma, without_offsets
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.verdict.stated_sigma import stated_sigma_beside_all
from rigctl.workbench.verdict.uneven_scatter import uneven_scatter

WORST = 10
# Enough for a slope, a bend or a step, and few enough to keep the test's power.
BINS = 5
TRENDS, _MEASURED_TRENDS = 20, 30
_FEW = 3
_OF_A_LINE = ("channel", "frequency_hz", "amplitude", "sigma", "unit", "p_value")


@one_thread
def compare(study: Study, terms: Sequence[Term], version: int = 1) -> Comparison:
    """Residuals of the fitted model against the noise, per series, run and covariate."""
    account = account_of(study, [terms])
    return compared(account.attempt(study, terms), account, version)


def compared(attempt: Attempt, account: Account, version: int, kept: Mapping[str, Any] | None = None) -> Comparison:
    """What a fitted attempt leaves; of a comparison that is `kept`, `as_json`, what takes long is not asked again."""
    given, left = attempt.model.observations, attempt.whitened()
    channels = []
    # As a ladder has it: beside offsets that data share, what a version lacks would not show.
    plain, raw = own_sigma(given, attempt.noise.total_sigma()), without_offsets(given, attempt.unexplained())
    for number, series in enumerate(given.series):
        rows = given.series_of == number
        if rows.any():
            channels.append(
                ChannelFit(
                    series.channel,
                    series.component,
                    _rms(raw[rows]),
                    _rms(plain[rows]),
                    series.unit,
                    int(rows.sum()),
                    float(left[rows] @ left[rows]),
                )
            )
    worst = np.argsort(-np.abs(left))[:WORST]
    return Comparison(
        version=version,
        terms=attempt.terms,
        chi2=attempt.result.chi2,
        dof=attempt.result.dof,
        p_value=adequacy(attempt, account) if kept is None else kept["p_value"],
        channels=tuple(channels),
        worst=tuple(_outlier(attempt, int(where), float(left[where])) for where in worst),
        trends=_trends(attempt) if kept is None else tuple(Trend(**each) for each in kept["trends"]),
        lines=tuple(
            {key: getattr(line, key) for key in _OF_A_LINE}
            for line in attempt.study.lines(attempt.model)
            if np.isfinite(line.frequency_hz)
        ),
        noise=noise_entries(attempt),
        lack_of_fit=lack_of_fit(attempt),
        # Of the model with all that was found: what a version lacks would look like scatter.
        scatter=uneven_scatter(account.richest, LEVEL),
        stated_sigma=stated_sigma_beside_all(attempt, account),
        far_reading=far_reading(account.richest),
        observations=given,
        residuals=left,
    )


def _outlier(attempt: Attempt, where: int, sigma: float) -> Outlier:
    given = attempt.model.observations
    series = given.series[given.series_of[where]]
    return Outlier(given.run_ids[given.run_of[where]], series.channel, series.component, sigma)


def _trends(attempt: Attempt) -> tuple[Trend, ...]:
    """F tests of every series along every distinct covariate, the most significant first."""
    given, projector, sigma = attempt.model.observations, attempt.projector, attempt.noise.total_sigma()
    covariates = distinct(given.covariates)

    def whitened(rows: IntArray, steps: FloatArray) -> FloatArray:
        whole = np.zeros((len(given.value), steps.shape[1]))
        # In units of each datum's noise, so that steps weigh alike once they are whitened.
        whole[rows] = steps * sigma[rows, None]
        return attempt.whitened_columns(whole)

    tried: list[tuple[float, int, str, IntArray, FloatArray]] = []
    for number in range(len(given.series)):
        rows = np.flatnonzero(given.series_of == number)
        asked = [
            (name, steps)
            for name in covariates
            if (steps := _steps(given.of_runs(name)[rows], max(BINS, len(given.levels.get(name, ()))))) is not None
        ]
        if asked:
            white = whitened(rows, np.hstack([steps for _, steps in asked]))
            found = projector.statistics(white, [steps.shape[1] for _, steps in asked])
            for (name, steps), (statistic, dimension) in zip(asked, found, strict=True):
                if dimension:
                    tried.append((float(p_of(statistic, dimension, np.inf)), number, name, rows, steps))
    trends: list[Trend] = []
    # Whatever degrees of freedom the noise has, the strongest are among these.
    strongest = sorted(tried, key=lambda each: each[0])[:_MEASURED_TRENDS]
    for number in dict.fromkeys(each[1] for each in strongest):
        own, series = [each for each in strongest if each[1] == number], given.series[number]
        rows, ends = own[0][3], np.cumsum([steps.shape[1] for *_, steps in own])[:-1]
        white = whitened(rows, np.hstack([steps for *_, steps in own]))
        for (_, _, name, _, _), score in zip(own, projector.scores(np.split(white, ends, axis=1)), strict=True):
            # Bonferroni: strict where covariates go together, but this is a table to look at and no verdict.
            corrected, rms = min(len(tried) * score.p_value, 1.0), float(np.sqrt(score.statistic / len(rows)))
            trends.append(Trend(series.channel, series.component, name, score.p_value, corrected, rms))
    return tuple(sorted(trends, key=lambda trend: trend.p_value)[:TRENDS])


def _steps(values: FloatArray, bins: int) -> FloatArray | None:
    """Indicators of a covariate's values but one, or of so many bins of equal count, less their mean; None when
    constant."""
    if not len(values) or not np.isfinite(values).all() or np.ptp(values) <= 0.0:
        return None
    edges = np.unique(values)
    if len(edges) > bins:
        edges = np.quantile(values, np.linspace(0, 1, bins + 1))
    # The largest value belongs to the last bin.
    where: IntArray = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 1)
    indicator = np.equal.outer(where, np.unique(where)).astype(np.float64)
    indicator = indicator[:, indicator.sum(axis=0) >= 1]
    if indicator.shape[1] < 2 or len(values) < _FEW + indicator.shape[1]:
        return None
    # Of all together nothing is left: one of them says nothing more.
    return np.asarray(indicator - indicator.mean(axis=0))[:, 1:]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
