"""The model behind a result: its terms, whether it is adequate, and what the data could not tell apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigctl.core.errors import UNFIT
from rigctl.report.verdicts import (
    comparison_sentence,
    inseparable_sentences,
    is_inadequate,
    model_name,
    noise_sentence,
    stated_sentence,
    verdict_sentence,
)
from rigctl.workbench.workbench import ALPHA, Workbench


def model_in_force(bench: Workbench, tell: Callable[[str], None]) -> dict[str, Any]:
    """Terms and plug-ins, adequacy, inseparable effects: from the diagnosis that is kept, or worked out anew."""
    version = bench.current
    said: dict[str, Any] = {
        "version": version.version,
        "name": model_name(version.effects),
        "terms": [term.as_json() for term in version.terms],
        "plugins": {effect: vars(plugin) for effect, plugin in version.plugins.items()},
    }
    if not bench.store.runs(valid_only=True):
        nothing = {"adequacy": "", "verdict": "", "inseparable": [], "warnings": [], "inadequate": ""}
        return {**said, **nothing, "noise": "", "stated_sigma": ""}
    fit = bench.model_fit()
    verdict, inseparable, lacks = _diagnosed(bench, tell)
    described = comparison_sentence(fit)
    inadequate = described if is_inadequate(fit) else lacks
    return {
        **said,
        "adequacy": described,
        "verdict": verdict,
        "inseparable": inseparable,
        "warnings": list(fit.get("warnings") or ()),
        "inadequate": inadequate,
        "noise": noise_sentence(fit),
        "stated_sigma": stated_sentence(fit),
    }


def _diagnosed(bench: Workbench, tell: Callable[[str], None]) -> tuple[str, list[str], str]:
    """The verdict, what cannot be told apart, and the verdict again where it speaks against the model."""
    try:
        diagnosis = bench.diagnosis(ALPHA, tell)
    except UNFIT as error:
        return f"The model could not be diagnosed: {error}", [], ""
    verdict = verdict_sentence(diagnosis)
    lacks = "" if diagnosis["verdict"] in ("adequate", "ambiguous") and not diagnosis["suggested"] else verdict
    return verdict, inseparable_sentences(diagnosis["inseparable"]), lacks
