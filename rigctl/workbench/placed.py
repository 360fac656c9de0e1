"""Effects in a model: their parameters by name and channel, and where a fit begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.workbench.study import Term

# Relative: values of scans are a factor of 1.3 to 2 apart, and the truth lies about so near to the best of them.
_SCAN_SPREAD = 0.3


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect: its name in the model, its `argument`, channel ("" for all), unit, start."""

    name: str
    argument: str
    channel: str
    unit: str
    start: float
    typical: float
    scanned: bool = False


@dataclass(frozen=True)
class Placed:
    """An effect in a model, with the values of its choice."""

    effect: Effect
    term: Term
    parameters: tuple[EffectParameter, ...]


def fit_parameter(each: EffectParameter) -> Parameter:
    """One to be fitted; what was scanned stays near the value of its scan, where the others are not far."""
    prior = Prior(each.start, _SCAN_SPREAD * each.start) if each.scanned else None
    return Parameter(each.name, each.start, prior=prior)


def placed(effect: Effect, term: Term, channels: Sequence[str], before: Sequence[Placed]) -> Placed:
    """An effect as part of a model with these channels; names that those `before` it have get its id before them."""
    taken = [parameter.argument for each in before for parameter in each.parameters]
    parameters: list[EffectParameter] = []
    for name, unit in effect.parameters.items():
        typical = float(effect.typical[name])
        shown = f"{effect.id}.{name}" if name in taken else name
        if name in effect.scans:
            start = float(term.choice.get(name, typical))
            parameters.append(EffectParameter(shown, name, "", unit, start, start, scanned=True))
        elif effect.scope == "channel":
            # With its amplitude at zero a time constant has no derivative, and the fit would be singular at once.
            start = 0.1 * typical if effect.scans else 0.0
            parameters += [EffectParameter(f"{shown}[{c}]", name, c, unit, start, typical) for c in channels]
        else:
            parameters.append(EffectParameter(shown, name, "", unit, 0.0, typical))
    return Placed(effect, term, tuple(parameters))


def sizes_for(channel: str, each: Placed, values: FloatArray) -> dict[str, float]:
    """The arguments of an effect in a channel, from the values of its parameters."""
    arguments: dict[str, float] = {}
    for parameter, value in zip(each.parameters, values.tolist(), strict=True):
        # A trial step of the fit may go there, where a time or a frequency has no meaning.
        if parameter.scanned and not value > 0.0:
            value = parameter.start
        if parameter.channel in ("", channel):
            arguments[parameter.argument] = value
    return arguments
