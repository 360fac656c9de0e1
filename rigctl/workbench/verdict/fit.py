"""A model fitted to a recording: parameters, and its error on runs it used and on runs it did not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigctl.core.threads import one_thread
from rigctl.workbench.findings import Estimate, ModelFit, Rms
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.account import Account, account_of
from rigctl.workbench.verdict.adequacy import adequacy
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.likelihood import Optimum, maximum_likelihood
from rigctl.workbench.verdict.noise_entries import noise_entries
from rigctl.workbench.verdict.offsets import without_offsets
from rigctl.workbench.verdict.stated_sigma import stated_sigma_beside_all


@one_thread
def fit(study: Study, terms: Sequence[Term], account: Account | None = None) -> ModelFit:
    """Fit baseline and terms to all valid runs; `ProcedureError` when the runs do not determine them.

    `account` is the noise of the data, by default as these terms alone tell it.
    """
    account = account or account_of(study, [terms])
    return fitted(account.attempt(study, terms), account)


@one_thread
def parameters_of(study: Study, terms: Sequence[Term]) -> dict[str, Estimate]:
    """Parameters by name, where nothing else is asked and no noise comes from the scatter."""
    return Attempt(study, terms).estimates()


def fitted(
    attempt: Attempt,
    account: Account,
    optimum: Optimum | None = None,
    warnings: Sequence[str] = (),
    p_value: float | None = None,
) -> ModelFit:
    """What a fitted attempt amounts to; `optimum` is where its likelihood is largest and `p_value` its adequacy, by
    default looked for and asked."""
    result = attempt.result
    most_likely = optimum or maximum_likelihood(attempt, attempt.estimator)
    return ModelFit(
        terms=attempt.terms,
        parameters=attempt.estimates(),
        chi2=result.chi2,
        dof=result.dof,
        p_value=adequacy(attempt, account) if p_value is None else p_value,
        error_fit=attempt.error(),
        error_held_out=attempt.held_out_error,
        residuals=attempt.whitened(),
        result=_result(attempt),
        rms=rms_by_channel(attempt),
        minus_2_log_l=most_likely.minus_2_log_l,
        held_out_log_score=attempt.held_out.log_score(attempt.noise.log_determinant()),
        noise=noise_entries(attempt),
        stated_sigma=stated_sigma_beside_all(attempt, account),
        held=tuple(sorted(attempt.held)),
        warnings=tuple(warnings),
        excluded=attempt.model.observations.excluded,
    )


def _result(attempt: Attempt) -> dict[str, Any]:
    """What the experiment is for; of parameters that are held no uncertainty is known, as among the parameters."""
    found = attempt.study.result(attempt.model, attempt.result.values, attempt.uncertainty.covariance)
    return {name: {**each, "sigma": np.nan} if name in attempt.held else each for name, each in found.items()}


def rms_by_channel(attempt: Attempt) -> dict[str, Rms]:
    """What a fit leaves in each channel, in its unit."""
    given = attempt.model.observations
    # No version takes out what batches share: it would hide what one does.
    left = without_offsets(given, attempt.unexplained())
    channel_of = np.array([series.channel for series in given.series])[given.series_of]
    units = {series.channel: series.unit for series in given.series}
    return {
        channel: Rms(float(np.sqrt(np.mean(left[channel_of == channel] ** 2))), unit)
        for channel, unit in units.items()
        if np.any(channel_of == channel)
    }
