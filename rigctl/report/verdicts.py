"""What was found, in sentences: the same in the terminal and in the report. Findings come as their JSON."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.report.quantities import counted, estimate, number, p_value, quantity, share, with_unit
from rigctl.workbench.findings import MOST_TERMS
from rigctl.workbench.scatter import LEAST_DOF

Findings = Mapping[str, Any]

HOLDS_WITHIN = 1.2
"""A model that holds is hardly worse elsewhere than a fit made there."""

NAMED = 5
"""Readings that are left out and named; of more the number is said."""

WORDS_SAID = 12
"""So many words are said with their scatter; of more the ends."""

ADEQUATE_P = 0.01
"""A chi-square with a smaller p speaks against the model."""


def model_name(effects: Sequence[str]) -> str:
    """The model by its effects."""
    return f"baseline + {' + '.join(effects)}" if effects else "the baseline alone"


def change_of(version: Findings) -> str:
    """What a version differs in from the one before."""
    if version["added"]:
        return f"+ {version['added']}"
    if version["removed"]:
        return f"- {version['removed']}"
    return " + ".join(version["effects"]) or "baseline"


def rms_unit(rungs: Sequence[Findings]) -> str | None:
    """The unit of what a ladder's versions leave, "" for none, where there is but one channel; else None."""
    channels = {(channel, each["unit"]) for rung in rungs for channel, each in (rung.get("rms") or {}).items()}
    return channels.pop()[1] if len(channels) == 1 else None


def only_rms(rung: Findings) -> float | None:
    """What a version leaves of the only channel there is; None where it was not fitted."""
    return next((float(each["value"]) for each in (rung.get("rms") or {}).values()), None)


def is_inadequate(comparison: Findings) -> bool:
    """Whether the data speak against the model; not where nothing can be said."""
    p = comparison["p_value"]
    return p is not None and bool(p < ADEQUATE_P)


def comparison_sentence(comparison: Findings) -> str:
    """Does the model describe the data?"""
    p, reduced, dof = comparison["p_value"], comparison["chi2_per_dof"], comparison["dof"]
    if dof <= 0:
        return "There are no more data than parameters: nothing can be said of the model."
    # Not that of chi-square alone, which a reader would work out and miss.
    asked = "for chi2, effects and shapes together"
    figures = f"chi2/dof = {number(reduced)} with {dof} degrees of freedom; {p_value(p)} {asked}"
    if is_inadequate(comparison):
        return f"The model does not describe the data: {figures}."
    return f"The model describes the data within their noise: {figures}."


def noise_sentence(findings: Findings) -> str:
    """How large the noise is, of what kind, and from what that is known: the same in every command."""
    entries = findings.get("noise") or []
    parts = [_noise(each) + _shared(each) for each in entries if each["source"] != "samples"]
    if spectra := len(entries) - len(parts):
        parts.append(f"{counted(spectra, 'series', 'series')} as the runs' own samples tell")
    return f"Noise: {'; '.join(parts)}." if parts else ""


def _noise(entry: Findings) -> str:
    name = f"{entry['channel']} {entry['component']}".strip()
    along = f" along {entry['order']}" if entry["order"] and entry["model"] != "white" else ""
    correlated = entry.get("correlated_share", 0.0)
    # Less than a variance is uncertain by, which its degrees of freedom say, is no matter.
    if entry["model"] == "white" and correlated > math.sqrt(2.0 / (entry["dof"] or math.inf)):
        # It is the variance of a mean of laws: residuals show little of what is slow.
        percent = f"{number(100.0 * correlated, 2)} %"
        along = f", or correlated along {entry['order']} ({percent} of the variance, by the odds of both)"
    size = f"{number(entry['sigma'])} {entry['unit']}".strip()
    if entry["source"] == "stated" and not math.isfinite(entry["dof"] or math.inf):
        kept = f"below {LEAST_DOF} degrees of freedom the scatter does not correct that"
        return f"{name} {entry['model']}, {size} as stated; {kept}"
    how = f", as stated times {number(entry['scale'])}" if entry["source"] == "stated" else ""
    told = f"{number(entry['dof'])} degrees of freedom{how}"
    if entry.get("resolution") is None:
        return f"{name} {entry['model']}{along}, {size} from {told}"
    step = f"{number(entry['resolution'])} {entry['unit']}".strip()
    return (
        f"{name} {entry['model']}{along}, {size} by the resolution of {step}, as the scatter of {told} is no larger"
    )


