"""The package as it lies here, installed or not: its entry points are there for the tests of this directory alone."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl import cli, runner
from rigctl.core import entry_points
from rigctl.core.experiments import EXPERIMENTS
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig

HERE = Path(__file__).parent.parent
sys.path.insert(0, str(HERE))

SHORT = ("positions = 24", "positions = 12\ndwell_s = 4.0\nsettle_s = 1.0")


def forget() -> None:
    """What has been read of installed packages."""
    entry_points._points.cache_clear()
    vars(EXPERIMENTS).pop("_by_id", None)


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What pip writes of the package."""
    place = tmp_path_factory.mktemp("site")
    about = place / "tumble_test-0.1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: tumble-test\nVersion: 0.1.0\n")
    groups = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]["entry-points"]
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in points.items()) for group, points in groups.items()]
    (about / "entry_points.txt").write_text("\n".join(lines))
    return place


@pytest.fixture(scope="module", autouse=True)
def installed(site: Path) -> Iterator[None]:
    """The package's entry points, as long as the tests of a file take."""
    sys.path.insert(0, str(site))
    forget()
    yield
    sys.path.remove(str(site))
    forget()


Begin = Callable[..., Callable[[], Path]]


@pytest.fixture
def begin(tmp_path: Path) -> Begin:
    """A shipped campaign and its rig, shortened and changed: what runs it and gives its store."""

    def made(name: str, *changes: tuple[str, str], seed: int = 1) -> Callable[[], Path]:
        for each in (f"{name}.toml", f"{name}.rig.toml"):
            text = (HERE / each).read_text()
            for old, new in (SHORT, *changes):
                text = text.replace(old, new)
            (tmp_path / each).write_text(text)
        campaign = read_campaign(tmp_path / f"{name}.toml")
        rig, store = read_rig(campaign.rig_path), tmp_path / f"{name}-{seed}.rig.sqlite"

        def run() -> Path:
            runner.start(campaign, rig, store, runner.Options(unattended=True, seed=seed))
            return store

        return run

    return made


@pytest.fixture
def rigctl(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """A command in this process; what it prints with --json."""

    def run(*arguments: object) -> Any:
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["rigctl", *map(str, arguments), "--json"])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        told = capsys.readouterr()
        assert not ended.value.code, told.err
        return json.loads(told.out)

    return run
