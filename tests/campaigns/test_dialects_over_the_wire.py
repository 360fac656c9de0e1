"""Over real sockets and pseudo-terminals the axes are the same, whichever way the manuals have to be read.

Quick: one null of the flight model with an LK-G5000 and with LK-G3001s, every instrument at its gentlest and all at
their hardest. `make wire-dialects`: the whole flight-model campaign on both, with each reading of each switch by
itself and the hardest of all together, and the hidden effects; RIGCTL_WIRE_DIALECTS names the file that gets a line
of the table in docs/hardware.md for each.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl import results, runner
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.core.toml import to_toml
from rigctl.files.campaign_file import read_campaign
from simulators.aerotech_ensemble import GENTLE, EnsembleDialect
from simulators.keyence_lkg import Lkg3001Dialect
from simulators.newport_xps.settings import XPS_D, XpsSimulatorSettings
from tests.campaigns.lockstep import served
from tests.campaigns.test_laser_dialects import ALONE, CAMPAIGNS, EASIEST, NULL, shipped

TABLE = os.environ.get("RIGCTL_WIRE_DIALECTS")
WHOLE = pytest.mark.skipif(not TABLE, reason="half an hour: make wire-dialects")

LASERS = ("lasers_a", "lasers_b")
FAMILIES = ("LK-G5000", "LK-G3001")
INSTRUMENTS = {
    "XPS": ("rotation",),
    "ESP301": ("rotation",),
    "Ensemble": ("stage",),
    "34465A": ("accelerometer",),
    **dict.fromkeys(FAMILIES, LASERS),
}
"""Who speaks otherwise where a reading of theirs is felt at all."""
Keys = Mapping[str, Any]

LINE_GENTLE = {
    "refusal_names_setting": True,
    "count_digits": 7,
    "mode_return_s": 0.0,
    "mode_settle_s": 0.0,
    "reply_delay_s": 0.0,
}
LINE_HARD = {
    "refusal_names_setting": False,
    "count_digits": 5,
    "mode_return_s": 0.6,
    "mode_settle_s": 0.6,
    "reply_delay_s": 0.005,
}
"""What both controllers' sources leave open of their line."""
METER_GENTLE = {"latency_s": 5e-4}
OLD_METER = {"options": [], "firmware": "A.02.14-02.40-02.14-00.49-02-01"}
METER_HARD: Mapping[str, Keys] = {
    "a reading is the mean over its aperture": {"latency_s": None},
    "a reading stands for its edge": {"latency_s": 0.0},
    "no option DIG, firmware 2": OLD_METER,
}
XPS_HARD = {
    name: getattr(XPS_D, name)
    for name in XpsSimulatorSettings.model_fields
    if getattr(XPS_D, name) != getattr(XpsSimulatorSettings(), name)
}
ESP301_GENTLE = {"baud": 921600, "keypad_lock": True}
ESP301_HARD = {"baud": 19200, "keypad_lock": False}


@dataclass(frozen=True)
class Reading:
    """One way to read the manuals: what the simulators of a rig are told, by instrument."""

    name: str
    of: str
    told: Mapping[str, Keys]


def stage(**hard: Any) -> Keys:
    return {"dialect": {**GENTLE.model_dump(), **hard}}


def lasers(family: str, hard: Keys | None = None, **dialect: Any) -> Keys:
    told = {**LINE_GENTLE, **(hard or {})}
    return {**told, "dialect": {**EASIEST, **dialect}} if family == "LK-G3001" else told


def esp301(**hard: Any) -> Keys:
    return {"dialect": {**ESP301_GENTLE, **hard}}


def gentlest(family: str) -> Reading:
    return Reading("gentlest", "all", {"stage": stage(), "accelerometer": METER_GENTLE, LASERS[0]: lasers(family)})


def hardest(family: str) -> Reading:
    told: dict[str, Keys] = {
        "rotation": XPS_HARD,
        "stage": stage(**EnsembleDialect().model_dump()),
        "accelerometer": {"latency_s": None, **OLD_METER},
        LASERS[0]: lasers(family, LINE_HARD, **Lkg3001Dialect().model_dump()),
    }
    return Reading("hardest", "all", told)


def alone(family: str) -> list[Reading]:
    """Each switch by itself, all others gentle; those that lasers have nothing to do with on the first rig only."""
    rest = gentlest(family).told
    of_lasers = [
        Reading(f"{name} = {value}", family, {**rest, LASERS[0]: lasers(family, {name: value})})
        for name, value in LINE_HARD.items()
    ]
    if family == "LK-G3001":
        return of_lasers + [
            Reading(name, family, {**rest, LASERS[0]: {**LINE_GENTLE, "dialect": dialect}})
            for name, dialect in ALONE.items()
            if name != "hardest" and dialect != EASIEST
        ]
    of_stage = [
        Reading(f"{name} = {value}", "Ensemble", {**rest, "stage": stage(**{name: value})})
        for name, value in EnsembleDialect().model_dump().items()
    ]
    of_xps = [
        Reading(f"{name} = {value}", "XPS", {**rest, "rotation": {name: value}}) for name, value in XPS_HARD.items()
    ]
    of_meter = [
        Reading(name, "34465A", {**rest, "accelerometer": {**METER_GENTLE, **keys}})
        for name, keys in METER_HARD.items()
    ]
    of_esp301 = [
        Reading("gentlest", "ESP301", {**rest, "rotation": esp301()}),
        *(
            Reading(f"{name} = {value}", "ESP301", {**rest, "rotation": esp301(**{name: value})})
            for name, value in ESP301_HARD.items()
        ),
    ]
    return of_lasers + of_stage + of_xps + of_esp301 + of_meter


