"""Every number of a certificate worked out again, by another way than the program's, and sought in page and DCC.

Values, uncertainties and contributions are those of `rigctl result --json`, or of readings and draws as they lie in
the store; what certificates make of them (Welch-Satterthwaite, coverage, intervals, guard bands, digits) is here once
more, from JCGM 100, JCGM 106 and the quantiles of scipy.stats. A number that is not accounted for is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from html.parser import HTMLParser
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from scipy import stats

from rigctl.certificate import model_in_force, page
from rigctl.certificate.content import certificate_of
from rigctl.certificate.dcc import document
from rigctl.composition import opened_workbench
from rigctl.files.certificate_file import CertificateDetails

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
RISK = 0.025
SUBTRACTED = 1e-15
"""What is left of a probability of one is known no better."""

CANCELLED = 1e-9
"""Of an uncertainty: how well parts are known here that nearly cancel, in an angle between two axes."""

ARCSEC = math.pi / 648_000.0


@dataclass
class Account:
    """What a certificate has to say: quantities, their covariance, and what each source does to each of them.

    `parts` has the alternatives of a source, one of which holds for all quantities together: contributions are told
    without their signs. `spreads` are standard deviations by place; `limits` requirements (lower, upper) by place.
    """

    names: Sequence[str]
    values: np.ndarray
    covariance: np.ndarray
    parts: Mapping[str, Sequence[np.ndarray]]
    dof: Mapping[str, float]
    spreads: frozenset[int] = frozenset()
    limits: Mapping[int, tuple[float | None, float | None]] = field(default_factory=dict)

    def known(self, chosen: Mapping[str, np.ndarray]) -> list[Known]:
        """Of each quantity all that follows from its sources."""
        u = np.sqrt(np.diag(self.covariance))
        np.testing.assert_allclose(np.sqrt(sum(part**2 for part in chosen.values())), u, rtol=1e-5, atol=0.0)
        found = []
        for place, value in enumerate(self.values):
            inverse = sum((part[place] / u[place]) ** 4 / self.dof[name] for name, part in chosen.items())
            dof = 1.0 / inverse if inverse else math.inf
            found.append(Known(float(value), float(u[place]), dof, place in self.spreads))
        return found


@dataclass(frozen=True)
class Known:
    """A quantity with its standard uncertainty and its effective degrees of freedom."""

    value: float
    u: float
    dof: float
    spread: bool

    @property
    def estimate(self) -> float:
        """Of a spread, the root of its squares over their degrees of freedom, known to 1 / sqrt(2 dof) of itself."""
        return self.u * math.sqrt(2.0 * self.dof)

    @property
    def k(self) -> float:
        whole = math.floor(self.dof + 1e-9) if math.isfinite(self.dof) else math.inf
        return float(stats.t.ppf(0.975, whole) if math.isfinite(whole) else stats.norm.ppf(0.975))

    @property
    def ends(self) -> tuple[float, float]:
        if not self.spread:
            return self.value - self.k * self.u, self.value + self.k * self.u
        low, high = (self.estimate * math.sqrt(self.dof / stats.chi2.ppf(p, self.dof)) for p in (0.975, 0.025))
        return low, high

    def below(self, limit: float) -> float:
        if self.spread:
            return float(stats.chi2.sf(self.dof * (self.estimate / limit) ** 2, self.dof))
        t = (limit - self.value) / self.u
        return float(stats.t.cdf(t, self.dof) if math.isfinite(self.dof) else stats.norm.cdf(t))

    def accepted(self, limit: float, side: int) -> float:
        """A limit less its guard band, `side` 1 for an upper one (JCGM 106, 8.3.2)."""
        if self.spread:
            p = RISK if side > 0 else 1.0 - RISK
            return limit * math.sqrt(stats.chi2.ppf(p, self.dof) / self.dof) * self.value / self.estimate
        t = stats.t.ppf(1.0 - RISK, self.dof) if math.isfinite(self.dof) else stats.norm.ppf(1.0 - RISK)
        return float(limit - side * t * self.u)


# What the store has to say.


def of_axes(told: Mapping[str, Any]) -> Account:
    """Sensing axes: components in the host's frame, angles between axes, half-cone deviations."""
    axes = {name: np.array(told["axes"][name]["uoaf"]) for name in told["host"]["axes"]}
    pairs = list(combinations(axes, 2))

    def outputs(components: np.ndarray) -> np.ndarray:
        there = dict(zip(axes, components.reshape(-1, 3), strict=True))
        angles = [_angle_deg(there[a], there[b]) for a, b in pairs]
        return np.concatenate([components, angles])

    here = np.concatenate(list(axes.values()))
    slopes = _slopes(outputs, here)
    deviations = np.array([told["axes"][name]["std_hc_2sigma_arcsec"] for name in axes])
    vectors = np.array([told["axes"][name]["vectors"] for name in axes])
    m, more = len(slopes), len(axes)
    covariance = np.zeros((m + more, m + more))
    covariance[:m, :m] = slopes @ np.array(told["host"]["covariance"]) @ slopes.T
    # The plane takes two degrees of freedom of the squares that eq. 16 divides by n - 1.
    unbiased = np.sqrt((vectors - 1.0) / (vectors - 2.0))
    covariance[range(m, m + more), range(m, m + more)] = (unbiased * deviations) ** 2 / (2.0 * (vectors - 2.0))
    parts: dict[str, list[np.ndarray]] = {}
    dof: dict[str, float] = {}
    for name, alternatives in _of_directions(told, axes).items():
        parts[name] = [
            np.concatenate([np.sqrt(sum((slopes @ each) ** 2 for each in inputs)), np.zeros(more)])
            for inputs in alternatives
        ]
        own = re.fullmatch(r"scatter of (\w+)", name)
        dof[name] = told["axes"][own[1]]["dof"] if own else math.inf
    for place, axis in enumerate(axes):
        name = f"number of null vectors of {axis}"
        column = np.zeros(m + more)
        column[m + place] = math.sqrt(covariance[m + place, m + place])
        parts[name], dof[name] = [column], vectors[place] - 2.0
    names = [f"axis {axis}, {component}" for axis in axes for component in "xyz"]
    names += [f"angle {a} to {b}" for a, b in pairs] + [f"half-cone deviation {axis}" for axis in axes]
    limits = {m + place: (None, told["axes"][axis]["requirement_arcsec"]) for place, axis in enumerate(axes)}
    values = np.concatenate([outputs(here), deviations])
    return Account(names, values, covariance, parts, dof, frozenset(range(m, m + more)), limits)