def _shared(entry: Findings) -> str:
    """What of the noise readings of one batch have in common; "" where they share nothing."""
    sizes = [f"{with_unit(number(sigma), entry['unit'])} by {of}" for of, sigma in entry.get("batches", {}).items()]
    return f", of which readings share {' and '.join(sizes)}" if sizes else ""


def excluded_sentence(findings: Findings) -> str:
    """Which readings were marked invalid where they were recorded, and so count nowhere; "" for none."""
    rows = list(findings.get("excluded") or ())
    if not rows:
        return ""
    more = [f"{len(rows) - NAMED} more"] if len(rows) > NAMED else []
    are = "reading is" if len(rows) == 1 else "readings are"
    return f"{len(rows)} {are} left out, marked invalid: {', '.join([*rows[:NAMED], *more])}."


def slow_noise_sentences(diagnosis: Findings) -> list[str]:
    """Which effects slow noise may hide, how large they would have to be, and what would tell; [] for none."""
    hidden = diagnosis.get("hidden_in_slow_noise") or []
    said = []
    for each in hidden:
        rows = each["smallest_detectable"].items()
        sizes = [
            f"{name.rpartition('.')[2]} from {quantity(size, None, each['units'][name])}, not from "
            f"{quantity(each['smallest_detectable_if_white'][name], None, each['units'][name])}"
            for name, size in rows
            if name in each["smallest_detectable_if_white"]
        ]
        said.append(
            f"Slow noise may hide {each['effect']}: if the noise were white along {each['order']} it would be "
            f"significant ({p_value(each['p_value_if_white'])}), as it is these data show {'; '.join(sizes)}."
        )
    if said:
        said.append("In which order, and when, to measure so that it shows, rigctl next tells.")
    return said


def scatter_sentences(findings: Findings) -> list[str]:
    """Which reading is far from all others; along what scatter changes, with weights that do it justice; how stated
    uncertainties fail; [] for none."""
    said = [_uneven(each) for each in findings.get("scatter") or []]
    if said:
        said.append(
            "Readings that weigh by it tell more: put the sigma of each in a column that [table] sigma names."
        )
    return [each for each in (_far_sentence(findings), *said, stated_sentence(findings)) if each]


def _far_sentence(findings: Findings) -> str:
    far = findings.get("far_reading")
    if not far:
        return ""
    scatter = with_unit(number(far["scatter"]), far["unit"])
    off, following = number(far["sigmas"]), number(far["following"])
    return (
        f"{far['run_id']} is far from all others: off by {off} times their scatter of {scatter}, the next by "
        f"{following} ({p_value(far['p_value'])}). Look at it: marked invalid it counts nowhere, nor for the noise."
    )


def _by_word(sigmas: Mapping[str, float], unit: str) -> str:
    """How much the readings of each word scatter; of very many words the least and the most."""
    sizes = {word: f"{number(sigma)}{unit} at {word}" for word, sigma in sigmas.items()}
    if len(sizes) <= WORDS_SAID:
        return ", ".join(sizes.values())
    least, most = min(sigmas, key=sigmas.__getitem__), max(sigmas, key=sigmas.__getitem__)
    return f"{sizes[least]} to {sizes[most]}, of {len(sizes)}"


def _uneven(scatter: Findings) -> str:
    unit = " times what is stated" if scatter["of_stated"] else f" {scatter['unit']}".rstrip()
    along, p = scatter["along"].replace("fitted level", "the fitted level"), p_value(scatter["p_value_corrected"])
    if scatter["by_word"]:
        return f"The scatter differs by {along}: {_by_word(scatter['by_word'], unit)} ({p})."
    low, high = scatter["low"], scatter["high"]
    way = "grows" if high["sigma"] > low["sigma"] else "falls"
    same = f" (as along {', '.join(scatter['same_as'])})" if scatter["same_as"] else ""
    return (
        f"The scatter {way} along {along}{same}: from {number(low['sigma'])}{unit} at {number(low['at'], 4)} to "
        f"{number(high['sigma'])}{unit} at {number(high['at'], 4)} ({p}), as {scatter['law']}."
    )