def rig_with(family: str, reading: Reading, rig: str) -> str:
    """The text of a shipped rig whose simulators read the manuals like this."""
    tables = tomllib.loads((CAMPAIGNS / rig).read_text())
    instruments = tables["instruments"]
    for name, keys in reading.told.items():
        for each in LASERS if name == LASERS[0] else (name,):
            instruments[each].setdefault("simulator", {}).update({k: v for k, v in keys.items() if v is not None})
    instruments["stage"]["oscillate_distance"] = reading.told["stage"]["dialect"]["oscillate_distance"]
    if family == "LK-G5000":
        for name in LASERS:
            instruments[name] |= {"driver": "keyence-lkg5000", "timing_pulse_s": 4e-3}
    if reading.of == "ESP301":
        rotation = instruments["rotation"]
        instruments["rotation"] = {k: v for k, v in rotation.items() if k not in ("group", "positioner")}
        instruments["rotation"]["driver"] = "newport-esp301"
    return to_toml(tables)


@dataclass(frozen=True)
class Measured:
    """What a campaign found, and in a word what was said to each instrument and by it."""

    result: dict[str, Any]
    said: dict[str, str]
    store: Path


def measured(directory: Path, family: str, reading: Reading, rig: str, campaign: str) -> Measured:
    """A campaign over the wire."""
    directory.mkdir(parents=True)
    (directory / "rig.toml").write_text(rig_with(family, reading, rig))
    (directory / "campaign.toml").write_text(campaign)
    store = directory / "x.rig.sqlite"
    with served(directory / "rig.toml", pytest.MonkeyPatch()) as (file, lockstep):
        assert not any(table.simulated for table in file.instruments.values())
        runner.start(read_campaign(directory / "campaign.toml"), file, store, runner.Options(unattended=True))
        said = lockstep.digests()
    return Measured(dict(results.of(store)), said, store)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_null_over_the_wire_is_the_same_at_the_gentlest_and_at_the_hardest(family: str, tmp_path: Path) -> None:
    gentle, hard = (
        measured(tmp_path / each.name, family, each, "isa-rig.toml", NULL)
        for each in (gentlest(family), hardest(family))
    )
    (one,), (other,) = gentle.result["nulls"], hard.result["nulls"]
    sigma_arcsec = np.hypot(one["theta0_sigma_arcsec"], other["theta0_sigma_arcsec"])
    assert other["theta0_sigma_arcsec"] == pytest.approx(one["theta0_sigma_arcsec"], rel=0.5)
    assert 3600.0 * abs(one["theta0_deg"] - other["theta0_deg"]) < 3.0 * sigma_arcsec
    apart_rad = np.linalg.norm(np.subtract(one["vector_coc"], other["vector_coc"]))
    assert 3600.0 * np.degrees(apart_rad) < 3.0 * sigma_arcsec
    # Every instrument but the thermometer, which stays as it is, reads something in another way.
    assert {name for name in gentle.said if gentle.said[name] == hard.said[name]} <= {"rotation", "thermometer"}


@cache
def flight_model(directory: Path, family: str, name: str) -> Measured:
    (reading,) = [each for each in (gentlest(family), hardest(family), *alone(family)) if label(each) == name]
    place = directory / family / name.replace(" ", "-").replace("=", "")
    return measured(place, family, reading, "isa-rig.toml", shipped("isa-flight-model"))


def label(reading: Reading) -> str:
    return f"{reading.of}: {reading.name}"


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flight-models")


READINGS = [
    pytest.param(family, label(reading), id=f"{family}, {label(reading)}")
    for family in FAMILIES
    for reading in (hardest(family), *alone(family))
]


@WHOLE
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("family", "name"), READINGS)
def test_the_flight_model_over_the_wire_has_the_same_axes(directory: Path, family: str, name: str) -> None:
    gentle, found = flight_model(directory, family, "all: gentlest"), flight_model(directory, family, name)
    apart = {}
    for axis in "XYZ":
        one, other = gentle.result["axes"][axis], found.result["axes"][axis]
        error = np.subtract(one["coc"], other["coc"])
        covariance = np.add(one["covariance"], other["covariance"])
        distance = float(error @ np.linalg.pinv(covariance, rcond=1e-8, hermitian=True) @ error)
        assert distance < 2.0 * stats.f(2, one["vectors"] + other["vectors"] - 4).ppf(0.9973)
        assert other["pass"] is True
        apart[axis] = np.sqrt(distance / 2.0)
    of = name.partition(":")[0]
    felt = any(gentle.said[each] != found.said[each] for each in INSTRUMENTS.get(of, gentle.said))
    with Path(str(TABLE)).open("a") as table:
        row = [family, name, f"{apart['X']:.2f}, {apart['Y']:.2f}, {apart['Z']:.2f}", "yes" if felt else "no"]
        table.write(f"| {' | '.join(row)} |\n")


@WHOLE
@pytest.mark.timeout(600)
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("of", [gentlest, hardest])
def test_the_hidden_effects_are_found_over_the_wire(tmp_path: Path, family: str, of: Any) -> None:
    place = tmp_path / "hidden"
    ran = measured(place, family, of(family), "hidden-effect-rig.toml", shipped("hidden-effect"))
    with Store.open(ran.store) as opened:
        found = workbench_of(opened).diagnose()
    assert {term.effect for term in found.suggested} == {"quadratic", "cable-hysteresis"}