def _of_directions(
    told: Mapping[str, Any], axes: Mapping[str, np.ndarray]
) -> dict[str, list[tuple[np.ndarray, ...]]]:
    """Of every source, by its inputs, all vectors (3 n,) that their two unsigned parts of each axis allow.

    Scatter of an axis has an input for each configuration, and one estimate.
    """
    signed: dict[str, dict[str, list[np.ndarray]]] = {}
    for axis in axes:
        budget = told["budget"][axis]
        basis = np.array(budget["basis_uoaf"])
        for each in budget["contributions"]:
            own = each["name"].startswith(("scatter in ", "resonance in "))
            name = f"{each['name']} of {axis}" if own else each["name"]
            both = np.array(each["arcsec"]) * ARCSEC
            signs = (np.array(pair) for pair in product((1.0, -1.0), repeat=2))
            signed.setdefault(name, {})[axis] = [basis.T @ (sign * both) for sign in signs]
    nothing = [np.zeros(3)]
    inputs: dict[str, list[list[np.ndarray]]] = {}
    for name, of in signed.items():
        source = re.sub(r"^scatter in \S+ of ", "scatter of ", name)
        both = [np.concatenate(each) for each in product(*(of.get(axis, nothing) for axis in axes))]
        inputs.setdefault(source, []).append(both)
    return {name: list(product(*each)) for name, each in inputs.items()}


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _slopes(outputs: Any, here: np.ndarray, step: float = 1e-6) -> np.ndarray:
    moved = (step * row for row in np.eye(len(here)))
    return np.array([(outputs(here + each) - outputs(here - each)) / (2.0 * step) for each in moved]).T


def of_platform(told: Mapping[str, Any]) -> Account:
    """Rotating platform: the contributions of the budget."""
    budget = told["budget"]
    parts = {each["name"]: [np.array(each["u"])] for each in budget["contributions"]}
    scattered = {each["name"] for each in budget["contributions"] if each["source"] == "scatter between runs"}
    dof = {name: len(told["runs"]) - 1.0 if name in scattered else math.inf for name in parts}
    return Account(budget["outputs"], np.array(budget["values"]), np.array(budget["covariance"]), parts, dof)


