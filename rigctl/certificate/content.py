"""What a certificate says, gathered once from a store and kept as JSON; pages are made of that and of nothing else.

Clauses are those of ISO/IEC 17025:2017. Numbers are in full here; pages round them to what their uncertainty allows.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from typing import Any

import numpy as np

from rigctl.analysis.conformity import Knowledge, decide
from rigctl.analysis.measurement_result import Limits, MeasurementResult
from rigctl.campaign.days import first_day, last_day
from rigctl.campaign.item import item_of
from rigctl.campaign.status import status_in
from rigctl.campaign.store.store import Store
from rigctl.certificate.basis import Basis, basis_of
from rigctl.certificate.equipment import Instrument, as_range, instruments_of, recorded_conditions
from rigctl.certificate.excluded import Excluded, excluded_of
from rigctl.certificate.model_in_force import model_in_force
from rigctl.core.errors import ConfigError, DataError
from rigctl.experiments.analysis import measurement_result_of
from rigctl.files.certificate_file import CertificateDetails
from rigctl.files.item import Item
from rigctl.workbench.workbench import Workbench

FORMAT = "rigctl-certificate 1"
COVERAGE_PERCENT = 95

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Certificate:
    """A certificate as JSON, `content`, with the hash of what it rests on in it."""

    content: Mapping[str, Any]

    @property
    def number(self) -> str:
        """Its own number."""
        return str(self.content["number"])

    @property
    def item(self) -> Item:
        """What was calibrated."""
        return Item.model_validate(self.content["item"])


def certificate_of(
    bench: Workbench,
    details: CertificateDetails,
    issued: str,
    *,
    unfinished: bool = False,
    tell: Tell = lambda _: None,
) -> Certificate:
    """The certificate of a store with its current model; `issued` is UTC, ISO 8601.

    `DataError` for a campaign that is not over, unless `unfinished` is wanted; `ConfigError` for a requirement on a
    quantity that is not among the results; `DataError`, `ProcedureError` where there is no result.
    """
    store = bench.store
    state = _state(store, unfinished=unfinished)
    details = details.model_copy(update={"item": _item(store, details)})
    dates = _dates(store, details)
    tell("working out the result")
    result = measurement_result_of(bench)
    tell("judging the model")
    model = model_in_force(bench, tell)
    excluded = excluded_of(bench, result, tell)
    tell("hashing what it rests on")
    basis = basis_of(store, bench.current)
    equipment = instruments_of(store)
    quantities = _quantities(result, details)
    recorded = recorded_conditions(store)
    content = {
        "format": FORMAT,
        "number": details.number or _number(basis, issued),
        "issued": issued,
        "software": {"name": "rigctl", "version": importlib.metadata.version("rigctl")},
        "title": store.header.title.strip() or store.path.name,
        "experiment": store.header.experiment,
        "simulated": store.header.world_sha256 is not None,
        **_administration(details),
        "dates": dates,
        "method": details.method or result.method,
        "conditions": {**{name: as_range(*ends) for name, ends in recorded.items()}, **details.conditions},
        "recorded": {name: list(ends) for name, ends in recorded.items() if name not in details.conditions},
        "constants": dict(store.header.constants),
        "instruments": [asdict(each) for each in equipment],
        "quantities": quantities,
        "covariance": result.covariance.tolist(),
        "budget": _budget(result),
        "model": model,
        "excluded": excluded.as_json(),
        "traceability": details.traceability,
        "warnings": _warnings(store, state, model if result.of_model else {}, equipment, excluded),
        "remarks": [*result.remarks, *details.remarks],
        "not_stated": _not_stated(details, dates),
        "details_sha256": hashlib.sha256(details.text.encode()).hexdigest() if details.text else None,
        "basis": basis.as_json(),
        "basis_sha256": basis.sha256,
    }
    return Certificate(content)


def _state(store: Store, *, unfinished: bool) -> str:
    """How a campaign stands, "" where it is done; `DataError` where that is not enough."""
    status = status_in(store)
    if status["state"] == "done":
        return ""
    said = f"the campaign is {status['state']} after {status['runs_done']} of {status['runs_planned']} runs"
    if not unfinished:
        raise DataError(f"{store.path}: {said}; `rigctl resume` it first, or certify what there is with --unfinished")
    return said


def _item(store: Store, details: CertificateDetails) -> Item:
    """What the details say of the item, and the store of what they leave open; `ConfigError` for another item."""
    known, said = item_of(store), details.item
    if known.serial and said.serial and known.serial != said.serial:
        raise ConfigError(
            f"{details.path}: item.serial is {said.serial}, and {store.path} is the calibration of {known.serial}; "
            "take the store or the details of the other item"
        )
    return Item.model_validate({**known.stated, **said.stated})


def _number(basis: Basis, issued: str) -> str:
    """Two certificates on the same data have different numbers where they were issued at different times."""
    digest = hashlib.sha256(f"{basis.sha256} {issued}".encode()).hexdigest()
    return f"RC-{issued[:10].replace('-', '')}-{digest[:8]}"


def _administration(details: CertificateDetails) -> dict[str, Any]:
    return {
        "laboratory": details.laboratory.model_dump(mode="json"),
        "customer": details.customer.model_dump(mode="json"),
        "item": details.item.model_dump(mode="json"),
        "place": details.place,
        "persons": [each.model_dump(mode="json") for each in details.persons],
    }


def _dates(store: Store, details: CertificateDetails) -> dict[str, str | None]:
    """Days of reception and of calibration; a bundle does not always say when it was measured.

    `ConfigError` for an item that was received after that.
    """
    began, received = first_day(store) or _day(details.began), _day(details.item.received)
    if began and received and received > began:
        raise ConfigError(
            f"{details.path or store.path}: item.received is {received}, and the calibration began on {began}; "
            "correct received in the file of --details"
        )
    return {
        "received": received,
        "began": began,
        "ended": last_day(store, _day(details.ended) or "") or began,
    }


def _day(day: date | None) -> str | None:
    return None if day is None else day.isoformat()


def _quantities(result: MeasurementResult, details: CertificateDetails) -> list[dict[str, Any]]:
    wanted = _limits(result, details)
    u, dof, k, intervals = (
        result.standard_uncertainty,
        result.effective_dof,
        result.coverage_factor,
        result.coverage_interval,
    )
    found = []
    for place, each in enumerate(result.quantities):
        limits = wanted.get(each.name, each.limits)
        known = Knowledge(each.value, float(u[place]), float(dof[place]), each.kind, each.unbiased)
        decided = limits and decide(known, limits, details.decision.rule, details.decision.largest_risk)
        mean = each.kind == "mean"
        found.append(
            {
                "name": each.name,
                "group": each.group,
                "kind": each.kind,
                "complex": each.complex,
                "unit": details.units.get(each.name, each.unit),
                "value": each.value,
                "standard_uncertainty": float(u[place]),
                "effective_dof": _finite(dof[place]),
                "coverage_factor": float(k[place]) if mean else None,
                "expanded_uncertainty": float(k[place] * u[place]) if mean else None,
                "coverage_interval": intervals[place].tolist(),
                "conformity": _conformity(decided) if decided else None,
            }
        )
    return found


def _limits(result: MeasurementResult, details: CertificateDetails) -> dict[str, Limits]:
    units = {each.name: each.unit for each in result.quantities}
    for name in (*(each.quantity for each in details.requirements), *details.units):
        if name not in units:
            raise ConfigError(
                f"{details.path}: there is no quantity {name!r} in this result; one of {', '.join(units)}"
            )
    for name, unit in details.units.items():
        # A name in place of another would change the quantity, not convert it.
        if units[name] not in ("", unit):
            raise ConfigError(f"{details.path}: the unit of {name!r} is {units[name]}; take it out of `units`")
    return {each.quantity: Limits(each.lower, each.upper, each.source) for each in details.requirements}


def _conformity(decided: Any) -> dict[str, Any]:
    return {
        **asdict(decided),
        "false_accept": decided.false_accept,
        "false_reject": decided.false_reject,
    }


def _budget(result: MeasurementResult) -> list[dict[str, Any]]:
    """Every source with its part of the standard uncertainty of each quantity, in that quantity's unit."""
    return [
        {
            "name": each.name,
            "type": each.type,
            "dof": _finite(each.dof),
            "input": each.input,
            "origin": each.origin,
            "standard_uncertainty": each.standard_uncertainty.tolist(),
        }
        for each in result.sources
    ]


