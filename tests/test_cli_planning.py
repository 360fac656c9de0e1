"""`rigctl next` and `rigctl investigate`: what is recommended can be measured, and what is hidden is found."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from procedures.campaigns import investigable
from procedures.sensing_axis.campaign import set_points
from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError
from rigctl.files.campaign_file import CampaignFile, read_campaign
from rigctl.files.rig_file import RigFile, read_rig
from rigctl.investigate import Settings, investigate
from rigctl.workbench.model import versions

HIDDEN_RIG = Path(__file__).parents[1] / "campaigns" / "hidden-effect-rig.toml"

SCAN = """\
experiment = "sensing-axis"
title = "scan"
rig = "rig.toml"

[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag"]
angles_deg = [-20.0, -1.0, 1.0, 20.0]
frequencies_hz = [0.3, 0.6]
approaches = [1, -1]
dwell_s = 6.0

[model]
effects = ["roll-gravity", "resonance"]
"""


def rig(directory: Path, effects: str) -> Path:
    """The shipped rig with hidden effects of one's own."""
    text = HIDDEN_RIG.read_text(encoding="utf-8")
    path = directory / "rig.toml"
    path.write_text(text[: text.index("[world.effects.cable")] + effects, encoding="utf-8")
    return path


MOST = 15
"""Runs of an investigation: fewer than those of the full scan."""

HYSTERESIS = "[world.effects.cable-hysteresis]\nh = 1e-5\n"


def copied(store: Path, directory: Path) -> Path:
    """A store of one's own, with the truth beside it that its simulators read."""
    for path in store.parent.glob(f"{store.name}*"):
        shutil.copy(path, directory)
    return directory / store.name


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan near the null that reached all angles from one side only, in a directory with its campaign and rig."""
    directory = tmp_path_factory.mktemp("scan")
    rig(directory, HYSTERESIS)
    one_sided = SCAN.replace("approaches = [1, -1]\n", "").replace("20.0", "1.5")
    (directory / "campaign.toml").write_text(one_sided)
    store = directory / "x.rig.sqlite"
    campaign = read_campaign(directory / "campaign.toml")
    runner.start(campaign, read_rig(campaign.rig_path), store, runner.Options(unattended=True))
    return store


@pytest.fixture(scope="module")
def advice() -> dict[str, Any]:
    """What `rigctl next` said of the scan, once it has been asked."""
    return {}


@pytest.fixture
def advised(measured: Path, advice: dict[str, Any], desk: Any) -> tuple[dict[str, Any], Path]:
    """What `rigctl next` says of the scan, and the campaign it writes."""
    written = measured.parent / "next.toml"
    if not advice:
        advice.update(desk.rigctl("next", measured, "--write", written, "--json").json)
    return advice, written


def test_next_promises_and_writes_a_campaign_that_can_be_run(advised: tuple[dict[str, Any], Path], desk: Any) -> None:
    found, written = advised
    assert found["written"] == str(written)
    assert found["purpose"] in {"separate", "reveal", "tighten"}
    assert found["runs"]
    assert {"effect", "from", "lambda", "power"} <= set((found["promises"] + found["cannot_be_separated"])[0])
    document = tomllib.loads(written.read_text())
    assert [run["theta_deg"] for run in document["procedure"]["runs"]] == [r["theta_deg"] for r in found["runs"]]
    assert document["model"]["effects"] == ["roll-gravity", "resonance"]
    plan = desk.rigctl("run", written, "--dry-run", "--json").json
    assert plan["runs_planned"] == len(found["runs"])


def test_the_campaign_goes_on_in_the_same_mounting_or_begins_a_store(
    measured: Path, advised: tuple[dict[str, Any], Path], desk: Any, tmp_path: Path
) -> None:
    found, written = advised
    count = len(found["runs"])
    longer = copied(measured, tmp_path)
    with Store.open(measured, readonly=True) as store:
        before = len(store.runs())
    assert desk.rigctl("run", written, "--store", longer, "--yes", "--json").status == 0
    with Store.open(longer, readonly=True) as store:
        assert len(store.runs()) == before + count
        assert {run.conditions["mounting"] for run in store.runs()} == {1}
    assert desk.rigctl("run", written, "--store", tmp_path / "y.rig.sqlite", "--yes", "--json").status == 0
    with Store.open(tmp_path / "y.rig.sqlite", readonly=True) as store:
        assert len(store.runs()) == count


def test_a_campaign_that_goes_on_takes_neither_rig_nor_seed(measured: Path, desk: Any) -> None:
    more = measured.parent / "kept.toml"
    more.write_text(SCAN.replace('name = "scan"', 'name = "scan"\nmounting = "kept"'))
    desk.rigctl("run", more, "--store", measured, "--seed", 3).refused(2, "leave out --rig and --seed")


TABLE = """\
format = 1
experiment = "table"

[table]
response = "y_mm"
baseline = "b0 + b1 * load_n"
"""


def test_next_of_a_table_says_which_values_to_take_and_writes_nothing(desk: Any, tmp_path: Path) -> None:
    bundle = tmp_path / "bundle"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(TABLE)
    noise = (0.003, -0.001, 0.002, -0.004, 0.0, 0.001, -0.002, 0.004, -0.003, 0.001)
    rows = [f"{load},{0.1 + 0.06 * load + each}" for load, each in zip(range(50, 60), noise, strict=True)]
    (bundle / "readings.csv").write_text("\n".join(["load_n,y_mm", *rows]) + "\n")
    assert desk.rigctl("import", "bundle", "--store", desk.store).status == 0
    found = desk.rigctl("next", desk.store, "--json").json
    assert found["runs"]
    assert found["takes_s"] is None
    loads = [run["load_n"] for run in found["runs"]]
    assert all(48.0 <= load <= 61.0 for load in loads)
    assert max(abs(load - 54.5) for load in loads) > 4.5
    assert "reading" in desk.rigctl("next", desk.store).out
    desk.rigctl("next", desk.store, "--write", "x.toml").refused(2, "no rig of ours", "--write")
    assert not (tmp_path / "x.toml").exists()


def settings(**changes: Any) -> Settings:
    told: list[str] = []
    return Settings(runner.Options(unattended=True), changes.pop("ask", lambda *_: True), told.append, **changes)


def begun(directory: Path, effects: str) -> tuple[CampaignFile, RigFile, Path]:
    (directory / "campaign.toml").write_text(SCAN)
    rig_file = read_rig(rig(directory, effects))
    return read_campaign(directory / "campaign.toml"), rig_file, directory / "x.rig.sqlite"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """An investigation of a rig with a dragging cable, to its end."""
    campaign, rig_file, store = begun(tmp_path_factory.mktemp("investigation"), HYSTERESIS)
    return investigate(campaign, rig_file, store, settings(max_runs=MOST)).as_json(), store


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[CampaignFile, Path]:
    """The same, cut off when it first asked."""
    campaign, rig_file, store = begun(tmp_path_factory.mktemp("interrupted"), HYSTERESIS)

    class Interrupted(Exception):
        pass

    def stop(store: Store, question: str) -> bool:
        raise Interrupted

    with pytest.raises(Interrupted):
        investigate(campaign, rig_file, store, settings(ask=stop, max_runs=MOST))
    return campaign, store


def test_an_investigation_finds_what_is_hidden_with_fewer_runs(found: tuple[dict[str, Any], Path]) -> None:
    outcome, store = found
    assert outcome["added"] == ["cable-hysteresis"]
    assert outcome["verdict"] == "adequate"
    assert outcome["runs"] <= MOST < outcome["full_scan_runs"] == 16
    with Store.open(store, readonly=True) as opened:
        assert versions.current(opened).effects == ("roll-gravity", "resonance", "cable-hysteresis")
        assert len(opened.runs()) == outcome["runs"]
        rounds = [document.data for document in opened.documents("investigation")]
    assert [each["runs"] for each in rounds] == sorted(each["runs"] for each in rounds)
    assert len(rounds) >= 1


def test_what_is_excluded_and_what_is_not_is_said(found: tuple[dict[str, Any], Path]) -> None:
    outcome, _ = found
    open_ = {each["effect"] for each in outcome["sensitivity"] if not each["excluded"]}
    assert all(each["excluded"] == (each["share"] >= 1.0) for each in outcome["sensitivity"])
    assert "cable-hysteresis" not in {each["effect"] for each in outcome["sensitivity"]}
    assert all(effect in outcome["remains"] for effect in open_)
    assert bool(outcome["remains"]) == bool(open_)


def test_the_same_command_again_measures_nothing_more(found: tuple[dict[str, Any], Path], desk: Any) -> None:
    outcome, store = found
    campaign = store.parent / "campaign.toml"
    options = ("--store", store, "--max-runs", outcome["runs"], "--yes", "--json")
    again = desk.rigctl("investigate", campaign, *options).json
    assert {key: again[key] for key in ("runs", "added", "verdict")} == {
        key: outcome[key] for key in ("runs", "added", "verdict")
    }
    assert again["store"] == str(store)


def test_nothing_is_added_against_the_operators_will(interrupted: tuple[CampaignFile, Path], tmp_path: Path) -> None:
    campaign, store = interrupted
    asked: list[str] = []

    def refuse(store: Store, question: str) -> bool:
        asked.append(question)
        return False

    outcome = investigate(campaign, None, copied(store, tmp_path), settings(ask=refuse, max_runs=MOST))
    assert asked == ["Add cable-hysteresis to the model?"]
    assert outcome.added == ()
    assert outcome.runs == 12
    assert outcome.verdict == "effect"
    assert "as you chose: cable-hysteresis" in outcome.remains


def test_interrupted_it_goes_on_to_the_same_runs(
    interrupted: tuple[CampaignFile, Path], tmp_path: Path, found: tuple[dict[str, Any], Path]
) -> None:
    campaign, store = interrupted
    longer = copied(store, tmp_path)
    with Store.open(longer, readonly=True) as opened:
        assert len(opened.runs()) == 12
    investigate(campaign, None, longer, settings(max_runs=MOST))
    with Store.open(longer, readonly=True) as here, Store.open(found[1], readonly=True) as there:
        assert len(here.runs()) > 12
        assert [run.key for run in here.runs()] == [run.key for run in there.runs()]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "scan"', 'name = "null-search"', "of a scan, not of null-search"),
        ('axes = ["X"]', 'axes = ["X", "Y"]', "one mounting"),
    ],
)
def test_only_a_scan_of_one_mounting_is_investigated(desk: Any, old: str, new: str, said: str) -> None:
    desk.rig(of="hidden-effect-rig.toml")
    desk.campaign((old, new), text=SCAN)
    desk.rigctl("investigate", "campaign.toml", "--store", desk.store, "--yes").refused(2, said)
    assert not desk.store.exists()


def test_an_experiment_whose_runs_cannot_be_chosen_is_not_investigated() -> None:
    with pytest.raises(ConfigError, match="cannot choose among the runs of inflight-calibration"):
        investigable(read_campaign(HIDDEN_RIG.with_name("microscope.toml")))


def test_a_store_of_another_campaign_is_not_gone_on_with(measured: Path, desk: Any) -> None:
    desk.rig(of="hidden-effect-rig.toml")
    desk.campaign(('configurations = ["flag"]', 'configurations = ["pendulum"]'), text=SCAN)
    desk.rigctl("investigate", "campaign.toml", "--store", measured, "--yes").refused(2, "another campaign file")


def test_longer_runs_at_the_same_set_points_are_among_the_options(tmp_path: Path) -> None:
    campaign, _, _ = begun(tmp_path, HYSTERESIS)
    points = set_points(campaign)
    assert len(points.full_scan) == 16
    assert {run.settings["dwell_s"] for run in points.options} == {6.0, 18.0}
    assert json.dumps([dict(run.settings) for run in points.options])