def of_fit(told: Mapping[str, Any], attempt: Any) -> Account:
    """A plug-in's coefficients, each a parameter in another unit; noise and priors by pools of the fit."""
    found = told["result"]
    scale = np.array([each["sigma"] / told["parameters"][name]["sigma"] for name, each in found.items()])
    pools = _pools(attempt, list(found), scale)
    places = [attempt.names.index(name) for name in found]
    covariance = attempt.uncertainty.covariance[np.ix_(places, places)] * np.outer(scale, scale)
    values = np.array([each["value"] for each in found.values()])
    parts = {name: [part] for name, (part, _) in pools.items()}
    return Account(list(found), values, covariance, parts, {name: dof for name, (_, dof) in pools.items()})


def of_calibration(told: Mapping[str, Any], fit: Mapping[str, Any], attempt: Any, runs: Sequence[Any]) -> Account:
    """A calibration in orbit: what its fit says, session by session, and what no session sees."""
    fitted = of_fit(fit, attempt)
    named = {
        f"noise of {run.run_id}": f"noise of session {run.conditions['session']} (run {run.run_id})" for run in runs
    }
    parts = {named.get(name, name): part for name, part in fitted.parts.items()}
    dof = {named.get(name, name): of for name, of in fitted.dof.items()}
    beyond = np.array([told["parameters"].get(name, {}).get("systematic", 0.0) for name in fitted.names])
    parts["star tracker and coupling"], dof["star tracker and coupling"] = [beyond], math.inf
    return Account(fitted.names, fitted.values, fitted.covariance + np.diag(beyond**2), parts, dof)


def _pools(attempt: Any, wanted: Sequence[str], scale: np.ndarray) -> dict[str, tuple[np.ndarray, float]]:
    """Parts of parameters and degrees of freedom, by pools of noise and of what was known beforehand.

    Of a linear fit p = C J' W d with data d, a pool's part is C J' W V W' J C, V what the fit tells of its noise.
    """
    jacobian = np.asarray(attempt.jacobian)
    free = np.flatnonzero(np.any(jacobian, axis=0))
    covariance = np.zeros((jacobian.shape[1],) * 2)
    # Of columns of unit length: their units differ by many powers of ten.
    size = np.linalg.norm(jacobian[:, free], axis=0)
    unit = jacobian[:, free] / size
    covariance[np.ix_(free, free)] = np.linalg.inv(unit.T @ unit) / np.outer(size, size)
    given, data = attempt.model.observations, len(attempt.result.residuals)
    found: dict[str, tuple[np.ndarray, float]] = {}
    for number, pool in enumerate(given.pools):
        rows = np.flatnonzero(np.asarray(given.pool_of) == number)
        if len(rows):
            root = attempt.noise_beside_fit.colour(np.eye(data))[:, rows]
            seen = attempt.noise.whiten(root).T @ jacobian[:data]
            found[f"noise of {pool.name}"] = seen, float(np.min(attempt.noise.dof[rows]))
    if len(jacobian) > data:
        found["what was known beforehand"] = jacobian[data:], math.inf
    told = {}
    for name, (rows, dof) in found.items():
        u = np.linalg.norm(rows @ covariance, axis=0)
        told[name] = (scale * u[[attempt.names.index(each) for each in wanted]], dof)
    return told


def of_line(columns: Mapping[str, np.ndarray], noise: Mapping[str, Any], limits: Mapping[int, Any]) -> Account:
    """Pontius' quadratic by the normal equations, its noise as the fit tells it."""
    load, read = columns["load_lb"], columns["deflection_in"]
    scaled = np.vander(load / load.max(), 3, increasing=True)
    back = load.max() ** -np.arange(3.0)
    values = back * np.linalg.lstsq(scaled, read, rcond=None)[0]
    covariance = noise["sigma"] ** 2 * np.outer(back, back) * np.linalg.inv(scaled.T @ scaled)
    parts = {"noise of deflection_in": [np.sqrt(np.diag(covariance))]}
    names = ("b0", "b1", "power2[load_lb]")
    return Account(names, values, covariance, parts, {"noise of deflection_in": noise["dof"]}, limits=limits)


