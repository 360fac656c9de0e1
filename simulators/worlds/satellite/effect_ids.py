"""Which effects nature may have in orbit; a parameter with a mass's number in brackets is that mass's alone."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.worlds.effect_sizes import EffectForm, Scope

MASSES = ("1", "2")

EFFECTS: Mapping[str, EffectForm] = {
    "thermal-bias": EffectForm(Scope.MASS, ("lambda",)),
    "thermal-gain": EffectForm(Scope.MASS, ("kappa",)),
    "thermal-off-centring": EffectForm(Scope.RIG, ("beta",)),
    "wire-stiffness": EffectForm(Scope.MASS, ("kappa", "quality")),
    "cubic-stiffness": EffectForm(Scope.MASS, ("kappa3",)),
    "spring-noise": EffectForm(Scope.MASS, ("kappa", "quality")),
    "charge": EffectForm(Scope.MASS, ("rate", "step", "steps_per_orbit")),
    "magnetic": EffectForm(Scope.MASS, ("a1_cos", "a1_sin", "a2_cos", "a2_sin")),
    "glitches": EffectForm(Scope.RIG, ("amplitude", "per_orbit", "phased", "ratio")),
    "tracker-aberration": EffectForm(Scope.RIG, ("annual", "orbital")),
    "tracker-bias": EffectForm(Scope.RIG, ("x", "y", "z")),
    "orbit-dating": EffectForm(Scope.RIG, ("delay",)),
    "sensor-skew": EffectForm(Scope.RIG, ("delay",)),
    "thrust-quantisation": EffectForm(Scope.RIG, ("step", "minimum", "maximum")),
    "gravity-j2": EffectForm(Scope.RIG, ("j2", "inclination", "perigee")),
    "orbit-precession": EffectForm(Scope.RIG, ("rate", "eccentricity_rate")),
    "mass-drift": EffectForm(Scope.RIG, ("rate_x", "rate_y", "rate_z")),
    "cubic-electrode": EffectForm(Scope.MASS, ("k3",)),
    "cross-quadratic": EffectForm(Scope.MASS, ("kxy",)),
    "bias-drift": EffectForm(Scope.MASS, ("rate", "curvature")),
    "noise-level": EffectForm(Scope.RIG, ("change", "period")),
    "moved-mass-reaction": EffectForm(Scope.RIG, ("factor",)),
}

NEVER_ZERO = {
    ("wire-stiffness", "quality"),
    ("spring-noise", "quality"),
    ("noise-level", "period"),
}
"""What an effect has no meaning without."""