def _warnings(
    store: Store, state: str, model: Mapping[str, Any], equipment: Sequence[Instrument], excluded: Excluded
) -> list[str]:
    """What a reader must not overlook."""
    found = []
    if store.header.world_sha256 is not None:
        found.append("Measured on simulated instruments: no item was calibrated, and this certifies none.")
    if state:
        found.append(f"Unfinished: {state}.")
    if inadequate := model.get("inadequate"):
        found.append(f"{inadequate} The stated uncertainties do not cover that.")
    if stated := model.get("stated_sigma"):
        found.append(stated)
    found += [f"{each.name}: {warning}." for each in equipment for warning in each.warnings]
    if excluded.worst_shift is not None and excluded.worst_shift > 1.0:
        found.append("The excluded runs change a result by more than its expanded uncertainty.")
    return found


def _not_stated(details: CertificateDetails, dates: Mapping[str, str | None]) -> list[str]:
    """What ISO/IEC 17025 asks for and nobody has said, with its clause."""
    asked = {
        "laboratory (7.8.2.1 b)": details.laboratory.name,
        "place of the calibration (7.8.2.1 c)": details.place,
        "customer (7.8.2.1 e)": details.customer.name,
        "calibrated item (7.8.2.1 g)": details.item.name,
        "serial number of the item (7.8.2.1 g)": details.item.serial,
        "date of the calibration (7.8.2.1 i)": dates["began"],
        "who authorises it (7.8.2.1 o)": details.persons,
        "traceability (7.8.4.1 c)": details.traceability,
    }
    return [what for what, said in asked.items() if not said]


def _finite(value: Any) -> float | None:
    """JSON has no infinity: None is infinitely many degrees of freedom."""
    return float(value) if np.isfinite(value) else None
