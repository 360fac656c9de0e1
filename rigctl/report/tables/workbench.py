"""What the workbench found, as tables; findings come as their JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.report.quantities import estimate, number, probability, quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.verdicts import (
    ADEQUATE_P,
    Findings,
    change_of,
    comparison_sentence,
    fixed_choice,
    is_inadequate,
    model_name,
    named,
    noise_sentence,
    only_rms,
    rms_unit,
    sizes,
    stated_sentence,
)


def parameters_table(fit: Findings) -> ResultTable:
    """Parameters of a fit and how well they describe the data."""
    of_effects = {name: each for name, each in fit["result"].items() if name.rpartition(".")[0] in fit["effects"]}
    estimates = dict(fit["parameters"]) | of_effects
    rows = [[name, estimate(each), each["unit"]] for name, each in estimates.items()]
    held_out = number(fit["error_held_out"])
    notes = [
        comparison_sentence(fit),
        f"error {number(fit['error_fit'])}, on held-out runs {held_out} (1.00 = noise)",
        *filter(None, [noise_sentence(fit), stated_sentence(fit)]),
    ]
    return ResultTable(
        f"Fit of {model_name(fit['effects'])}", ["parameter", "#value", "unit"], rows, notes=notes, shortened=True
    )


def channels_table(comparison: Findings) -> ResultTable:
    """Residuals by channel. Where the model does not describe the data the only channel fails, of several those whose
    chi-square is too large for their data."""
    series = len(comparison["channels"])
    # By one p-value with the sentence: noise that the same data told allows a chi-square more than is said here.
    fails = is_inadequate(comparison)
    rows = [
        [
            row["channel"],
            row["component"],
            number(row["rms"]),
            number(row["noise"]),
            row["unit"],
            number(row["chi2"] / row["data"]) if row["data"] else "-",
            "FAILS" if fails and (series == 1 or _stands_out(row, series)) else "",
        ]
        for row in comparison["channels"]
    ]
    columns = ["channel", "component", "#rms", "#noise", "unit", "#chi2/n", ""]
    return ResultTable("Residuals by channel", columns, rows, [bool(row[-1]) for row in rows])


def _stands_out(channel: Findings, of: int) -> bool:
    """Whether a channel's chi-square is too large for its data, the largest of so many."""
    from scipy.special import chdtrc  # the console's first paint does not wait for scipy

    return bool(channel["data"]) and of * float(chdtrc(channel["data"], channel["chi2"])) < ADEQUATE_P


def ranking_table(diagnosis: Findings, most: int) -> ResultTable:
    """Candidates from the most significant down, with sizes: the first `most`, and all that are significant."""
    ranking, suggested = diagnosis["ranking"], diagnosis["suggested"]
    shown = [
        rank
        for place, rank in enumerate(ranking)
        if place < most or (rank["p_value_corrected"] or 0.0) < diagnosis["alpha"] or rank["effect"] in suggested
    ]
    rows = []
    for rank in shown:
        star = "*" if rank["effect"] in suggested else " "
        # What is significant has a size; of the others a reader asks what size these data would have shown.
        insignificant = (rank["p_value_corrected"] or 0.0) >= diagnosis["alpha"]
        told = sizes(rank, detectable=insignificant and rank["effect"] not in suggested)
        lines = [f"{star} {named(rank['effect'], fixed_choice(rank))}", *(f"    {size}" for size in told)]
        lines += [f"    like {', '.join(rank['equivalent_to'])}"] if rank["equivalent_to"] else []
        numbers = number(rank["chi2_fall"]), number(rank["held_out_error_ratio"])
        rows.append(["\n".join(lines), probability(rank["p_value_corrected"]), *numbers])
    notes = ["held out: error after / before, on runs not used in the fit"]
    if len(shown) < len(ranking):
        notes.append(f"{len(ranking) - len(shown)} more, none of them significant")
    columns = ["effect (*: suggested)", "#p corr.", "#chi2 fall", "#held out"]
    return ResultTable(
        "Candidates", columns, rows, [rank["effect"] in suggested for rank in shown], notes, shortened=True
    )


