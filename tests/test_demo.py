"""`rigctl demo`: the real commands over real sockets tell the story, and leave a desk to go on at."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rigctl.campaign.store.store import Store
from rigctl.cli.application import app
from rigctl.core.errors import ConfigError


def asked(*words: str) -> Any:
    found = CliRunner().invoke(app, [*words, "--json"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


# Over the wire a campaign takes its time, and a busy computer more.
@pytest.mark.timeout(600)
def test_the_model_fails_the_missing_effect_is_named_and_errors_fall(tmp_path: Path) -> None:
    with contextlib.chdir(tmp_path):
        shown = CliRunner().invoke(app, ["demo"])
    assert shown.exit_code == 0, shown.output
    fails, names, describes = (
        shown.stdout.index(text)
        for text in (
            "The model does not describe the data",
            "$ rigctl model add demo.rig.sqlite quadratic\n",
            "The model describes the data within their noise",
        )
    )
    assert fails < names < describes
    desk = tmp_path / "rigctl-demo"
    with contextlib.chdir(desk):
        before, after = asked("model", "history", "demo.rig.sqlite")
        assert before["error_held_out"] > 1.8
        assert after["added"] == "quadratic"
        assert after["error_held_out"] < 1.2
        with Store.open(Path("demo.rig.sqlite"), readonly=True) as store:
            assert "K2" not in store.header.rig_toml
            assert 'address = "tcp://127.0.0.1:' in store.header.rig_toml
        assert "<html" in Path("report.html").read_text(encoding="utf-8")
        assert Path("campaigns/my-first.toml").is_file()


def test_a_directory_that_is_there_is_left_alone(tmp_path: Path) -> None:
    kept = tmp_path / "kept.txt"
    kept.write_text("mine")
    refused = CliRunner().invoke(app, ["demo", "--dir", str(tmp_path)])
    assert isinstance(refused.exception, ConfigError)
    assert str(refused.exception).startswith(f"{tmp_path} is there already; name a new directory with --dir")
    assert [*tmp_path.iterdir()] == [kept]
