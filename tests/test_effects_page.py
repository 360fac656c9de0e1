"""docs/effects.md lists the catalogue as `rigctl effects --json` gives it, and its example is one that loads."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rigctl.cli.application import app
from rigctl.core.errors import ConfigError
from rigctl.core.experiments import EXPERIMENTS
from rigctl.effects.catalogue import SCOPES
from rigctl.effects.plugins import load
from rigctl.experiments.inflight.model.flight import FlightRun
from rigctl.experiments.sensing_axis.model.chain import Runs

PAGE = (Path(__file__).parent.parent / "docs" / "effects.md").read_text(encoding="utf-8")


def row(effect: dict[str, Any]) -> str:
    sizes = [f"`{name}` {unit} ({effect['typical'][name]:g})" for name, unit in effect["parameters"].items()]
    cells = [
        f"`{effect['id']}`",
        f"`{effect['on']}`",
        ", ".join(sizes),
        effect["scope"].replace("-", " and "),
        ", ".join(effect["needs"]) or "-",
        effect["summary"],
    ]
    return f"| {' | '.join(cells)} |"


def section(title: str) -> str:
    return PAGE.split(f"# {title}\n", 1)[1].split("\n#", 1)[0]


def test_the_catalogue_is_listed_as_the_command_gives_it() -> None:
    found = json.loads(CliRunner().invoke(app, ["effects", "--json"]).stdout)
    for experiment in dict.fromkeys(each["experiment"] for each in found):
        table = PAGE.split(f"<!-- effects: {experiment} -->\n", 1)[1].split("\n\n", 1)[0]
        assert table.splitlines()[2:] == [row(each) for each in found if each["experiment"] == experiment]


def test_points_scopes_and_fields_are_those_there_are() -> None:
    points = re.findall(r"^\| `(\w+)` \|", section("Points of the chain").split("|---", 1)[1], re.MULTILINE)
    assert points == [point for each in EXPERIMENTS.values() for point in each.points]
    assert set(re.findall(r'`"([\w-]+)"`', section("Scopes"))) == set(SCOPES)
    first_cells = " ".join(re.findall(r"^\| (.*?) \|", section("What a run has"), re.MULTILINE))
    for name in re.findall(r"`(\w+)", first_cells):
        assert hasattr(Runs, name) or name in Runs.__dataclass_fields__, name
    in_orbit = " ".join(re.findall(r"^\| (.*?) \|", section("What a run in orbit has"), re.MULTILINE))
    for name in re.findall(r"`(\w+)", in_orbit):
        assert hasattr(FlightRun, name) or name in FlightRun.__dataclass_fields__, name


def test_the_example_loads(tmp_path: Path) -> None:
    (example,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    file = tmp_path / "own.py"
    file.write_text(example)
    (found,) = load(file).effects.values()
    assert (found.id, found.on, set(found.parameters)) == ("wheel-3theta", "angle_rad", {"c3", "s3"})


SPOILED = {
    "on = 'sensor_output' is no point of the chain": ('on="angle_rad"', 'on="sensor_output"'),
    "it adds something with its parameters at zero": ("return c3", "return run.signal + c3"),
    "which does not fit run.signal's": ("return c3", "return np.ones(7) * c3"),
    "it returns complex numbers, not real ones": ("return c3", "return 1j * c3"),
    "it returns other numbers when it is called again": ("return c3", "return np.random.rand() * c3"),
    "what it adds does not depend on": (" + s3 * np.sin(3.0 * run.theta)", ""),
    "NameError: name 'np' is not defined": ("import numpy as np\n", ""),
    "is not known": ('"c3": "rad", "s3"', '"c3": "volts", "s3"'),
    "rigctl has an effect of this id; choose another": ('"wheel-3theta"', '"roll-gravity"'),
}


@pytest.mark.parametrize("message", SPOILED)
def test_messages_are_those_of_the_program(message: str, tmp_path: Path) -> None:
    (example,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    old, new = SPOILED[message]
    assert old in example
    file = tmp_path / "own.py"
    file.write_text(example.replace(old, new))
    with pytest.raises(ConfigError) as refused:
        load(file)
    assert message in str(refused.value)
    assert message in section("What messages mean")
