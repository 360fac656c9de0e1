"""What an experiment says of itself: ours and others' in the same way, each reference leading somewhere."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from procedures.campaigns import Campaigns, campaigns_of, plan_of
from rigctl.campaign.layout import Layout, layout_of
from rigctl.console.form import entries
from rigctl.core import entry_points as registered
from rigctl.core.additions import EFFECTS, PROCEDURES
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.experiments import CONTRACT, EXPERIMENTS, REGISTRY, Experiments, experiment_named
from rigctl.effects.catalogue import catalogue
from rigctl.experiments.analysis import Analysis, analysis_of
from rigctl.files.campaign_file import parse_campaign, settings_of
from rigctl.report.drawn import Drawing, drawing_of

ROOT = Path(__file__).parents[2]
OURS = ["sensing-axis", "rotating-platform", "inflight-calibration", "table", "frequency-response"]

MODULE = f"""\
from typing import Literal

from rigctl.core.additions import Effects, Procedure
from rigctl.core.experiments import Experiment
from rigctl.core.file_tables import Table
from rigctl.files.toml_files import validated

TUMBLE = Experiment("tumble-test", "lab", "lab", ("tumble_v",), "lab:run")
TABLE = Experiment("table", "lab", "lab", ("twin_v",), "lab:run")
FUTURE = Experiment("future", "lab", "lab", ("future_v",), "lab:run", contract={CONTRACT + 1})

SLOW = Procedure("sensing-axis", "slow-scan", "lab:Slow", "lab:slow")
MAGNET = Effects("lab-magnet", "sensing-axis", "lab_effects")
OLD = Effects("lab-old", "sensing-axis", "lab_effects", contract=0)


class Slow(Table):
    name: Literal["slow-scan"]
    hours: float = 2.0


def slow(campaign, part, plugins):
    return validated(Slow, campaign.procedure, campaign.path, "procedure")
"""

EFFECTS_MODULE = """\
from rigctl.effects import effect


@effect("lab-magnet", on="WHERE", parameters={"size": "V"}, typical={"size": 1e-3})
def magnet(run, size):
    return size * run.signal
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of another laboratory, installed."""
    (tmp_path / "lab.py").write_text(MODULE)
    (tmp_path / "lab_effects.py").write_text(EFFECTS_MODULE.replace("WHERE", "sensor_output_v"))
    about = tmp_path / "lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    points = "tumble-test = lab:TUMBLE\ntable = lab:TABLE\nfuture = lab:FUTURE\n"
    added = f"[{PROCEDURES.group}]\nsensing-axis.slow-scan = lab:SLOW\n"
    added += f"[{EFFECTS.group}]\nlab-magnet = lab:MAGNET\nlab-old = lab:OLD\n"
    (about / "entry_points.txt").write_text(f"[{REGISTRY.group}]\n{points}{added}")
    monkeypatch.syspath_prepend(tmp_path)
    registered._points.cache_clear()
    yield tmp_path
    for module in ("lab", "lab_effects"):
        sys.modules.pop(module, None)
    registered._points.cache_clear()


def test_ours_are_registered_as_those_of_others_and_each_reference_leads_somewhere() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    assert list(EXPERIMENTS) == list(listed[REGISTRY.group]) == OURS
    for each in EXPERIMENTS.values():
        parts = {Analysis: analysis_of(each.id), Drawing: drawing_of(each.id)}
        if each.campaign:
            parts[Campaigns] = campaigns_of(each.id)
        for protocol, module in parts.items():
            assert {name for name in vars(protocol) if not name.startswith("_")} <= set(dir(module))
        assert isinstance(layout_of(each.id), Layout) == bool(each.columns)
        for reference in (each.trial_run, each.signature, *each.tables.values()):
            assert not reference or each.load(reference) is not None
    points = [point for each in EXPERIMENTS.values() for point in each.points]
    assert len(points) == len(set(points))


def test_what_another_package_installs_is_there_and_of_two_of_one_name_there_is_none(lab: Path) -> None:
    found = Experiments()
    assert list(found) == [*OURS[:3], OURS[4], "tumble-test"]
    assert found["tumble-test"].points == ("tumble_v",)
    with pytest.raises(DataError, match=r"'table' is registered by rigctl .* and lab .*; uninstall one"):
        experiment_named("table")
    with pytest.raises(ConfigError, match=f"'future' of lab was written for contract {CONTRACT + 1}"):
        parse_campaign('experiment = "future"\n[procedure]\n', Path("a.toml"))


def test_another_package_adds_effects_to_an_experiment_behind_its_own(lab: Path) -> None:
    found = list(catalogue("sensing-axis"))
    assert found[-1] == "lab-magnet"
    assert "roll-gravity" in found
    assert "lab-magnet" not in catalogue("rotating-platform")
    assert EFFECTS.flaws() == [
        "rigctl.effects 'lab-old' of lab was written for contract 0, this program has 1; "
        "install the versions that belong together"
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            EFFECTS_MODULE.replace("WHERE", "force_m_s2"),
            "acts on 'force_m_s2'; sensing-axis has motion_m",
        ),
        ("import nowhere", r"cannot be imported \(ModuleNotFoundError: No module named 'nowhere'\)"),
    ],
)
def test_installed_effects_that_cannot_be_used_are_named_in_one_line(lab: Path, text: str, words: str) -> None:
    (lab / "lab_effects.py").write_text(text)
    with pytest.raises(ConfigError, match=f"^effects 'lab-magnet'.*{words}[^\n]*$"):
        catalogue("sensing-axis")
    assert catalogue("rotating-platform")


def test_another_package_adds_a_procedure_to_an_experiment(lab: Path) -> None:
    text = 'experiment = "sensing-axis"\nrig = "r.toml"\n[procedure]\nname = "slow-scan"\nhours = 3\n'
    campaign = parse_campaign(text, lab / "a.toml")
    assert settings_of(campaign.experiment, campaign.procedure)["procedure"].__name__ == "Slow"
    assert plan_of(campaign, None, ()).hours == 3.0  # type: ignore[attr-defined]
    choices = next(each for each in entries(text) if (each.table, each.key) == ("procedure", "name")).choices  # type: ignore[union-attr]
    assert choices[-1] == "slow-scan"
    with pytest.raises(ConfigError, match=r"procedure\.hours"):
        plan_of(parse_campaign(text.replace("3", '"x"'), lab / "a.toml"), None, ())


def test_what_ours_add_is_registered_as_that_of_others() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    for registry in (EFFECTS, PROCEDURES):
        assert list(registry.names()) == list(listed[registry.group])
        assert registry.flaws() == []
    procedures = [PROCEDURES.get(name) for name in PROCEDURES.names()]
    assert all(registered.resolved(text, "ours") for each in procedures for text in (each.table, each.plan))


def test_an_experiment_that_is_not_there_is_refused() -> None:
    with pytest.raises(DataError, match=r"a\.db: unknown rigctl\.experiments 'tumble-test'; one of"):
        analysis_of("tumble-test", "a.db")


def test_no_campaign_measures_a_table() -> None:
    with pytest.raises(ConfigError, match=r"a\.toml: a 'table' is imported, not measured; use `rigctl import`"):
        campaigns_of("table", "a.toml")
