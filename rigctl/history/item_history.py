"""The calibrations of one item, quantity by quantity: values, drift, and whether the newest fits the former ones."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.analysis.measurement_result import Kind as QuantityKind
from rigctl.analysis.measurement_result import Quantity
from rigctl.analysis.repeated import (
    LEVEL,
    Consistency,
    Drift,
    Repeated,
    consistency,
    drift,
    spread_consistency,
    unwrapped,
)
from rigctl.core.arrays import FloatArray
from rigctl.core.units import same_unit
from rigctl.history.calibration import Calibration, Kind
from rigctl.history.kept_result import KeptResult

YEAR_S = 365.25 * 86400.0

TURNS = {"deg": 360.0, "rad": 2.0 * math.pi}
"""Angles in these units are the same after a whole turn."""

_FIRST_ORDER = 3.0
"""Where a component of a direction is less uncertain than so many times its change in second order, the other
components say all that is known of it."""


@dataclass(frozen=True)
class Entry:
    """A quantity as one calibration has it; `independent` is the part of its uncertainty that no other shares."""

    calibration: Calibration
    value: float
    standard_uncertainty: float
    independent: float
    dof: float


@dataclass(frozen=True)
class QuantityHistory:
    """One quantity of an item, oldest first.

    `placed` (n,) are the values with angles moved by whole turns next to each other, `reference` (n,) what the former
    ones say at each time: their mean or their line. `untested` says why there is no `consistency`.
    """

    name: str
    unit: str
    kind: QuantityKind
    entries: tuple[Entry, ...]
    placed: FloatArray
    reference: FloatArray
    drift: Drift | None
    consistency: Consistency | None
    untested: str
    trials: int = 1

    @property
    def p_value_corrected(self) -> float | None:
        """Of the newest, over all quantities of the item that are tested together (Bonferroni)."""
        return None if self.consistency is None else min(self.trials * self.consistency.p_value, 1.0)

    @property
    def disagrees(self) -> bool:
        """Whether the newest disagrees with the former ones."""
        return self.p_value_corrected is not None and self.p_value_corrected < LEVEL

    @property
    def drifts(self) -> bool:
        """Whether all of them together drift."""
        return self.drift is not None and self.trials * self.drift.slope.p_value < LEVEL

    @property
    def former_disagree(self) -> bool:
        """Whether the former ones disagree among each other."""
        return self.consistency is not None and self.trials * self.consistency.former.p_value < LEVEL


@dataclass(frozen=True)
class ItemHistory:
    """Calibrations of one item by one experiment, oldest first, and its quantities."""

    kind: Kind
    calibrations: tuple[Calibration, ...]
    quantities: tuple[QuantityHistory, ...]
    remarks: tuple[str, ...]

    @property
    def name(self) -> str:
        """What the newest calibration calls the item."""
        return self.calibrations[-1].item.name


def histories_of(calibrations: Iterable[Calibration]) -> list[ItemHistory]:
    """All items by serial number and experiment, whatever the order in which their calibrations come."""
    ordered = sorted(calibrations, key=lambda each: (_order(each.kind), each.started, each.store))
    groups = itertools.groupby(ordered, key=lambda each: each.kind)
    return [_history(kind, tuple(members)) for kind, members in groups]


def _order(kind: Kind) -> tuple[str, str, str, bool]:
    return kind.serial, kind.experiment, kind.model, kind.simulated


def _history(kind: Kind, calibrations: tuple[Calibration, ...]) -> ItemHistory:
    quantities = [_quantity(members) for members in _by_quantity(calibrations)]
    trials = sum(each.consistency is not None for each in quantities)
    together = tuple(replace(each, trials=trials) for each in quantities)
    return ItemHistory(kind, calibrations, together, tuple(_remarks(calibrations, quantities)))


@dataclass(frozen=True)
class _Member:
    """A quantity of one calibration, by its place in the result."""

    calibration: Calibration
    result: KeptResult
    place: int

    @property
    def quantity(self) -> Quantity:
        return self.result.quantities[self.place]


def _by_quantity(calibrations: Sequence[Calibration]) -> list[list[_Member]]:
    """The members of every quantity, told apart by name and by unit: a volt is not compared with a millivolt."""
    found: list[list[_Member]] = []
    by_name: dict[str, list[list[_Member]]] = {}
    for calibration in calibrations:
        assert calibration.result is not None
        for place, quantity in enumerate(calibration.result.quantities):
            member = _Member(calibration, calibration.result, place)
            alike = by_name.setdefault(quantity.name, [])
            same = next((each for each in alike if same_unit(each[0].quantity.unit, quantity.unit)), None)
            if same is None:
                same = []
                alike.append(same)
                found.append(same)
            same.append(member)
    return found


def _quantity(members: Sequence[_Member]) -> QuantityHistory:
    quantity = members[-1].quantity
    entries = tuple(_entry(each) for each in members)
    placed = _placed(quantity, entries)
    plain = QuantityHistory(
        quantity.name,
        quantity.unit,
        quantity.kind,
        entries,
        placed,
        np.full(len(entries), placed[-1]),
        None,
        None,
        "",
    )
    if untested := _untested(members, entries):
        return replace(plain, untested=untested)
    if quantity.kind == "spread":
        dof = np.array([each.dof for each in entries])
        tested = spread_consistency(placed, dof)
        return replace(plain, consistency=tested, reference=np.full(len(entries), tested.predicted))
    values = _repeated(members, entries, placed)
    tested = consistency(values)
    return replace(plain, consistency=tested, drift=drift(values), reference=_reference(values, tested))


def _entry(member: _Member) -> Entry:
    result, place = member.result, member.place
    independent, dof = result.independent(place)
    return Entry(
        member.calibration, member.quantity.value, result.standard_uncertainty(place), float(independent), float(dof)
    )


def _placed(quantity: Quantity, entries: Sequence[Entry]) -> FloatArray:
    values = np.array([each.value for each in entries])
    turn = next((turn for unit, turn in TURNS.items() if same_unit(quantity.unit, unit)), None)
    u = np.array([each.standard_uncertainty for each in entries])
    return values if turn is None or quantity.kind != "mean" or not np.all(u > 0.0) else unwrapped(values, u, turn)


def _untested(members: Sequence[_Member], entries: Sequence[Entry]) -> str:
    if len(entries) < 2:
        return "one calibration"
    if not all(each.independent > 0.0 for each in entries):
        return "no uncertainty of its own that another calibration would not share"
    if any(_by_the_others(each) for each in members):
        return "the other components of its direction determine it"
    return ""


def _by_the_others(member: _Member) -> bool:
    quantity, result = member.quantity, member.result
    if quantity.unit != "1" or not quantity.group or quantity.kind != "mean":
        return False
    group = [place for place, each in enumerate(result.quantities) if each.group == quantity.group]
    largest = max(result.standard_uncertainty(place) for place in group if result.quantities[place].kind == "mean")
    return result.standard_uncertainty(member.place) < _FIRST_ORDER * largest**2


def _repeated(members: Sequence[_Member], entries: Sequence[Entry], placed: FloatArray) -> Repeated:
    """With a column for each input that calibrations have in common: a source, of the same equipment."""
    newest = members[-1].calibration.started
    columns: dict[tuple[object, str], FloatArray] = {}
    for row, member in enumerate(members):
        # Of which nothing is known, equipment is no other's.
        equipment = member.calibration.equipment or member.calibration.store
        for source, part in member.result.common(member.place).items():
            columns.setdefault((equipment, source), np.zeros(len(members)))[row] = part
    return Repeated(
        np.array([(each.calibration.started - newest).total_seconds() / YEAR_S for each in members]),
        placed,
        np.array([each.independent for each in entries]),
        np.array([each.dof for each in entries]),
        np.stack(list(columns.values()), axis=1) if columns else np.zeros((len(members), 0)),
    )


def _reference(values: Repeated, tested: Consistency) -> FloatArray:
    line = drift(values.former) if tested.model == "drift" else None
    slope = 0.0 if line is None else line.slope.value
    return np.asarray(tested.predicted + slope * (values.time_a - values.time_a[-1]))


def _remarks(calibrations: Sequence[Calibration], quantities: Sequence[QuantityHistory]) -> Iterator[str]:
    for key in ("name", "manufacturer", "model"):
        # A store that says nothing contradicts nobody.
        stated = [(word, each.store) for each in calibrations if (word := each.item.stated.get(key))]
        first_in = dict(reversed(stated))
        if len(first_in) > 1:
            told = ", ".join(f"{word!r} in {first_in[word]}" for word in dict.fromkeys(word for word, _ in stated))
            yield (
                f"Its {key} is stated as {told}: are these one item? Two items with one serial number are compared "
                "as if they were one; give each a serial number of its own."
            )
    effects = {each.effects for each in calibrations}
    if len(effects) > 1:
        told = "; ".join(sorted(", ".join(each) or "the baseline alone" for each in effects))
        yield f"The models of these calibrations differ ({told}); results may differ by that."
    names = [each.name for each in quantities]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        units = " and ".join(each.unit or "no unit" for each in quantities if each.name == name)
        yield f"{name} is in {units}: not compared with each other."
    if any(each.equipment is None and each.result and each.result.has_common for each in calibrations):
        yield (
            "Of some calibrations nothing says with which equipment they were made: what is uncertain by it is taken "
            "as independent."
        )
