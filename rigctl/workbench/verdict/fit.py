"""A model fitted to a recording: parameters, and its error on runs it used and on runs it did not."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.workbench.findings import ModelFit
from rigctl.workbench.study import Study, Term
from rigctl.workbench.threads import one_thread
from rigctl.workbench.verdict.attempt import Attempt


@one_thread
def fit(study: Study, terms: Sequence[Term]) -> ModelFit:
    """Fit baseline and terms to all valid runs; `ProcedureError` when the runs do not determine them."""
    return fitted(Attempt(study, terms))


def fitted(attempt: Attempt) -> ModelFit:
    """What a fitted attempt amounts to."""
    result = attempt.result
    return ModelFit(
        terms=attempt.terms,
        parameters=attempt.estimates(),
        chi2=result.chi2,
        dof=result.dof,
        p_value=attempt.chi2_p_value(),
        error_fit=attempt.error(),
        error_held_out=attempt.held_out.error(),
        residuals=attempt.whitened(),
        result=attempt.study.result(attempt.model, result.values, result.covariance),
    )
