"""Commands on a terminal that has no signs beyond ASCII, or beyond Latin-1."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"


def printed(encoding: str, *arguments: str) -> str:
    command = [sys.executable, "-m", "rigctl", *arguments]
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "TERM": "dumb", "LC_ALL": "C"}
    ended = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.decode(encoding)


@pytest.mark.parametrize(("encoding", "sign"), [("ascii", "+-"), ("latin-1", "±"), ("utf-8", "±")])
def test_an_uncertainty_is_printed_in_any_encoding(tmp_path: Path, encoding: str, sign: str) -> None:
    store = str(tmp_path / "x.rig.sqlite")
    printed(encoding, "import", str(PONTIUS), "--store", store)
    lines = [line for line in printed(encoding, "fit", store).splitlines() if "b1" in line]
    assert f"{sign} " in lines[0]
    assert "\x1b" not in lines[0]


def test_other_signs_give_way_to_letters_or_are_marked(tmp_path: Path) -> None:
    bundle = tmp_path / "b"
    bundle.mkdir()
    table = '[table]\nresponse = "θ_Prüfer_字"\nbaseline = "b0 + b1 * x"\n'
    (bundle / "recording.toml").write_text(f'format = 1\nexperiment = "table"\n{table}')
    rows = "".join(f"{3 * x + 0.1 * (-1) ** x},{x}\n" for x in range(20))
    (bundle / "readings.csv").write_text(f"θ_Prüfer_字,x\n{rows}")
    store = str(tmp_path / "x.rig.sqlite")
    printed("ascii", "import", str(bundle), "--store", store)
    assert "Noise: theta_Prufer_? white" in printed("ascii", "fit", store)
