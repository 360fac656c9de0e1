"""The commands of each case of `tests.golden`: every experiment and procedure, recordings, catalogue, help."""

from __future__ import annotations

FILES = {
    "platform.toml": """
experiment = "rotating-platform"
title = "Every pattern, briefly"
rig = "{tree}/campaigns/bias-rejection-rig.toml"

[procedure]
name = "bias-rejection"
rejects = "linear"
runs = [
    {{ pattern = "flip", duration_s = 60.0 }},
    {{ pattern = "scan", step_deg = 30.0, dwell_s = 60.0 }},
    {{ pattern = "noise", duration_s = 3600.0 }},
    {{ pattern = "c", modulation_period_s = 60.0, periods = 20, v_z_v = [0.0, 1.0] }},
    {{ pattern = "c_tm", modulation_period_s = 60.0, periods = 20, v_y_v = 1.0 }},
    {{ pattern = "b", modulation_period_s = 60.0, periods = 20, external = "triangle", v_z_v = 1.0, \
      external_period_s = 600.0 }},
    {{ pattern = "a", modulation_period_s = 60.0, periods = 20, external = "sine", v_z_v = 1.0, \
      external_period_s = 600.0, rejects = "constant" }},
]
""",
    "orbit.toml": """
experiment = "inflight-calibration"
title = "Some sessions"
rig = "{tree}/campaigns/microscope-rig.toml"

[procedure]
name = "calibration"
sessions = ["dx+dz", "dy", "ac13", "ad11", "k2c_1"]
""",
    "draws.toml": """
experiment = "inflight-calibration"
title = "Two draws, the second kept"
rig = "{tree}/campaigns/microscope-rig.toml"

[procedure]
name = "monte-carlo"
draws = 2
workers = 1
kept_draw = 1
""",
}
"""Campaigns of our own, where the shipped ones take long."""

_TOLD = ("result", "compare", "fit", "diagnose", "model show", "model history")
_JSON = tuple(f"{command} {{store}} --json" for command in ("status", *_TOLD, "next"))
_WORDS = tuple(f"{command} {{store}}" for command in ("status", *_TOLD))
_REPORT = ("report {store} --out {work}/report.html --figures {work}/figures --json",)
_AGAIN = ("diagnose {store}", "report {store} --out {work}/added.html --figures {work}/added --json")
_EXPORT = ("export {store} {work}/bundle --json",)
_WHOLE = (*_JSON, *_REPORT, *_EXPORT)
_BRIEF = ("result {store} --json", "diagnose {store} --json", "model history {store} --json", *_REPORT, *_EXPORT)


def _run(campaign: str) -> str:
    return f"run {campaign} --store {{store}} --yes --json"


def _read(example: str) -> str:
    return f"import examples/{example} --store {{store}} --json"


def _added(*effects: str, options: str = "") -> tuple[str, ...]:
    """A round of the workbench with these effects in the model."""
    told = (f"model add {{store}} {' '.join(effects)}", "fit {store}", "diagnose {store}", "model history {store}")
    return tuple(f"{command} {options} --json" for command in told)


_RIGS = (
    "all-instruments.rig",
    "bias-rejection-rig",
    "hidden-effect-rig",
    "isa-rig",
    "microscope-rig",
    "one-axis.rig",
)
_CAMPAIGNS = (
    "angle-scan", "bias-rejection", "bias-rejection-days", "hidden-effect", "hidden-effect-near", "isa-flight-model",
    "microscope", "microscope-table2", "one-axis", "quick-check",
)  # fmt: skip
_COMMANDS = (
    "run", "resume", "pause", "abort", "answer", "status", "mark", "result", "report", "compare", "diagnose", "fit",
    "model", "model show", "model history", "model add", "model remove", "next", "investigate", "effects", "import",
    "export", "simulate", "check", "stop", "home", "move", "console",
)  # fmt: skip
_PLUGIN = "--plugin examples/unknown-effect/my_effect.py"
_SHOWN = ("one-axis", "bias-rejection", "microscope")
_DRAWN = ("roll-gravity", "resonance", "off-centre", "recovery", "gravity-j2")
_TABLES = ("enso", "filip", "gauss", "hahn", "lanczos", "longley", "norris", "thurber")

CASES: dict[str, tuple[str, ...]] = {
    "help": ("--help", *(f"{command} --help" for command in _COMMANDS)),
    "dry-runs": (
        *(f"run campaigns/{campaign}.toml --dry-run --yes --json" for campaign in _CAMPAIGNS),
        *(f"run campaigns/{campaign}.toml --dry-run --yes" for campaign in _SHOWN),
    ),
    "rigs": tuple(f"check campaigns/{rig}.toml --json" for rig in _RIGS),
    "effects": (
        "effects", "effects --json", "effects rotating-platform:gain-drift",
        "effects sensing-axis:thermal-bias --json",
        *(f"effects {effect} --figure {{work}}/{effect}.svg" for effect in _DRAWN),
    ),
    "one-axis": (_run("campaigns/one-axis.toml"), *_WHOLE, *_WORDS, "next {store}"),
    "quick-check": (_run("campaigns/quick-check.toml"), *_WHOLE, "result {store}"),
    "angle-scan": (_run("campaigns/angle-scan.toml"), *_WHOLE),
    "hidden-effect": (
        _run("campaigns/hidden-effect.toml"), *_WHOLE, *_added("quadratic", "cable-hysteresis"), *_AGAIN,
    ),
    "hidden-effect-near": (
        _run("campaigns/hidden-effect-near.toml"), "mark {store} 3 trial --invalid --json", *_JSON, *_EXPORT,
        "import {work}/bundle --store {work}/again.rig.sqlite --json", "result {work}/again.rig.sqlite --json",
        "compare {store} --with {work}/again.rig.sqlite --json",
        "next {store} --write {work}/next.toml --json", "run {work}/next.toml --store {store} --yes --json",
    ),
    "investigate": ("investigate campaigns/hidden-effect.toml --store {store} --yes --json", *_WORDS),
    "platform": (_run("{work}/platform.toml"), *_WHOLE, *_WORDS),
    "orbit": (_run("{work}/orbit.toml"), *_WHOLE, *_WORDS),
    "draws": (_run("{work}/draws.toml"), "result {store} --json", "result {store}", *_REPORT),
    "table-pontius": (_read("pontius"), *_WHOLE, *_WORDS, *_added("'power2[load_lb]'"), *_AGAIN),
    **{f"table-{name}": (_read(name), "fit {store} --json", "diagnose {store} --json") for name in _TABLES},
    "unknown-effect": (
        _read("unknown-effect"), *_WHOLE,
        *_added("resonance", "roll-gravity", "pressure-gain", options=_PLUGIN),
    ),
    "isa-flight-model": (
        _run("campaigns/isa-flight-model.toml"), *_BRIEF, "compare {store} --json", "next {store} --json",
    ),
    "bias-rejection": (_run("campaigns/bias-rejection.toml"), *_BRIEF),
    "microscope": (_run("campaigns/microscope.toml"), *_BRIEF),
}  # fmt: skip
