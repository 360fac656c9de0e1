"""Commands on a terminal that has no signs beyond ASCII, or beyond Latin-1."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.campaign.bundle.bundle import import_bundle

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"


def printed(encoding: str, *arguments: str) -> str:
    command = [sys.executable, "-m", "rigctl", *arguments]
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "TERM": "dumb", "LC_ALL": "C"}
    ended = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.decode(encoding)


@pytest.fixture(scope="module")
def pontius(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A store with an uncertainty to print."""
    store = tmp_path_factory.mktemp("pontius") / "x.rig.sqlite"
    import_bundle(PONTIUS, store).close()
    return str(store)


@pytest.mark.parametrize(("encoding", "sign"), [("ascii", "+-"), ("latin-1", "±"), ("utf-8", "±")])
def test_an_uncertainty_is_printed_in_any_encoding(pontius: str, encoding: str, sign: str) -> None:
    lines = [line for line in printed(encoding, "fit", pontius).splitlines() if "b1" in line]
    assert f"{sign} " in lines[0]
    assert "\x1b" not in lines[0]


def test_other_signs_give_way_to_letters_or_are_marked(tmp_path: Path) -> None:
    bundle = tmp_path / "b"
    bundle.mkdir()
    table = '[table]\nresponse = "θ_Prüfer_字"\nbaseline = "b0 + b1 * x"\n'
    (bundle / "recording.toml").write_text(f'format = 1\nexperiment = "table"\n{table}')
    rows = "".join(f"{3 * x + 0.1 * (-1) ** x},{x}\n" for x in range(20))
    (bundle / "readings.csv").write_text(f"θ_Prüfer_字,x\n{rows}")
    import_bundle(bundle, tmp_path / "x.rig.sqlite").close()
    assert "Noise: theta_Prufer_? white" in printed("ascii", "fit", str(tmp_path / "x.rig.sqlite"))
