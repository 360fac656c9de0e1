"""What an experiment says of itself: ours and others' in the same way, each reference leading somewhere."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from procedures.campaigns import Campaigns, campaigns_of
from rigctl.campaign.bundle.layout import Layout, layout_of
from rigctl.core import entry_points as registered
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.experiments import CONTRACT, EXPERIMENTS, REGISTRY, Experiments, experiment_named
from rigctl.experiments.analysis import Analysis, analysis_of
from rigctl.files import config
from rigctl.report.drawn import Drawing, drawing_of

ROOT = Path(__file__).parents[2]
OURS = ["sensing-axis", "rotating-platform", "inflight-calibration", "table"]

MODULE = f"""\
from rigctl.core.experiments import Experiment

TUMBLE = Experiment("tumble-test", "lab", "lab", ("tumble_v",), "lab:run")
TABLE = Experiment("table", "lab", "lab", ("twin_v",), "lab:run")
FUTURE = Experiment("future", "lab", "lab", ("future_v",), "lab:run", contract={CONTRACT + 1})
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of another laboratory, installed."""
    (tmp_path / "lab.py").write_text(MODULE)
    about = tmp_path / "lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    points = "tumble-test = lab:TUMBLE\ntable = lab:TABLE\nfuture = lab:FUTURE\n"
    (about / "entry_points.txt").write_text(f"[{REGISTRY.group}]\n{points}")
    monkeypatch.syspath_prepend(tmp_path)
    registered._points.cache_clear()
    yield tmp_path
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
        for reference in (
            each.trial_run,
            each.effects,
            each.signature,
            *each.tables.values(),
            *each.procedures.values(),
        ):
            assert not reference or each.load(reference) is not None
    points = [point for each in EXPERIMENTS.values() for point in each.points]
    assert len(points) == len(set(points))


def test_what_another_package_installs_is_there_and_of_two_of_one_name_there_is_none(lab: Path) -> None:
    found = Experiments()
    assert list(found) == [*OURS[:3], "tumble-test"]
    assert found["tumble-test"].points == ("tumble_v",)
    with pytest.raises(DataError, match=r"'table' is registered by rigctl .* and lab .*; uninstall one"):
        experiment_named("table")
    with pytest.raises(ConfigError, match=f"'future' of lab was written for contract {CONTRACT + 1}"):
        config.parse_campaign('experiment = "future"\n[procedure]\n', Path("a.toml"))


def test_an_experiment_that_is_not_there_is_refused() -> None:
    with pytest.raises(DataError, match=r"a\.db: unknown rigctl\.experiments 'tumble-test'; one of"):
        analysis_of("tumble-test", "a.db")


def test_no_campaign_measures_a_table() -> None:
    with pytest.raises(ConfigError, match=r"a\.toml: a 'table' is imported, not measured; use `rigctl import`"):
        campaigns_of("table", "a.toml")
