"""The documentation says what the program does: commands, keys, defaults, links and examples are held to the code."""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from typer.testing import CliRunner

from drivers.aerotech_settings import EnsembleSettings, SoloistSettings, StageSettings
from drivers.drag_free_satellite import SatelliteLimits
from drivers.keyence_settings import KeyenceSettings
from drivers.keysight_3458a import Meter3458ASettings
from drivers.keysight_33500b import SourceSettings
from drivers.keysight_settings import ThermometerSettings, VoltmeterSettings
from drivers.newport_esp301 import Esp301Settings
from drivers.newport_xps import XpsSettings
from drivers.pi_gcs2 import GcsSettings
from drivers.rotation_settings import RotationSettings
from procedures.frequency_response import tables as response_tables
from procedures.inflight.tables import Calibration, MonteCarlo
from procedures.rotating_platform import tables as platform_tables
from procedures.sensing_axis.tables import ListedRun, Procedure, Targets
from rigctl.cli.application import app
from rigctl.effects.catalogue import catalogue
from rigctl.files import package
from rigctl.files.campaign_file import CampaignFile, ModelTable, ReferenceTable
from rigctl.files.item import Item
from rigctl.files.rig_file import Certificate, Constant, InstrumentTable, OperatorTable, RigTable
from rigctl.rig import DRIVERS, simulator_of
from simulators import faults
from simulators.aerotech_ensemble import EnsembleDialect, EnsembleSimulatorSettings
from simulators.aerotech_ensemble.dialect import StageDialect
from simulators.aerotech_soloist import SoloistDialect, SoloistSimulatorSettings
from simulators.keyence_lkg import Lkg3001Dialect, Lkg3001Settings, Lkg5000Settings
from simulators.keysight_3458a import Meter3458ADialect, Meter3458ASimulatorSettings
from simulators.keysight_33500b import GeneratorSettings
from simulators.keysight_34465a import MeterSettings
from simulators.newport_esp301 import Esp301SimulatorSettings
from simulators.newport_esp301.settings import Esp301Dialect
from simulators.newport_xps import XpsSimulatorSettings
from simulators.pi_gcs2 import Gcs2Dialect, Gcs2SimulatorSettings
from simulators.worlds import bench_settings as world
from simulators.worlds import platform_effects, shaken_sensor
from simulators.worlds import platform_settings as platform
from simulators.worlds.effect_sizes import EFFECTS, Scope
from simulators.worlds.satellite import effect_ids
from simulators.worlds.satellite import settings as satellite
from simulators.worlds.satellite.declaration import NoSettings

ROOT = Path(__file__).parent.parent
DOCS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
IDS = [str(path.relative_to(ROOT)) for path in DOCS]

