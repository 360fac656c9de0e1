"""nexusformat's own check of our NeXus files: every name and class against the definitions that it brings along."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.cli import main

BUNDLES = Path(__file__).parents[2] / "examples"
NXCHECK = Path(sys.executable).with_name("nxcheck")


def errors_in(path: Path) -> tuple[int, int]:
    """How many errors and warnings nxcheck counts."""
    done = subprocess.run([NXCHECK, "-w", path], capture_output=True, text=True, check=True)
    warnings, errors = (re.search(rf"number of {each}: (\d+)", done.stdout) for each in ("warnings", "errors"))
    assert warnings is not None, done.stdout
    assert errors is not None, done.stdout
    return int(errors[1]), int(warnings[1])


@pytest.fixture(params=["pontius", "unknown-effect"])
def exported(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    store, path = tmp_path / "s.rig.sqlite", tmp_path / "s.nxs"
    import_bundle(BUNDLES / request.param, store).close()
    monkeypatch.setattr(sys, "argv", ["rigctl", "export", str(store), str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    return path


def test_nxcheck_finds_nothing_and_would_find_something(exported: Path, tmp_path: Path) -> None:
    assert errors_in(exported) == (0, 0)
    broken = tmp_path / "broken.nxs"
    shutil.copy(exported, broken)
    with h5py.File(broken, "r+") as file:
        run = file[file.attrs["default"]]
        run["data"].attrs["signal"] = "none"
        run["data"].attrs["axes"] = ["none"]
        run["not a name"] = 1.0
        del run["settings"].attrs["NX_class"]
    assert errors_in(broken) == (3, 2)