def ladder_table(rungs: Sequence[Findings], *, results: bool = True) -> ResultTable:
    """The error ladder: the versions of the model with their errors, and where asked for with their results."""
    rows, unit = [], rms_unit(rungs)
    for rung in rungs:
        lines = [f"{rung['version']}: {change_of(rung)}"]
        if results:
            # Indented below the version: a column each would not fit 80 letters.
            lines += [f"    {name} = {_short(each)}" for name, each in (rung.get("result") or {}).items()]
        numbers = [number(rung[key]) for key in ("chi2_per_dof", "error_fit", "error_held_out")]
        rows.append(["\n".join(lines), *([number(only_rms(rung))] if unit is not None else []), *numbers])
    notes = ["error: rms of the whitened residuals, 1.00 = noise; held out: on blocks not used in the fit"]
    notes += [noise_sentence(rungs[-1])] if rungs and rungs[-1].get("noise") else []
    notes += [f"version {rung['version']}: not fitted: {rung['note']}" for rung in rungs if "note" in rung]
    rms = [] if unit is None else [_over("#rms", unit)]
    columns = ["version", *rms, "#chi2/dof", "#error", "#held out"]
    return ResultTable("Error ladder", columns, rows, notes=notes, shortened=True)


MOST_IN_LADDER = 8
"""Results of a version that stand below it; more have a table of their own."""


def ladder_tables(rungs: Sequence[Findings]) -> list[ResultTable]:
    """The ladder for a page; where versions have many results, these beside it, a column for each version."""
    results = {rung["version"]: rung.get("result") or {} for rung in rungs}
    if max(map(len, results.values()), default=0) <= MOST_IN_LADDER:
        return [ladder_table(rungs)]
    names = list(dict.fromkeys(name for each in results.values() for name in each))
    rows = [[name, *(_short(each[name]) if name in each else "" for each in results.values())] for name in names]
    columns = ["result", *(f"#version {version}" for version in results)]
    return [ladder_table(rungs, results=False), ResultTable("Results by version", columns, rows)]


def rms_tables(rungs: Sequence[Findings]) -> list[ResultTable]:
    """What each version leaves of each channel, where the ladder itself has no room for it."""
    channels = {channel: each["unit"] for rung in rungs for channel, each in (rung.get("rms") or {}).items()}
    if len(channels) < 2:
        return []
    left = [rung.get("rms") or {} for rung in rungs]
    rows = [
        [str(rung["version"]), *(number(each[channel]["value"]) if channel in each else "-" for channel in channels)]
        for rung, each in zip(rungs, left, strict=True)
    ]
    columns = ["version", *(_over(f"#{channel}", unit) for channel, unit in channels.items())]
    return [ResultTable("Rms of the residuals", columns, rows)]


def _over(name: str, unit: str) -> str:
    """A column's heading with the unit of its numbers."""
    if not unit:
        return name
    # m/s/s could be read as either quotient.
    return f"{name}/({unit})" if "/" in unit else f"{name}/{unit}"


def transfer_table(transfer: Findings, least_sigmas: float = 0.0) -> ResultTable:
    """Parameters fitted here and there that are more than `least_sigmas` apart, or cannot be compared with 0."""
    rows = []
    for name, pair in transfer["parameters"].items():
        apart = pair["sigmas_apart"]
        if abs(apart or 0.0) >= least_sigmas:
            here, there = (estimate(pair[side]) for side in ("here", "there"))
            rows.append([name, here, there, "-" if apart is None else f"{apart:+.1f}", pair["here"]["unit"]])
    title = "Parameters that differ" if least_sigmas else "Parameters"
    return ResultTable(title, ["parameter", "here", "there", "#sigmas apart", "unit"], rows, shortened=True)


def _short(entry: Any) -> str:
    """One entry of a result: value, sigma and unit where it has them."""
    if isinstance(entry, Mapping) and isinstance(entry.get("value"), int | float):
        unit = entry.get("unit", "")
        return estimate(entry, unit) if "sigma" in entry else quantity(entry["value"], None, unit)
    return str(entry)