FILE_FIELDS = {"path", "text"}
TABLES: dict[str, tuple[type[BaseModel], set[str]]] = {
    "rig": (RigTable, set()),
    "instruments.NAME": (InstrumentTable, set()),
    "rotation stages": (RotationSettings, set()),
    "newport-xps": (XpsSettings, set(RotationSettings.model_fields)),
    "newport-esp301": (Esp301Settings, set(RotationSettings.model_fields)),
    "pi-gcs2": (GcsSettings, set(RotationSettings.model_fields)),
    "aerotech stages": (StageSettings, set()),
    "aerotech-ensemble": (EnsembleSettings, set(StageSettings.model_fields)),
    "aerotech-soloist": (SoloistSettings, set(StageSettings.model_fields)),
    "keyence": (KeyenceSettings, {"generation"}),
    "voltmeter": (VoltmeterSettings, set()),
    "keysight-3458a": (Meter3458ASettings, set()),
    "thermometer": (ThermometerSettings, set()),
    "source": (SourceSettings, set()),
    "satellite": (SatelliteLimits, set()),
    "lasers.NAME": (package.HeadSettings, set()),
    "package": (package.Package, set()),
    "package.configurations.NAME": (package.ConfigurationSettings, set()),
    "package.uoaf_directions": (package.MeasuredDirection, set()),
    "package.axes.NAME": (package.AxisSettings, set()),
    "package.axes.NAME.sensor.CONFIGURATION": (package.SensorSettings, set()),
    "constants.NAME": (Constant, set()),
    "certificates.NAME": (Certificate, set()),
    "operator": (OperatorTable, set()),
    "world": (world.BenchSettings, set()),
    "world.sensors.NAME": (world.SensorSettings, set()),
    "world.sensors.NAME.CONFIGURATION": (world.SensorConfiguration, set()),
    "world.lasers.NAME": (world.LaserSettings, set()),
    "world.ground": (world.GroundNoiseSettings, set()),
    "world.temperature": (world.TemperatureSettings, set()),
    "world.angle": (world.AngleSettings, set()),
    "platform world": (platform.PlatformSettings, set()),
    "platform chain": (platform.ChainSettings, set()),
    "platform servo": (platform.ServoSettings, set()),
    "platform chain noise": (platform.ChainNoiseSettings, set()),
    "platform pendulum noise": (platform.PendulumNoiseSettings, set()),
    "platform adc": (platform.AdcSettings, set()),
    "shaken world": (shaken_sensor.ShakenSettings, set()),
    "shaken world.sensor": (shaken_sensor.ShakenSensor, set()),
    "shaken world.lasers.NAME": (shaken_sensor.ShakenHead, set()),
    "satellite world": (satellite.SatelliteSettings, set()),
    "satellite bounds": (satellite.Bounds, set()),
    "satellite noise": (satellite.Noise, set()),
    "satellite loops": (satellite.Loops, set()),
    "satellite drag": (satellite.Drag, set()),
    "satellite temperature": (satellite.Temperature, set()),
    "satellite missing": (satellite.Missing, set()),
    "newport-xps simulator": (XpsSimulatorSettings, set()),
    "newport-esp301 simulator": (Esp301SimulatorSettings, set()),
    "aerotech stages simulator": (EnsembleSimulatorSettings, set()),
    "newport-esp301 dialect": (Esp301Dialect, set()),
    "aerotech stages dialect": (StageDialect, set()),
    "aerotech-ensemble dialect": (EnsembleDialect, set(StageDialect.model_fields)),
    "aerotech-soloist dialect": (SoloistDialect, set(StageDialect.model_fields)),
    "keyence simulator": (Lkg3001Settings, set()),
    "keyence dialect": (Lkg3001Dialect, set()),
    "pi-gcs2 simulator": (Gcs2SimulatorSettings, set()),
    "pi-gcs2 dialect": (Gcs2Dialect, set()),
    "keysight-34465a simulator": (MeterSettings, set()),
    "keysight-3458a simulator": (Meter3458ASimulatorSettings, set()),
    "keysight-3458a dialect": (Meter3458ADialect, set()),
    "keysight-33500b simulator": (GeneratorSettings, set()),
    "faults on the wire": (faults.WireFaults, set()),
    "fault": (faults.Fault, set()),
    "faults of instruments": (faults.InstrumentFaults, {"seed"}),
    "event": (faults.Spell, set()),
    "campaign": (CampaignFile, FILE_FIELDS),
    "item": (Item, set()),
    "procedure": (Procedure, set()),
    "procedure.runs": (ListedRun, set()),
    "response procedure": (response_tables.Procedure, set()),
    "response procedure.runs": (response_tables.ListedRun, set()),
    "platform procedure": (platform_tables.Procedure, set()),
    "platform procedure.runs": (platform_tables.ListedRun, set()),
    "platform procedure.custom": (platform_tables.CustomPattern, set()),
    "calibration": (Calibration, set()),
    "monte-carlo": (MonteCarlo, set(Calibration.model_fields)),
    "targets": (Targets, set()),
    "model": (ModelTable, set()),
    "reference": (ReferenceTable, set()),
}
"""Tables of docs/files.md, the model each describes, and that model's fields it need not name."""
WITHOUT_A_TABLE: set[type[BaseModel]] = {Lkg5000Settings, NoSettings, SoloistSimulatorSettings}
"""They have the keys of another."""


def _doc(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def _rows(text: str, marker: str) -> list[list[str]]:
    """The rows of the Markdown table behind `<!-- marker -->`, header left out."""
    after = text.split(f"<!-- {marker} -->\n", 1)[1]
    table = after.split("\n\n", 1)[0].splitlines()
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table[2:]]


def _documented(marker: str) -> dict[str, str]:
    return {row[0].strip("`"): row[1] for row in _rows(_doc("files.md"), f"table: {marker}")}


def _plain(value: Any) -> Any:
    """A value as a TOML file would give it, with what is left to defaults left out."""
    if isinstance(value, BaseModel):
        return {k: _plain(v) for k, v in value.model_dump(exclude_defaults=True).items()}
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _default_said(cell: str) -> Any:
    if cell in {"required", "none"}:
        return {"required": PydanticUndefined, "none": None}[cell]
    return tomllib.loads(f"value = {cell.strip('`')}")["value"]


