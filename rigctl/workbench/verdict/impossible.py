"""Effects that explain the data with a value that nature never has, such as the negative square of a frequency."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol, runtime_checkable

from scipy.special import ndtri

from rigctl.workbench.verdict.fitted_model import FittedModel


@runtime_checkable
class OfOneSign(Protocol):
    """A model that knows parameters which nature has with one sign only."""

    @property
    def never_negative(self) -> frozenset[str]:
        """Names of those."""


def impossible_parameters(fitted: FittedModel, effects: Collection[str], alpha: float) -> list[str]:
    """Parameters of some effects that are significantly negative where nature never has them so.

    Of several each is asked at its share of `alpha`.
    """
    if not isinstance(fitted.model, OfOneSign):
        return []
    owners = dict(zip(fitted.names, fitted.model.owners, strict=True))
    asked = [name for name in sorted(fitted.model.never_negative - fitted.held) if owners[name] in effects]
    below = ndtri(alpha / max(len(asked), 1))
    return [name for name in asked if fitted.result.value(name) < below * fitted.result.sigma(name)]
