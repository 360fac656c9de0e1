"""What packages register: read late, and what is wrong with one said in one line to those alone who use it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.core import entry_points as registered
from rigctl.core.declarations import DriverDeclaration
from rigctl.core.entry_points import Registry
from rigctl.core.errors import ConfigError
from rigctl.rig import DRIVERS
from simulators.benches import WORLDS

ROOT = Path(__file__).parent.parent.parent
MODULE = """
from rigctl.core.declarations import DriverDeclaration
GOOD = DriverDeclaration("good", 1, {})
TWICE = DriverDeclaration("twice", 1, {})
NEWER = DriverDeclaration("newer", 2, {})
OTHER = DriverDeclaration("another name", 1, {})
"""
REGISTERED = {
    "good": "PACKAGE:GOOD",
    "twice": "PACKAGE:TWICE",
    "newer": "PACKAGE:NEWER",
    "misnamed": "PACKAGE:OTHER",
    "text": "PACKAGE:__name__",
    "absent": "PACKAGE:ABSENT",
    "broken": "broken_PACKAGE:IT",
    "ends": "ending_PACKAGE:IT",
}


@pytest.fixture
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry[DriverDeclaration]]:
    _install(tmp_path, "first", REGISTERED)
    _install(tmp_path, "second", {"twice": "second:TWICE"})
    monkeypatch.syspath_prepend(str(tmp_path))
    registered._points.cache_clear()
    yield Registry("tests.drivers", DriverDeclaration, 1, lambda declaration: declaration.kind)
    registered._points.cache_clear()


def _install(site: Path, package: str, points: dict[str, str]) -> None:
    (site / f"{package}.py").write_text(MODULE)
    (site / f"broken_{package}.py").write_text("import there_is_no_such_module")
    (site / f"ending_{package}.py").write_text("raise SystemExit('bye\\n')")
    meta = site / f"{package}_stage-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}-stage\nVersion: 1.0\n")
    listed = "".join(f"{name} = {value.replace('PACKAGE', package)}\n" for name, value in points.items())
    (meta / "entry_points.txt").write_text(f"[tests.drivers]\n{listed}")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("twice", r"'twice' is registered by first-stage \(first:TWICE\) and second-stage \(second:TWICE\); uninst"),
        ("newer", r"'newer' of first-stage was written for contract 2, this program has 1; install"),
        ("misnamed", r"'misnamed' of first-stage calls itself 'another name'; correct"),
        ("text", r"first:__name__ is no DriverDeclaration; correct the entry point"),
        ("absent", r"cannot be imported \(AttributeError: .*ABSENT.*\); mend or uninstall it"),
        ("broken", r"cannot be imported \(ModuleNotFoundError: .*there_is_no_such_module.*\); mend or uninstall it"),
        ("ends", r"cannot be imported \(SystemExit: bye.*\); mend or uninstall it"),
        ("none", r"unknown tests.drivers 'none'; one of .*good"),
    ],
)
def test_a_bad_package_is_named_in_one_line(drivers: Registry[DriverDeclaration], name: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        drivers.get(name)
    assert "\n" not in str(refused.value)


def test_a_bad_package_stops_nobody_else(drivers: Registry[DriverDeclaration]) -> None:
    assert drivers.get("good").kind == "good"
    assert [each.kind for each in drivers.sound()] == ["good"]
    assert len(drivers.flaws()) == len(REGISTERED) - 1


def test_a_source_tree_has_what_its_own_pyproject_says() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for registry in (DRIVERS, WORLDS):
        assert set(project["entry-points"][registry.group]) <= set(registry.names())
        assert not registry.flaws()


def test_only_what_a_rig_uses_is_imported() -> None:
    code = """
import sys
from pathlib import Path
from rigctl import rig
from rigctl.files.rig_file import parse_rig
rig.Rig(parse_rig('''[rig]
name = "two"
[instruments.a]
driver = "newport-xps"
address = "tcp://127.0.0.1:1"
role = "rotation"
[instruments.b]
driver = "keysight-33500b"
address = "tcp://127.0.0.1:2"
role = "source"
''', Path("two.toml")))
print(*sorted(name for name in sys.modules if name.startswith("drivers.") or name.startswith("simulators.keys")))
"""
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert {"drivers.newport_xps", "drivers.keysight_33500b"} <= set(loaded.stdout.split())
    others = ("aerotech", "keyence", "34465a", "esp301", "satellite", "simulators")
    assert [name for name in loaded.stdout.split() if any(other in name for other in others)] == []