@pytest.mark.parametrize("marker", TABLES)
def test_every_key_of_a_file_is_documented_with_its_default(marker: str) -> None:
    model, elsewhere = TABLES[marker]
    fields = {name: field for name, field in model.model_fields.items() if name not in elsewhere}
    documented = _documented(marker)
    assert list(documented) == list(fields)
    for name, field in fields.items():
        assert _default_said(documented[name]) == _plain(field.default), f"{marker}: {name}"


SHARED = {model for model, elsewhere in TABLES.values() if not elsewhere}
"""Whose keys a page lists once, for all that are made from them."""


@pytest.mark.parametrize("marker", [marker for marker, (model, _) in TABLES.items() if SHARED & {*model.__mro__[1:]}])
def test_keys_that_several_have_alike_have_one_default(marker: str) -> None:
    model, elsewhere = TABLES[marker]
    for shared in SHARED & {*model.__mro__[1:]}:
        for name in elsewhere & {*shared.model_fields}:
            assert model.model_fields[name].default == shared.model_fields[name].default, f"{marker}: {name}"


def test_every_table_of_files_md_is_held_to_a_model() -> None:
    markers = set(re.findall(r"<!-- table: (.+?) -->", _doc("files.md")))
    assert markers == {*TABLES, "keyence-lkg5000 simulator"}


def test_every_driver_and_simulator_is_documented() -> None:
    drivers = list(DRIVERS.sound())
    of_drivers = {use.settings for driver in drivers for use in driver.roles.values()}
    of_simulators = {simulator_of(driver).settings for driver in drivers} - WITHOUT_A_TABLE
    assert of_drivers | of_simulators <= {model for model, _ in TABLES.values()}


def test_a_simulated_soloist_has_the_keys_of_an_ensemble() -> None:
    assert set(SoloistSimulatorSettings.model_fields) == set(EnsembleSimulatorSettings.model_fields)


def test_the_lkg5000_differs_from_the_lkg3001_as_documented() -> None:
    differing = {
        name: field.default
        for name, field in Lkg5000Settings.model_fields.items()
        if field.default != Lkg3001Settings.model_fields[name].default
    }
    said = _documented("keyence-lkg5000 simulator")
    assert {name: _default_said(cell) for name, cell in said.items()} == differing


def test_every_effect_of_the_world_is_documented_with_its_parameters_and_scope() -> None:
    scopes = {
        "rig": Scope.RIG,
        "axis": Scope.AXIS,
        "axis and configuration": Scope.AXIS_CONFIGURATION,
        "head": Scope.HEAD,
        "channel": Scope.CHANNEL,
        "mass": Scope.MASS,
    }
    for marker, effects in (
        ("effects", EFFECTS),
        ("platform effects", platform_effects.EFFECTS),
        ("satellite effects", effect_ids.EFFECTS),
    ):
        said = {
            row[0].strip("`"): (tuple(re.findall(r"`(\w+)`", row[1])), scopes[row[2]])
            for row in _rows(_doc("files.md"), marker)
        }
        assert said == {name: (form.parameters, form.scope) for name, form in effects.items()}


def test_effects_of_the_model_are_those_the_campaign_table_names() -> None:
    (row,) = _rows(_doc("files.md"), "table: model")
    assert set(re.findall(r'`"([\w-]+)"`', row[2])) == set(catalogue("sensing-axis"))


@pytest.mark.parametrize("path", DOCS, ids=IDS)
def test_links_lead_somewhere(path: Path) -> None:
    for target in _links(path.read_text(encoding="utf-8")):
        file, _, anchor = target.partition("#")
        linked = (path.parent / file).resolve() if file else path
        assert linked.exists(), f"{path.name}: {target}"
        assert linked.is_relative_to(ROOT), f"{path.name}: {target} leaves the project"
        if anchor:
            assert anchor in _anchors(linked.read_text(encoding="utf-8")), f"{path.name}: {target}"


def _links(text: str) -> Iterator[str]:
    for target in re.findall(r"\]\(([^)\s]+)\)", _without_code(text)):
        if "://" not in target:
            yield target


def _without_code(text: str) -> str:
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))


