"""The wheel has everything that the program needs where there is no source tree."""

from __future__ import annotations

import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from rigctl.files.shipped import shipped_campaigns

ROOT = Path(__file__).parents[1]
PACKAGES = ("rigctl", "drivers", "simulators", "procedures")

MODULES = {"pyserial": "serial", "zlib-ng": "zlib_ng", "pyvisa-py": "pyvisa_py"}
"""Dependencies whose module has another name."""

IMPORTED = re.compile(r"^(?:import (?=\w+)|from (?=\w[\w.]* import))(\w+)", re.MULTILINE)
"""The package of an import at a module's top."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    (path,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("dist")), versions=["standard"])
    return zipfile.ZipFile(path)


def test_every_file_of_the_packages_and_every_campaign_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    packaged = [path for package in PACKAGES for path in (ROOT / package).rglob("*")]
    files = {str(path.relative_to(ROOT)) for path in packaged if path.is_file() and "__pycache__" not in path.parts}
    campaigns = {f"rigctl/files/campaigns/{path.name}" for path in (ROOT / "campaigns").iterdir()}
    assert {name for name in wheel.namelist() if ".dist-info/" not in name} == files | campaigns


def test_installed_campaigns_are_found_where_the_wheel_has_them(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path)
    module = tmp_path / "rigctl" / "files" / "shipped.py"
    found: dict[str, object] = {"__file__": str(module)}
    exec(compile(module.read_text(encoding="utf-8"), module, "exec"), found)
    assert found["shipped_campaigns"]() == tmp_path / "rigctl" / "files" / "campaigns"  # type: ignore[operator]
    assert (shipped_campaigns() / "demo.toml").is_file()


def test_what_modules_import_comes_with_the_wheel(wheel: zipfile.ZipFile) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = (*project["dependencies"], *extras["cluster"], *extras["notebook"], *extras["sign"], *extras["files"])
    named = {re.split(r"[<>=!~\[ ]", name)[0].lower() for name in wanted}
    installed = {MODULES.get(name, name) for name in named}
    for name in wheel.namelist():
        if name.endswith(".py"):
            imported = {each.lower() for each in IMPORTED.findall(wheel.read(name).decode())}
            assert imported <= {*installed, *PACKAGES, *sys.stdlib_module_names}, name
