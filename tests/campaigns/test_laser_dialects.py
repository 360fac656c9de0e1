"""Whichever Keyence controllers a bench has, and however their manual has to be read, its axes are the same.

Quick: one null of the flight model with an LK-G5000, and with the LK-G3001 at its hardest and at its easiest. With
`RIGCTL_ALL_PAIRS=1` (`make laser-dialects`): the whole flight-model campaign and the hidden effects, with an LK-G5000
and with each reading of each switch of the LK-G3001's dialect by itself and the hardest together.
"""

from __future__ import annotations

import os
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
from rigctl.files.rig_file import read_rig
from simulators.keyence_lkg.dialect import TARGETS, Lkg3001Dialect

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
WHOLE = pytest.mark.skipif(not os.environ.get("RIGCTL_ALL_PAIRS"), reason="ten minutes: make laser-dialects")

EASIEST = {
    "target": "none-out1-out2-both",
    "count_digits": 0,
    "cycle_digits": 0,
    "status_by_output": False,
    "status_repeats_output": False,
    "values_repeat_output": False,
    "start_delay_s": 0.0,
}
ALONE: dict[str, dict[str, Any]] = {
    **{f"target {target}": {**EASIEST, "target": target} for target in TARGETS},
    **{f"count of {digits}": {**EASIEST, "count_digits": digits} for digits in (5, 6, 7)},
    **{f"cycle of {digits}": {**EASIEST, "cycle_digits": digits} for digits in (1, 2)},
    "status by output": {**EASIEST, "status_by_output": True},
    "status says whose it is": {**EASIEST, "status_by_output": True, "status_repeats_output": True},
    "values say whose they are": {**EASIEST, "values_repeat_output": True},
    "late start": {**EASIEST, "start_delay_s": 0.05},
    "hardest": {},
}
LKG5000 = "LK-G5000"
NULL = (
    'experiment = "sensing-axis"\nrig = "rig.toml"\n[model]\neffects = ["roll-gravity", "resonance"]\n[procedure]\n'
    'name = "null-search"\naxes = ["X"]\nconfigurations = ["pendulum"]\nfrequencies_hz = [0.3, 0.6]\n'
    "noise_check_s = 0.0\namplitude_mm = 5.0\ncoarse_s = 4.0\n"
    "[targets]\ntheta0_sigma_arcsec = 15.0\nnoise_m_s2_rthz = 1e-5\n"
)


def rig_with(lasers: str, rig: str) -> str:
    """The text of a shipped rig with these controllers."""
    text = (CAMPAIGNS / rig).read_text()
    if lasers == LKG5000:
        return text.replace('driver = "keyence-lkg3001"', 'driver = "keyence-lkg5000"\ntiming_pulse_s = 4e-3')
    dialect = ALONE.get(lasers, EASIEST)
    tables = {name: {"simulator": {"dialect": dialect}} for name in ("lasers_a", "lasers_b")}
    return text + "\n" + to_toml({"instruments": tables})


def measured(directory: Path, lasers: str, rig: str, campaign: str) -> Path:
    """The store of a campaign on such a rig."""
    (directory / "rig.toml").write_text(rig_with(lasers, rig))
    (directory / "campaign.toml").write_text(campaign)
    store = directory / "x.rig.sqlite"
    read = read_campaign(directory / "campaign.toml")
    runner.start(read, read_rig(directory / "rig.toml"), store, runner.Options(unattended=True))
    return store


def shipped(name: str) -> str:
    """A shipped campaign, on the rig beside it."""
    text = (CAMPAIGNS / f"{name}.toml").read_text()
    return "\n".join('rig = "rig.toml"' if line.startswith("rig = ") else line for line in text.splitlines())


def test_the_hardest_is_what_the_simulator_does_by_itself() -> None:
    hardest = Lkg3001Dialect()
    # Every switch is at another reading than at its easiest.
    assert all(getattr(hardest, name) != reading for name, reading in EASIEST.items())
    assert set(EASIEST) == set(Lkg3001Dialect.model_fields)


def test_a_null_and_its_motion_are_the_same_with_any_controllers(tmp_path_factory: pytest.TempPathFactory) -> None:
    found = {}
    for lasers in (LKG5000, "hardest", "easiest"):
        (null,) = results.of(measured(tmp_path_factory.mktemp("null"), lasers, "isa-rig.toml", NULL))["nulls"]
        found[lasers] = null
    sigma_arcsec = found[LKG5000]["theta0_sigma_arcsec"]
    for null in found.values():
        assert null["theta0_sigma_arcsec"] == pytest.approx(sigma_arcsec, rel=0.5)
        apart_arcsec = 3600.0 * abs(null["theta0_deg"] - found[LKG5000]["theta0_deg"])
        # Three sigma of the difference of two.
        assert apart_arcsec < 3.0 * np.sqrt(2.0) * sigma_arcsec
        motion = np.linalg.norm(np.subtract(null["vector_coc"], found[LKG5000]["vector_coc"]))
        assert np.degrees(motion) * 3600.0 < 3.0 * np.sqrt(2.0) * sigma_arcsec


@cache
def flight_model(directory: Path, lasers: str) -> dict[str, Any]:
    """The result of the whole flight-model campaign."""
    place = directory / lasers.replace(" ", "-")
    place.mkdir()
    return dict(results.of(measured(place, lasers, "isa-rig.toml", shipped("isa-flight-model"))))


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flight-models")


@WHOLE
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("lasers", ALONE)
def test_the_flight_model_has_the_same_axes(directory: Path, lasers: str) -> None:
    with_edges, with_clocks = (flight_model(directory, each)["axes"] for each in (LKG5000, lasers))
    for axis in "XYZ":
        one, other = with_edges[axis], with_clocks[axis]
        error = np.subtract(one["coc"], other["coc"])
        covariance = np.add(one["covariance"], other["covariance"])
        distance = error @ np.linalg.pinv(covariance, rcond=1e-8, hermitian=True) @ error
        assert distance < 2.0 * stats.f(2, one["vectors"] + other["vectors"] - 4).ppf(0.9973)
        assert other["pass"] is True


@WHOLE
@pytest.mark.timeout(600)
@pytest.mark.parametrize("lasers", [LKG5000, "hardest"])
def test_the_hidden_effects_are_found_with_any_controllers(tmp_path: Path, lasers: str) -> None:
    store = measured(tmp_path, lasers, "hidden-effect-rig.toml", shipped("hidden-effect"))
    with Store.open(store) as opened:
        found = workbench_of(opened).diagnose()
    assert {term.effect for term in found.suggested} == {"quadratic", "cable-hysteresis"}