def _anchors(text: str) -> set[str]:
    titles = re.findall(r"^#+ (.+)$", _without_code(text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_every_page_is_among_the_contents_of_the_site() -> None:
    """`make docs` says it too, but not before everything has been built."""
    linked = set(re.findall(r"\]\(([\w-]+\.(?:md|ipynb))\)", _doc("index.md")))
    pages = {path.name for path in (ROOT / "docs").iterdir() if path.suffix in {".md", ".ipynb"}}
    assert linked == pages - {"index.md"}


def test_the_notebook_keeps_no_outputs() -> None:
    """They are made with every build: decision 075."""
    cells = json.loads(_doc("notebook.ipynb"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert [cell["source"] for cell in code if cell["outputs"] or cell["execution_count"]] == []


@pytest.mark.parametrize("path", DOCS, ids=IDS)
def test_toml_examples_parse(path: Path) -> None:
    for example in re.findall(r"^```toml\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
        tomllib.loads(example)


# Commands


@cache
def _commands() -> dict[str, Any]:
    """The command tree, click's or the one that typer brings along, by full names: "run", "model add"."""
    found: dict[str, Any] = {}
    for name, lazy in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        command = lazy.imported()
        below = getattr(command, "commands", {})
        found |= {f"{name} {part}": each for part, each in below.items()} if below else {name: command}
    return found


def _parsed(words: list[str]) -> tuple[str, list[str]]:
    """The command's full name, and the rest."""
    count = 2 if " ".join(words[:2]) in _commands() else 1
    return " ".join(words[:count]), words[count:]


def _options(command: Any) -> set[str]:
    own = [p for p in command.params if p.param_type_name == "option"]
    return {text for p in own for text in (*p.opts, *p.secondary_opts)} - {"--help"}


def _command_lines(text: str) -> Iterator[tuple[str, bool]]:
    """Commands in shell examples (behind `$ ` in console blocks, every line of sh blocks), and in sentences.

    The second says that the line is complete, so that a shell would take it.
    """
    for kind, block in re.findall(r"^```(console|sh)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            typed = line.removeprefix("$ ") if line.startswith("$ ") else line if kind == "sh" else ""
            typed = typed.split(" #")[0].split(" > ")[0].split(" | ")[0].removesuffix(" &")
            if "rigctl " in f"{typed} " and "=" not in typed.split("rigctl")[0]:
                yield typed[typed.index("rigctl") :], True
    for line in re.findall(r"`(rigctl [^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)):
        yield line, False


@pytest.mark.parametrize("path", DOCS, ids=IDS)
def test_commands_in_examples_can_be_parsed(path: Path) -> None:
    for line, complete in _command_lines(path.read_text(encoding="utf-8")):
        _, *arguments = shlex.split(line)
        if not arguments or arguments in (["--help"], ["--version"]):
            continue
        name, rest = _parsed(arguments)
        assert name in _commands(), line
        command = _commands()[name]
        used = {word for word in rest if word.startswith("--")}
        assert used <= {*_options(command), "--help"}, line
        if complete:
            with command.make_context(name, list(rest)):
                pass


def test_every_command_and_option_is_documented() -> None:
    sections = dict(re.findall(r"^### ([\w ]+)\n(.*?)(?=^##|\Z)", _doc("commands.md"), re.DOTALL | re.MULTILINE))
    commands = _commands()
    assert set(sections) == set(commands)
    for name, command in commands.items():
        options = _options(command)
        assert set(re.findall(r"^\| `(--[\w-]+)`", sections[name], re.MULTILINE)) == options, name
        synopsis = re.search(r"^    (rigctl .+)$", sections[name], re.MULTILINE)
        assert synopsis is not None
        assert set(re.findall(r"--[\w-]+", synopsis[1])) == options, name
        places = [p.metavar for p in command.params if p.param_type_name == "argument"]
        words = re.sub(r"\[--[^\]]*\]|--\S+( [A-Z]+)?", "", synopsis[1]).split()[1 + len(name.split()) :]
        assert [word.strip("[]") for word in words] == places, name


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A directory with the shipped campaigns, as a reader has it, and the reader in it."""
    directory = tmp_path_factory.mktemp("desk")
    (directory / "campaigns").symlink_to(ROOT / "campaigns")
    with contextlib.chdir(directory):
        yield directory


def _run(*arguments: str) -> dict[str, Any]:
    """The JSON document a command prints."""
    found = CliRunner().invoke(app, [*arguments, "--json"])
    assert found.exit_code == 0, found.output
    return dict(json.loads(found.stdout))


@pytest.fixture(scope="module")
def measured(desk: Path) -> str:
    """The store of a shipped campaign."""
    _run("run", "campaigns/one-axis.toml", "--store", "measured.rig.sqlite", "--yes")
    return "measured.rig.sqlite"


def _keys_said(marker: str) -> set[str]:
    return {row[0].strip("`") for row in _rows(_doc("commands.md"), f"json: {marker}")}


def test_keys_of_the_result_are_as_documented(measured: str) -> None:
    result = _run("result", measured)
    assert _keys_said("result") - {"quick_check"} == set(result)
    assert _keys_said("result axes") == set(result["axes"]["Y"])
    assert _keys_said("result budget") == set(result["budget"]["Y"])


def test_keys_of_noise_are_as_documented(measured: str) -> None:
    (of_one_channel,) = _run("noise", measured, "--channel", "accel_v")["series"]
    rows = {
        cell: row[1] for row in _rows(_doc("commands.md"), "json: noise") for cell in re.findall(r"`(\w+)`", row[0])
    }
    assert set(rows) == set(of_one_channel)
    of_one_tau = set(of_one_channel["allan"][0])
    assert of_one_tau <= set(re.findall(r"`(\w+)`", rows["allan"]))
    assert set(of_one_channel["lowest"]) - of_one_tau <= set(re.findall(r"`(\w+)`", rows["lowest"]))
    density = of_one_channel["density"]
    assert {*density, *density["terms"][0]} <= set(re.findall(r"`(\w+)`", rows["density"]))
    assert set(of_one_channel["coefficients"][0]) == set(re.findall(r"`(\w+)`", rows["coefficients"]))


def test_keys_of_a_history_are_as_documented(desk: Path) -> None:
    for year in (2020, 2021, 2022):
        bundle = desk / f"bundle-{year}"
        shutil.copytree(ROOT / "examples" / "pontius", bundle)
        header = bundle / "recording.toml"
        header.write_text(f"started = {year}-03-01T00:00:00Z\n{header.read_text()}\n[item]\nserial = 'LC-7'\n")
        _run("import", str(bundle), "--store", str(desk / f"{year}.rig.sqlite"))
    (desk / "text.rig.sqlite").write_text("no store")
    found = _run("history", str(desk))
    (item,) = found["items"]
    quantity = item["quantities"][0]

    def said(marker: str) -> dict[str, str]:
        rows = _rows(_doc("commands.md"), f"json: {marker}")
        return {cell: row[1] for row in rows for cell in re.findall(r"`(\w+)`", row[0])}

    def inside(text: str) -> set[str]:
        return set(re.findall(r"`(\w+)`", text)) - {"null", "mean", "drift", "spread"}

    assert set(said("history")) == set(found)
    assert inside(said("history")["not_listed"]) == set(found["not_listed"][0])
    of_item, of_quantity = said("history items"), said("history quantities")
    assert set(of_item) == set(item)
    assert inside(of_item["calibrations"]) == set(item["calibrations"][0])
    assert set(of_quantity) == set(quantity)
    assert inside(of_quantity["values"]) == set(quantity["values"][0])
    assert inside(of_quantity["drift"]) == set(quantity["drift"])
    assert inside(of_quantity["consistency"]) == {*quantity["consistency"], *quantity["consistency"]["former"]}


def _json_keys_said(command: str) -> set[str]:
    section = re.search(rf"^### {command}\n(.*?)(?=^##|\Z)", _doc("commands.md"), re.DOTALL | re.MULTILINE)
    assert section is not None
    row = next(line for line in section[1].splitlines() if line.startswith("| `--json`"))
    return set(re.findall(r'"(\w+)"', row))


def test_keys_of_a_run_its_status_and_a_quick_check_are_as_documented(desk: Path) -> None:
    campaign = str(desk / "campaigns" / "quick-check.toml")
    dry = _run("run", campaign, "--dry-run")
    outcome = _run("run", campaign, "--yes")
    assert _json_keys_said("run") == {*outcome, *dry}
    assert _json_keys_said("status") == set(outcome["status"])
    assert "quick_check" in outcome["result"]
    quick = next(row[1] for row in _rows(_doc("commands.md"), "json: result") if row[0] == "`quick_check`")
    assert set(re.findall(r"`(\w+)`", quick)) == set(outcome["result"]["quick_check"])


def test_keys_of_instrument_commands_are_as_documented(desk: Path) -> None:
    rig = str(desk / "campaigns" / "one-axis.rig.toml")
    checked = _run("check", rig)
    assert _json_keys_said("check") == {*checked, *checked["instruments"]["stage"], *checked["findings"][0]}
    assert _json_keys_said("home") == set(_run("home", rig, "stage"))
    assert _json_keys_said("move") == set(_run("move", rig, "stage", "-1.5"))
    assert _json_keys_said("stop") == set(_run("stop", rig))


def test_keys_of_store_commands_are_as_documented(measured: str) -> None:
    assert _json_keys_said("mark") == set(_run("mark", measured, "2", "looked at", "--valid"))
    assert _json_keys_said("export") == set(_run("export", measured, "exported"))
