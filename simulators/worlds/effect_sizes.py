"""Which effects nature may have, and how their sizes are written; `EFFECTS` are those on the sensing-axis bench."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum

EffectTable = Mapping[str, Mapping[str, float]]
"""Effect id -> parameter, plain or with a scope as in `kT[X]` -> size in SI units."""


class Scope(Enum):
    """What a parameter may be given for, one by one; the value is the form of its key."""

    RIG = ""
    AXIS = "[AXIS]"
    AXIS_CONFIGURATION = "[AXIS,CONFIGURATION]"
    HEAD = "[HEAD]"
    CHANNEL = "[CHANNEL]"
    MASS = "[MASS]"


@dataclass(frozen=True)
class EffectForm:
    """The parameters of one effect and what they may be given for."""

    scope: Scope
    parameters: tuple[str, ...]


EFFECTS: Mapping[str, EffectForm] = {
    "roll-gravity": EffectForm(Scope.RIG, ("rho1",)),
    "pitch-gravity": EffectForm(Scope.RIG, ("pi1",)),
    "resonance": EffectForm(Scope.AXIS_CONFIGURATION, ("inv_w0_squared", "damping")),
    "bench-recoil": EffectForm(Scope.RIG, ("c",)),
    "quadratic": EffectForm(Scope.AXIS, ("K2",)),
    "time-skew": EffectForm(Scope.RIG, ("tau",)),
    "thermal-bias": EffectForm(Scope.AXIS, ("bT",)),
    "thermal-gain": EffectForm(Scope.AXIS, ("kT",)),
    "cable-hysteresis": EffectForm(Scope.RIG, ("h",)),
    "encoder-eccentricity": EffectForm(Scope.RIG, ("e1", "e2")),
    "axis-tilt": EffectForm(Scope.RIG, ("eps_cos", "eps_sin")),
    "yaw": EffectForm(Scope.RIG, ("psi1",)),
    "yaw-lever": EffectForm(Scope.RIG, ("lever_cos", "lever_sin")),
    "laser-cosine": EffectForm(Scope.HEAD, ("dt",)),
    "laser-nonlinearity": EffectForm(Scope.HEAD, ("q",)),
    "laser-crosstalk": EffectForm(Scope.HEAD, ("chi",)),
    "bias-drift": EffectForm(Scope.AXIS, ("rate",)),
    "gain-drift": EffectForm(Scope.AXIS, ("rate",)),
    "null-drift": EffectForm(Scope.AXIS, ("rate",)),
    "mains-pickup": EffectForm(Scope.RIG, ("amplitude", "frequency")),
}


def check(effects: EffectTable, forms: Mapping[str, EffectForm], members: Mapping[Scope, Collection[str]]) -> None:
    """Raise ValueError, naming what is known, for an effect, a parameter or a scope that is not."""
    for effect, sizes in effects.items():
        form = forms.get(effect)
        if form is None:
            raise ValueError(f"unknown effect '{effect}'; known: {', '.join(forms)}")
        for key in sizes:
            parsed = re.fullmatch(r"(\w+)(?:\[([^\]]+)\])?", key)
            if parsed is None or parsed[1] not in form.parameters:
                raise ValueError(f"effect '{effect}' has no parameter '{key}'; it has: {', '.join(form.parameters)}")
            if parsed[2] is not None and parsed[2].replace(" ", "") not in members.get(form.scope, ()):
                allowed = " or ".join(f"{parsed[1]}[{name}]" for name in sorted(members.get(form.scope, ())))
                raise ValueError(
                    f"effect '{effect}': '{key}' is for nothing here; write {parsed[1]}"
                    + (f" or {allowed}" if allowed else "")
                )


def size(effects: EffectTable, effect: str, parameter: str, member: str = "") -> float:
    """The size for one axis, "axis,configuration" or head; without its own the plain one; 0 when absent."""
    sizes = effects.get(effect, {})
    return sizes.get(f"{parameter}[{member}]", sizes.get(parameter, 0.0))
