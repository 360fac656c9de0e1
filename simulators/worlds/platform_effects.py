"""Which effects nature may have on the rotating platform; `y` and `z` are the channels of chains B and A."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.worlds.effect_sizes import EffectForm, Scope

EFFECTS: Mapping[str, EffectForm] = {
    "theta-locked-bias": EffectForm(Scope.CHANNEL, ("e1", "e2")),
    "off-centre": EffectForm(Scope.CHANNEL, ("r_cos", "r_sin")),
    "recovery": EffectForm(Scope.CHANNEL, ("e", "t_r")),
    "recovery-signed": EffectForm(Scope.CHANNEL, ("e", "t_r")),
    "thermal-bias": EffectForm(Scope.CHANNEL, ("b1", "b2", "b3")),
    "gain-drift": EffectForm(Scope.CHANNEL, ("k0", "k1")),
    "line": EffectForm(Scope.CHANNEL, ("amplitude", "frequency")),
    "platform-repeatability": EffectForm(Scope.RIG, ("stop", "backlash")),
    "cross-axis": EffectForm(Scope.CHANNEL, ("k",)),
    "quadratic": EffectForm(Scope.CHANNEL, ("K2",)),
    "gain-asymmetry": EffectForm(Scope.CHANNEL, ("e",)),
    "clock-skew": EffectForm(Scope.CHANNEL, ("delay", "drift", "r_cos", "r_sin")),
    "filter-ringing": EffectForm(Scope.CHANNEL, ("cutoff", "r_cos", "r_sin")),
    "pendulum-reaction": EffectForm(Scope.CHANNEL, ("d",)),
    "tide": EffectForm(Scope.CHANNEL, ("amplitude", "period")),
}

CHANNELS = ("y", "z")
NEVER_ZERO = {
    ("recovery", "t_r"),
    ("recovery-signed", "t_r"),
    ("line", "frequency"),
    ("tide", "period"),
    ("filter-ringing", "cutoff"),
}
"""Times and frequencies without which the effect has no meaning."""