def stated_sentence(findings: Findings) -> str:
    """How stated uncertainties fail; "" where they do not, or none are stated."""
    stated = findings.get("stated_sigma")
    if not stated:
        return ""
    factor = quantity(stated["factor"]["value"], stated["factor"]["sigma"], "")
    words = f"Stated uncertainties do not fit the scatter ({p_value(stated['p_value'])}): "
    if stated["added"] is None:
        return f"{words}they are too large; each times {factor} would fit."
    added = quantity(stated["added"]["value"], stated["added"]["sigma"], stated["added"]["unit"])
    ways = {"factor": f"each times {factor}", "added": f"{added} added to each in quadrature"}
    if stated["likelier"] is None:
        return f"{words}{ways['factor']}, or {ways['added']}: these data do not tell which."
    other = "added" if stated["likelier"] == "factor" else "factor"
    odds = number(abs(stated["log_likelihood_ratio"]))
    return f"{words}{ways[stated['likelier']]}, rather than {ways[other]} (log likelihood {odds} larger)."


def repeats_sentence(comparison: Findings) -> str:
    """What readings taken again at one setting tell of the noise and of the model; "" where there are none."""
    lack = comparison.get("lack_of_fit")
    if not lack:
        return ""
    size = f"{number(lack['pure_error'])} {lack['unit']}".strip()
    test = f"F({lack['dof']}, {lack['pure_dof']}) = {number(lack['f'])}, {p_value(lack['p_value'])}"
    return f"Repeats: {size} from {counted(lack['pure_dof'], 'degree')} of freedom; lack of fit {test}."


def warning_sentences(rungs: Sequence[Findings]) -> list[str]:
    """What speaks against versions of the model."""
    warnings = ((rung, warning) for rung in rungs for warning in rung.get("warnings") or ())
    return [f"Warning, version {rung['version']}: {warning}." for rung, warning in warnings]


def transfer_sentence(transfer: Findings) -> str:
    """Does a model fitted to one store hold for another?"""
    # An error below 1 is chance: no more is asked of the other store than noise.
    refitted, transferred = transfer["error_own"], transfer["error_transferred"]
    holds = "holds" if transferred <= HOLDS_WITHIN * max(refitted, 1.0) else "does not hold"
    return (
        f"What was fitted here {holds} for {transfer['store']}: error {number(transferred)} there, "
        f"{number(refitted)} with a fit of its own (1.00 = noise)."
    )


def verdict_sentence(diagnosis: Findings) -> str:
    """Which physical effect is missing, in a sentence or two."""
    if len(diagnosis["suggested"]) < MOST_TERMS:
        return _verdict(diagnosis)
    return f"{_verdict(diagnosis)} A diagnosis ends with {MOST_TERMS} effects: ask again once they are added."


def _verdict(diagnosis: Findings) -> str:
    suggested = diagnosis["suggested"]
    if diagnosis["verdict"] == "adequate":
        adequate = (
            f"The model is adequate: nothing more is significant at {share(diagnosis['alpha'])}, "
            "over all trials together."
        )
        return " ".join([adequate, *_or_noise(diagnosis)])
    if diagnosis["verdict"] == "unknown":
        return f"{_beyond(diagnosis['unexplained'])}.{_not_enough(_placed(suggested, diagnosis))}"
    if diagnosis["verdict"] == "ambiguous":
        return " ".join(_ambiguous(diagnosis))
    return f"{_missing(_placed(suggested, diagnosis))}."


def _ambiguous(diagnosis: Findings) -> list[str]:
    """What is certain, what one of several effects explains, and what correlated noise may stand for."""
    either = {each["effect"] for each in diagnosis.get("or_correlated_noise") or []}
    needed, alternatives = _alternatives(diagnosis)
    certain = [effect for effect in needed if effect not in either]
    said = [f"{_missing(_placed(certain, diagnosis))}."] if certain else []
    if alternatives:
        what = "What is left is" if certain else "The data are"
        said.append(f"{what} explained, but by more than one effect equally: {'; '.join(alternatives)}.")
    return [*said, *_or_noise(diagnosis)]


def _or_noise(diagnosis: Findings) -> list[str]:
    """What correlated noise may stand for, in the model or suggested."""
    return [
        f"{_placed([each['effect']], diagnosis)[0]} describes the data, and so does noise that is correlated along "
        f"{each['order']}: these data do not tell which."
        for each in diagnosis.get("or_correlated_noise") or []
    ]


def _beyond(unexplained: Findings | None) -> str:
    remains = "Something remains that none of the known effects explains"
    if unexplained is None:
        return remains
    return f"{remains}: {unexplained['description'].rstrip('.')}, {p_value(unexplained['p_value'])}"


def _not_enough(suggested: Sequence[str]) -> str:
    if not suggested:
        return ""
    return f" {_missing(suggested)}, and {'they do' if len(suggested) > 1 else 'it does'} not suffice."


