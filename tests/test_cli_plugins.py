"""Campaigns whose model names an effect of the user's own: every command asks for its file, unchanged."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import pytest

from procedures.sensing_axis import scan, sensing_axes
from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, ProcedureError
from rigctl.effects.catalogue import catalogue
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.investigate import Settings, investigate
from rigctl.notebook import Campaign
from rigctl.workbench.model import versions

PLUGIN = '''\
from rigctl.effects import effect


@effect("drag", on="angle_rad", parameters={"drag": "rad"}, typical={"drag": 1e-5})
def drag(run, drag):
    """The cable drags the turntable."""
    return drag * run.approach
'''

SCAN = """\
experiment = "sensing-axis"
title = "scan"
rig = "rig.toml"

[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag"]
angles_deg = [-20.0, -0.7, 0.7, 20.0]
frequencies_hz = [0.3, 0.6]
approaches = [1, -1]
dwell_s = 4.0

[model]
effects = ["roll-gravity", "resonance", "drag"]
"""

SHORT = "[-20.0, -0.7, 0.7, 20.0]", "[2.0]"
MORE = (('name = "scan"', 'name = "scan"\nmounting = "kept"'), SHORT)
"""A short scan that goes on."""

HYSTERESIS = "[world.effects.cable-hysteresis]\nh = 1e-5\n"


@pytest.fixture
def bench(desk: Any) -> Any:
    """A desk with a rig whose cable drags, a scan that names `drag`, and the file that brings it."""
    text = (Path(__file__).parents[1] / "campaigns" / "hidden-effect-rig.toml").read_text()
    (desk.directory / "rig.toml").write_text(text[: text.index("[world.effects.cable")] + HYSTERESIS)
    desk.campaign(text=SCAN)
    (desk.directory / "drag.py").write_text(PLUGIN)
    return desk


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the scan's store is, with what its world hides, once it is measured."""
    return tmp_path_factory.mktemp("scanned")


@pytest.fixture
def measured(bench: Any, scanned: Path) -> Any:
    """The scan in its store."""
    if not any(scanned.iterdir()):
        assert bench.run("--plugin", "drag.py").status == 0
        for each in (bench.store, bench.store.with_name(f"{bench.store.name}.truth.toml")):
            copyfile(each, scanned / each.name)
    copytree(scanned, bench.directory, dirs_exist_ok=True)
    return bench


def test_without_its_file_a_campaign_does_not_begin(bench: Any, wire: Any) -> None:
    for more in ((), ("--dry-run",)):
        bench.run(*more).refused(2, "campaign.toml", "model.effects", "unknown effect 'drag'", "--plugin FILE")
    assert not bench.store.exists()
    assert wire.sent == []
    plan = bench.rigctl("run", "campaign.toml", "--dry-run", "--plugin", "drag.py", "--json").json
    assert plan["effects"] == ["roll-gravity", "resonance", "drag"]


def test_the_first_version_of_the_model_holds_where_its_effects_came_from(bench: Any) -> None:
    assert bench.run("--plugin", "drag.py").status == 0
    first = bench.rigctl("model", "show", bench.store, "--json").json
    digest = hashlib.sha256(PLUGIN.encode()).hexdigest()
    assert first["version"] == 1
    assert first["plugins"] == {"drag": {"path": str(bench.directory / "drag.py"), "sha256": digest}}
    size = bench.rigctl("fit", bench.store, "--plugin", "drag.py", "--json").json["parameters"]["drag"]
    assert size["value"] == pytest.approx(1e-5, abs=5.0 * size["sigma"])
    assert size["value"] > 5.0 * size["sigma"]


COMMANDS = ("result", "compare", "diagnose", "fit", "next", "report --figures f", "model history", "model add")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_evaluates_the_model_asks_for_the_file(measured: Any, command: str) -> None:
    name, *options = command.split(" --")
    words = (*name.split(), measured.store, *(["yaw"] if name == "model add" else []))
    words = (*words, *(word for option in options for word in f"--{option}".split()))
    measured.rigctl(*words).refused(2, "model version 1", "pass --plugin", "drag.py")
    (measured.directory / "drag.py").write_text(PLUGIN + "# looked at again\n")
    measured.rigctl(*words, "--plugin", "drag.py").refused(2, "not with", "as it was")


def test_a_campaign_that_goes_on_asks_for_the_file_before_anything_moves(measured: Any, wire: Any) -> None:
    measured.campaign(*MORE, text=SCAN)
    before = measured.runs()
    measured.run().refused(2, "model version 1", "pass --plugin")
    assert wire.sent == []
    assert measured.run("--plugin", "drag.py").status == 0
    assert measured.runs() == before + 4


def test_an_interrupted_campaign_goes_on_with_the_file_it_began_with(
    bench: Any, wire: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.campaign(SHORT, text=SCAN)
    with monkeypatch.context() as patched:
        patched.setattr(scan.Scan, "measure", broken)
        assert bench.run("--plugin", "drag.py").status == 1
    moved = len(wire.sent)
    bench.rigctl("resume", bench.store, "--yes").refused(2, "model version 1", "pass --plugin")
    (bench.directory / "drag.py").write_text(PLUGIN.replace("The cable", "A cable"))
    bench.rigctl("resume", bench.store, "--yes", "--plugin", "drag.py").refused(2, "as it was")
    assert len(wire.sent) == moved
    (bench.directory / "drag.py").write_text(PLUGIN)
    found = bench.rigctl("resume", bench.store, "--yes", "--plugin", "drag.py", "--json").json
    assert found["status"]["state"] == "done"


def broken(*_: object, **__: object) -> None:
    raise ProcedureError("the stage is stuck")


def test_what_goes_on_is_resumed_with_the_file_it_went_on_with(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the store's model, which the first campaign gave, needs none."""
    bench.campaign((', "drag"', ""), SHORT, text=SCAN)
    assert bench.run().status == 0
    bench.campaign(*MORE, text=SCAN)
    with monkeypatch.context() as patched:
        patched.setitem(sensing_axes._PROCEDURES, "scan", broken)
        assert bench.run("--plugin", "drag.py").status == 1
    bench.rigctl("resume", bench.store).refused(2, "its campaign began with", "drag.py", "pass --plugin")
    assert bench.rigctl("resume", bench.store, "--plugin", "drag.py").status == 0
    assert bench.rigctl("model", "show", bench.store, "--json").json["plugins"] == {}


def test_a_notebook_runs_it_with_the_file_too(bench: Any) -> None:
    campaign = Campaign("campaign.toml")
    with pytest.raises(ConfigError, match="unknown effect 'drag'"):
        campaign.dry_run()
    assert campaign.dry_run(["drag.py"])["runs_planned"] == 16
    found = campaign.run(bench.store, unattended=True, plugins=["drag.py"])
    assert found.fit.result.value("drag") == pytest.approx(1e-5, rel=0.5)


def test_an_investigation_adds_an_effect_of_ones_own_and_says_whose(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = catalogue("sensing-axis").values()
    others = tuple(each for each in known if each.id != "cable-hysteresis")
    monkeypatch.setattr(sys.modules["rigctl.effects.catalogue"], "_installed", lambda experiment: iter(others))
    bench.campaign((', "drag"', ""), text=SCAN)
    plugin = bench.directory / "drag.py"
    campaign = read_campaign(bench.directory / "campaign.toml")
    options = runner.Options(unattended=True, plugins=(plugin,))
    settings = Settings(options, lambda *_: True, lambda _: None, max_runs=14)
    outcome = investigate(campaign, read_rig(campaign.rig_path), bench.store, settings)
    assert outcome.added == ("drag",)
    again = Settings(runner.Options(unattended=True), lambda *_: True, lambda _: None, max_runs=14)
    with pytest.raises(ConfigError, match="model version 2 was made with"):
        investigate(campaign, None, bench.store, again)
    with Store.open(bench.store, readonly=True) as store:
        assert versions.current(store).plugins == {"drag": versions.PluginFile.of(plugin)}


def test_an_investigation_asks_for_the_file_its_campaign_names(bench: Any) -> None:
    command = ("investigate", "campaign.toml", "--store", bench.store, "--max-runs", "12", "--yes", "--json")
    bench.rigctl(*command).refused(2, "drag", "--plugin FILE")
    assert not bench.store.exists()
    found = bench.rigctl(*command, "--plugin", "drag.py").json
    assert found["model"] == {"version": 1, "effects": ["roll-gravity", "resonance", "drag"]}
    bench.rigctl(*command).refused(2, "model version 1", "pass --plugin")


def test_a_plugin_changes_no_effect_that_a_table_has(desk: Any) -> None:
    root = desk.directory / "root.py"
    root.write_text(
        "import numpy as np\nfrom rigctl.effects import effect\n\n\n"
        '@effect("power2[load_lb]", on="response", parameters={"k": "1"}, typical={"k": 1e-4})\n'
        'def root(run, k):\n    """A root."""\n    return k * np.sqrt(np.abs(run.column("load_lb")))\n'
    )
    pontius = Path(__file__).parents[1] / "examples" / "pontius"
    assert desk.rigctl("import", pontius, "--store", desk.store).status == 0
    for command in ("fit", "diagnose"):
        said = "root.py", "power2[load_lb]", "choose another"
        desk.rigctl(command, desk.store, "--plugin", root).refused(2, *said)