def of_draws(draws: Sequence[Mapping[str, Any]]) -> Account:
    """A study: mean errors over its draws."""
    names = list(draws[0]["truths"]["exact_truth"])
    errors = np.array([[d["estimates"]["joint"][n] - d["truths"]["exact_truth"][n] for n in names] for d in draws])
    centred = errors - errors.mean(axis=0)
    covariance = centred.T @ centred / (len(draws) - 1.0) / len(draws)
    parts = {"spread of the draws": [np.sqrt(np.diag(covariance))]}
    dof = {"spread of the draws": len(draws) - 1.0}
    return Account([f"{name}, mean error" for name in names], errors.mean(axis=0), covariance, parts, dof)


# What the page has to show.


class _Tables(HTMLParser):
    """Rows of cells by the heading above them."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: dict[str, list[list[str]]] = {}
        self._at, self._heading = "", ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._at = tag
        if tag == "h2":
            self._heading = ""
        elif tag == "tr":
            self.rows.setdefault(self._heading, []).append([])
        elif tag in ("td", "th"):
            self.rows[self._heading][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        self._at = ""

    def handle_data(self, data: str) -> None:
        if self._at == "h2":
            self._heading += data
        elif self._at in ("td", "th"):
            self.rows[self._heading][-1][-1] += data


def check_page(text: str, account: Account, chosen: Mapping[str, np.ndarray]) -> int:
    """Compare all cells of results, conformity and budget; how many numbers these were."""
    tables = _Tables()
    tables.feed(text)
    known = account.known(chosen)
    return sum(
        (
            _check_results(tables.rows["Results"], account, known),
            _check_conformity(tables.rows.get("Conformity", []), account, known),
            _check_budget(tables.rows["Uncertainty budget"], account, known, chosen),
        )
    )


def _check_results(rows: Sequence[Sequence[str]], account: Account, known: Sequence[Known]) -> int:
    seen = 0
    for name, each, row in zip(account.names, known, rows[1:], strict=True):
        assert row[0] == name
        half = 0.5 * (each.ends[1] - each.ends[0])
        step = Decimal(1).scaleb(math.floor(math.log10(half)) - 1)
        wanted = [each.value, *(each.ends if each.spread else [half])]
        printed = [row[1], *re.findall(r"[^\[\], ]+", row[2])]
        for text, value in zip(printed, wanted, strict=True):
            assert _rounded(text, value, step), (name, text, value)
        if each.spread:
            assert row[3] == "-"
        else:
            assert _rounded(row[3], each.k, Decimal("0.01")), (name, row[3], each.k)
        assert _dof(row[4], each.dof), (name, row[4], each.dof)
        seen += len(printed) + 2
    return seen


def _check_conformity(rows: Sequence[Sequence[str]], account: Account, known: Sequence[Known]) -> int:
    seen = 0
    for (place, limits), row in zip(sorted(account.limits.items()), rows[1:], strict=True):
        each = known[place]
        assert row[0] == account.names[place]
        inside, verdict, wrong = _decided(each, limits)
        assert row[3].lower() == verdict
        sided = [(limit, side) for limit, side in zip(limits, (-1, 1), strict=True) if limit is not None]
        assert [float(text) for text in _numbers(row[1])] == [limit for limit, _ in sided]
        # A digit more than the value, and never beyond what is accepted.
        step = 10.0 ** (math.floor(math.log10(0.5 * (each.ends[1] - each.ends[0]))) - 2)
        for text, (limit, side) in zip(_numbers(row[2]), sided, strict=True):
            assert -1e-9 * step <= side * (each.accepted(limit, side) - float(text)) < step, (row[0], text)
        wanted = [inside, *([] if wrong is None else [wrong])]
        printed = [*_numbers(row[4]), *_numbers(row[5])]
        for text, value, count in zip(printed, wanted, (4, 2), strict=False):
            assert _significant(text, value, count, SUBTRACTED), (row[0], text, value)
        assert len(printed) == len(wanted)
        seen += len(printed) + 2 * len(sided)
    return seen


def _decided(each: Known, limits: tuple[float | None, float | None]) -> tuple[float, str, float | None]:
    """Probability of conformance, verdict, and how likely that is wrong."""
    lower, upper = limits
    outside = (each.below(lower) if lower is not None else 0.0) + (
        1.0 - each.below(upper) if upper is not None else 0.0
    )
    if outside <= RISK:
        return 1.0 - outside, "pass", outside
    inside = max(1.0 - outside, 0.0)
    return (inside, "fail", inside) if inside <= RISK else (inside, "undecided", None)


def _check_budget(
    rows: Sequence[Sequence[str]], account: Account, known: Sequence[Known], chosen: Mapping[str, np.ndarray]
) -> int:
    """Tables of some quantities each, one below the other; a source without a part in a table is not in it."""
    seen, told = 0, []
    for row in rows:
        if row[0] == "source":
            dof, first = row.index("dof"), row.index("from") + 1
            places = [account.names.index(head.rpartition(" / ")[0]) for head in row[first:]]
            told += places
            u = np.array([known[place].u for place in places])
            left = [name for name, part in chosen.items() if np.any(part[places] > CANCELLED * u)]
            continue
        if row[0] == "combined":
            assert not left, f"sources that are not in the table: {left}"
            wanted = u
        else:
            wanted = chosen[row[0]][places]
            if np.any(wanted > CANCELLED * u):
                left.remove(row[0])
            assert _dof(row[dof], account.dof[row[0]]), row
            seen += 1
        for text, value, whole in zip(row[first:], wanted, u, strict=True):
            assert _significant(text, float(value), 2, CANCELLED * whole), (row[0], text, value)
        seen += len(wanted)
    assert sorted(told) == list(range(len(known)))
    return seen


def _numbers(text: str) -> list[str]:
    return re.findall(r"(?<!\w)[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)


def _rounded(text: str, value: float, step: Decimal) -> bool:
    printed = Decimal(text)
    plain = "e" not in text
    return abs(printed - Decimal(value)) <= step * Decimal("0.500001") and (
        not plain or printed.as_tuple().exponent == min(step.as_tuple().exponent, 0)
    )


def _significant(text: str, value: float, digits: int, slack: float) -> bool:
    if abs(value) <= slack:
        return abs(Decimal(text)) <= 2.0 * slack
    step = Decimal(1).scaleb(math.floor(math.log10(abs(value))) + 1 - digits)
    return abs(Decimal(text) - Decimal(value)) <= step * Decimal("0.500001") + Decimal(slack)


def _dof(text: str, dof: float) -> bool:
    if dof > 1e6:
        return text == "∞"
    return _rounded_dof(text, dof)


def _rounded_dof(text: str, dof: float) -> bool:
    digits = max(3, math.floor(math.log10(dof)) + 1)
    step = Decimal(1).scaleb(math.floor(math.log10(dof)) + 1 - digits)
    # Slopes are differences: the last digit may be the neighbour's.
    return abs(Decimal(text) - Decimal(dof)) <= step * Decimal("0.51")


# What the DCC has to say.


@dataclass
class Dcc:
    """A DCC whose numbers are taken one by one; what is left in the end was not accounted for."""

    root: Any
    taken: set[Any] = field(default_factory=set)

    def quantities(self, result: str) -> list[Any]:
        """Those of a result, in their order."""
        path = f"//dcc:result[dcc:name/dcc:content='{result}']/dcc:data/dcc:quantity"
        return list(self.root.xpath(path, namespaces=NAMES))

    def numbers(self, node: Any, path: str) -> list[float]:
        """Numbers below a node, in their order."""
        found = node.xpath(path, namespaces=NAMES)
        self.taken.update(found)
        return [float(text) for each in found for text in each.text.split()]

    def left(self) -> list[str]:
        """Numbers of D-SI that nobody has taken."""
        texts = {each: each.text or "" for each in self.root.xpath("//dcc:results//si:*", namespaces=NAMES)}
        return [f"{each.tag}: {text}" for each, text in texts.items() if each not in self.taken and _is_number(text)]


def _is_number(text: str) -> bool:
    try:
        return bool([float(each) for each in text.split()])
    except ValueError:
        return False


def chosen_parts(stated: Dcc, account: Account) -> dict[str, np.ndarray]:
    """Of each source that of its alternatives which the DCC has, to six digits; an error for one that has none."""
    found = {}
    for node in stated.quantities("Uncertainty budget"):
        (name,) = node.xpath("dcc:name/dcc:content/text()", namespaces=NAMES)
        written = np.array(stated.numbers(node, ".//si:valueXMLList"))
        scale = np.sqrt(np.diag(account.covariance))
        fits = [
            each for each in account.parts[name] if np.all(np.abs(each - written) <= 5e-6 * each + CANCELLED * scale)
        ]
        assert fits, f"{name}: {written} is none of {account.parts[name]}"
        found[name] = fits[0]
        said = " ".join(node.xpath("dcc:description/dcc:content/text()", namespaces=NAMES))
        (dof,) = re.findall(r"degrees of freedom: (\S+)", said)
        assert account.dof[name] == (math.inf if dof == "infinitely" else float(dof)), name
    assert list(found) == [name for name in found if name in account.parts]
    assert set(account.parts) == set(found)
    return found


def check_dcc(stated: Dcc, account: Account, known: Sequence[Known]) -> None:
    """Compare all numbers of D-SI with the account."""
    close = {"rtol": 2e-5, "atol": 0.0}
    for place, (each, node) in enumerate(zip(known, stated.quantities("Results"), strict=True)):
        numbers = stated.numbers(node, "si:real//si:*[not(*) and not(self::si:unit) and not(self::si:distribution)]")
        about = [each.u, *each.ends] if each.spread else [each.k * each.u, each.k]
        np.testing.assert_allclose(numbers, [each.value, *about, 0.95], **close)
        meta = stated.numbers(node, "dcc:measurementMetaData//si:value")
        limits, probabilities = _decision_numbers(each, account.limits.get(place))
        np.testing.assert_allclose(meta[: len(limits)], limits, **close)
        np.testing.assert_allclose(meta[len(limits) :], probabilities, rtol=1e-4, atol=SUBTRACTED)
    (together,) = stated.quantities("Covariance of the results")
    np.testing.assert_allclose(
        stated.numbers(together, "si:realListXMLList/si:valueXMLList"), account.values, **close
    )
    u = np.sqrt(np.diag(account.covariance))
    np.testing.assert_allclose(stated.numbers(together, ".//si:valueStandardMUXMLList"), u, rtol=1e-5, atol=0.0)
    matrix = np.reshape(stated.numbers(together, ".//si:covarianceXMLList/si:valueXMLList"), (len(u), len(u)))
    np.testing.assert_allclose(matrix / np.outer(u, u), account.covariance / np.outer(u, u), rtol=0.0, atol=2e-5)
    regions = stated.numbers(together, ".//si:coverageFactorXMLList | .//si:coverageProbabilityXMLList")
    assert np.all(np.isnan(regions))
    (degrees,) = stated.quantities("Effective degrees of freedom")
    (said,) = degrees.xpath("dcc:charsXMLList/text()", namespaces=NAMES)
    written = [math.inf if text == "infinite" else float(text) for text in said.split()]
    np.testing.assert_allclose(written, [each.dof for each in known], rtol=1e-4)
    assert stated.left() == []


def _decision_numbers(
    each: Known, limits: tuple[float | None, float | None] | None
) -> tuple[list[float], list[float]]:
    """Limits of the requirement and of acceptance; probabilities."""
    if limits is None:
        return [], []
    sided = [(limit, side) for limit, side in zip(limits, (-1, 1), strict=True) if limit is not None]
    inside, _, wrong = _decided(each, limits)
    ends = [*(limit for limit, _ in sided), *(each.accepted(limit, side) for limit, side in sided)]
    return ends, [inside, *([] if wrong is None else [wrong]), RISK]


def check(text: str, dcc: bytes, account: Account) -> int:
    """Compare a certificate's page and its DCC with an account; how many numbers of the page these were."""
    numbers = Dcc(etree.fromstring(dcc))
    chosen = chosen_parts(numbers, account)
    check_dcc(numbers, account, account.known(chosen))
    return check_page(text, account, chosen)


def issued(store: Path, details: CertificateDetails, patch: pytest.MonkeyPatch) -> tuple[str, bytes]:
    """Page and DCC of a store; what its model lacks is not asked, for that has tests of its own and takes long."""
    patch.setattr(model_in_force, "_diagnosed", lambda bench, tell: ("", [], ""))
    with opened_workbench(store, ()) as bench:
        content = certificate_of(bench, details, "2026-01-02T03:04:05+00:00", unfinished=True).content
    return page.page(content), document.dcc(content)