def _placed(effects: Sequence[str], diagnosis: Findings) -> list[str]:
    """Effects with the fitted value of what was scanned, such as a period, where there is one."""
    ranks = {rank["effect"]: rank for rank in diagnosis["ranking"]}
    placed = []
    for effect in effects:
        rank = ranks.get(effect, {"choice": {}, "parameters": {}})
        at = [(key, rank["parameters"].get(f"{effect}.{key}")) for key in rank["choice"]]
        values = [f"{key} {number(size['value'], 4)} {size['unit']}".rstrip() for key, size in at if size]
        placed.append(f"{effect} ({', '.join(values)})" if values else effect)
    return placed


def _missing(suggested: Sequence[str]) -> str:
    if len(suggested) == 1:
        return f"An effect is missing: {suggested[0]}"
    return f"{counted(len(suggested), 'effect')} are missing: {', '.join(suggested)}"


def _alternatives(diagnosis: Findings) -> tuple[list[str], list[str]]:
    """The suggested effects that nothing else would do for, and the choices where something would."""
    same = {rank["effect"]: rank["equivalent_to"] for rank in diagnosis["ranking"]}
    needed = [effect for effect in diagnosis["suggested"] if not same.get(effect)]
    choices = [" or ".join([effect, *same[effect]]) for effect in diagnosis["suggested"] if same.get(effect)]
    return needed, choices


def line_sentence(line: Findings) -> str:
    """A line in the samples."""
    size = quantity(line.get("amplitude"), line.get("sigma"), line.get("unit", ""))
    return f"A line in the samples of {line['channel']}: {size} at {number(line['frequency_hz'], 5)} Hz."


def advice(diagnosis: Findings, store: str) -> str:
    """What to do next, as a command line."""
    if diagnosis["verdict"] == "ambiguous":
        return f"rigctl next {store}"
    if diagnosis["suggested"]:
        return f"rigctl model add {store} {shlex.join(diagnosis['suggested'])}"
    if diagnosis["verdict"] == "unknown":
        return f"rigctl compare {store}, then an effect of your own: rigctl model add {store} ID --plugin FILE"
    return f"rigctl result {store}"


def named(effect: str, choice: Mapping[str, Any]) -> str:
    """An effect with what was chosen of it: laser-cosine (head laser_2_mm)."""
    if not choice:
        return effect
    chosen = ", ".join(
        f"{key} {number(value, 5) if isinstance(value, float) else value}" for key, value in choice.items()
    )
    return f"{effect} ({chosen})"


def fixed_choice(rank: Findings) -> dict[str, Any]:
    """What was chosen of a candidate, without what is fitted and listed among its parameters, and zero origins."""
    return {
        key: value
        for key, value in rank["choice"].items()
        # An origin of zero is no choice.
        if f"{rank['effect']}.{key}" not in rank["parameters"] and (key, value) != ("origin", 0.0)
    }


def fitted_choice(rank: Findings) -> dict[str, Any]:
    """What was chosen of a candidate, and of what is fitted from there where the fit ended."""
    fitted = rank["parameters"]
    return {key: fitted.get(f"{rank['effect']}.{key}", {"value": at})["value"] for key, at in rank["choice"].items()}


def sizes(rank: Findings, *, detectable: bool = False) -> list[str]:
    """Each parameter of a candidate with its value; one that is named like its effect needs no name.

    With `detectable` also how large it would have to be for these data to show it, with 95 % probability.
    """
    shown = []
    for name, size in rank["parameters"].items():
        parameter = name.removeprefix(rank["effect"]).lstrip(".")
        shown.append(f"{parameter} = {estimate(size, size['unit'])}".lstrip())
        least = rank["smallest_detectable"].get(name) if detectable else None
        if least is not None and math.isfinite(least):
            shown.append(f"    would show from {with_unit(number(least), size['unit'])}")
    return shown


def inseparable_sentences(pairs: Sequence[Findings]) -> list[str]:
    """Which effects cannot be told from what, one sentence for each, and what that does."""
    others: dict[str, list[str]] = {}
    for pair in pairs:
        other = str(pair["from"])
        whom = other
        if other.startswith("baseline:"):
            whom = f"the baseline's {other.removeprefix('baseline:')}"
        elif other.startswith("offset:"):
            whom = f"the offsets that readings of one {other.removeprefix('offset:')} share"
        others.setdefault(pair["effect"], []).append(f"{whom} ({pair['shift']})" if pair["shift"] else whom)
    return [f"{effect} cannot be told from {', '.join(whom)}" for effect, whom in others.items()]
