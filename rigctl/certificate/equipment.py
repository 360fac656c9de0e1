"""The instruments of a calibration with their own certificates, and the conditions that were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from rigctl.campaign.days import last_day
from rigctl.campaign.stated import certificates_of
from rigctl.campaign.store.store import Store
from rigctl.files.rig_file import Certificate, parse_rig

AMBIENT = ("temperature", "humidity", "pressure")
"""Conditions of runs whose names begin so are the environment's (ISO/IEC 17025, 7.8.4.1 b)."""


@dataclass(frozen=True)
class Instrument:
    """An instrument, or a part of one that has a certificate of its own, by its name in the rig file."""

    name: str
    role: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    certificate: str = ""
    laboratory: str = ""
    certified_serial: str = ""
    calibrated: str = ""
    expires: str = ""
    uncertainty: Mapping[str, float] | None = None
    warnings: tuple[str, ...] = ()


def instruments_of(store: Store) -> list[Instrument]:
    """Every instrument that answered, and every certificate of the rig file, warned of where it does not hold."""
    identities, roles = store.identities(), _roles(store)
    certificates = certificates_of(store.header)
    used = _last_day(store)
    names = dict.fromkeys([*roles, *identities, *certificates])
    return [_instrument(name, roles, identities.get(name, {}), certificates.get(name), used) for name in names]


def recorded_conditions(store: Store) -> dict[str, tuple[float, float]]:
    """The smallest and the largest of what valid runs recorded of their environment, by column."""
    ranges: dict[str, tuple[float, float]] = {}
    for run in store.runs(valid_only=True):
        for name, value in run.conditions.items():
            # Not `isinstance`, which would take True; nan is what nobody recorded.
            if name.startswith(AMBIENT) and type(value) in (int, float) and value == value:
                low, high = ranges.get(name, (value, value))
                ranges[name] = (min(low, value), max(high, value))
    return ranges


def as_range(low: float, high: float) -> str:
    """Two ends as a page shows them."""
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _roles(store: Store) -> dict[str, str]:
    if store.header.rig_toml is None:
        return {}
    return {name: each.role for name, each in parse_rig(store.header.rig_toml, Path("rig file")).instruments.items()}


def _last_day(store: Store) -> date | None:
    try:
        return date.fromisoformat(last_day(store))
    except ValueError:  # a recording from elsewhere may say nothing
        return None


def _instrument(
    name: str, roles: Mapping[str, str], identity: Mapping[str, Any], certified: Certificate | None, used: date | None
) -> Instrument:
    serial = str(identity.get("serial", ""))
    known = certified or Certificate()
    return Instrument(
        name,
        roles.get(name, ""),
        str(identity.get("model", "")),
        serial,
        str(identity.get("firmware", "")),
        known.number,
        known.laboratory,
        known.serial,
        "" if known.calibrated is None else known.calibrated.isoformat(),
        "" if known.expires is None else known.expires.isoformat(),
        None if certified is None else dict(certified.uncertainty),
        tuple(_flaws(serial, known, used)),
    )


def _flaws(serial: str, certified: Certificate, used: date | None) -> list[str]:
    found = []
    if certified.expires is not None and used is not None and used > certified.expires:
        found.append(f"its certificate expired on {certified.expires}, before the last run of {used}")
    if certified.calibrated is not None and used is not None and certified.calibrated > used:
        found.append(f"its certificate is of {certified.calibrated}, after the last run of {used}")
    if certified.serial and serial and certified.serial != serial:
        found.append(f"serial number {serial} answered, its certificate is of {certified.serial}")
    return found
