"""A further campaign in a finished store: same rig, same clock, the same mounting when it says so; resumed, too."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import runner
from rigctl.campaign.status import status_of
from rigctl.campaign.store.parts import parts_of
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError, LimitError
from rigctl.files.campaign_file import CampaignFile, read_campaign
from rigctl.files.rig_file import read_rig

FIRST = """\
experiment = "sensing-axis"
rig = "rig.toml"

[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag"]
angles_deg = [-0.5, 0.5]
frequencies_hz = [0.6]
dwell_s = 4.0
"""

MORE = FIRST.replace("dwell_s", 'mounting = "same"\norder_seed = 9\ndwell_s')

UNATTENDED = runner.Options(unattended=True)


def campaign(path: Path, text: str) -> CampaignFile:
    path.write_text(text)
    return read_campaign(path)


@pytest.fixture
def first(tmp_path: Path, campaigns: Path) -> Path:
    """A finished scan of one mounting."""
    store = tmp_path / "x.rig.sqlite"
    rig = read_rig(campaigns / "isa-rig.toml")
    runner.start(campaign(tmp_path / "first.toml", FIRST), rig, store, UNATTENDED)
    return store


def recorded(path: Path) -> dict[str, tuple[dict[str, Any], bytes]]:
    with Store.open(path, readonly=True) as store:
        return {
            run.key: (dict(run.conditions), store.samples(run.run_id)["accel_v"].tobytes()) for run in store.runs()
        }


def test_runs_of_both_are_in_one_store_and_the_mounting_is_the_same(first: Path, tmp_path: Path) -> None:
    before = recorded(first)
    runner.extend(first, campaign(tmp_path / "more.toml", MORE), UNATTENDED)
    after = recorded(first)
    assert len(after) == 4
    assert after.items() >= before.items()
    assert {conditions["mounting"] for conditions, _ in after.values()} == {1}
    starts = [conditions["start_s"] for conditions, _ in after.values()]
    assert starts == sorted(starts)
    status = status_of(first)
    assert (status["state"], status["runs_done"], status["runs_planned"]) == ("done", 4, 4)
    with Store.open(first, readonly=True) as store:
        assert [part.toml for part in parts_of(store)] == [FIRST, MORE]


def test_the_same_mounting_has_the_same_null_and_another_noise(first: Path, tmp_path: Path) -> None:
    runner.extend(first, campaign(tmp_path / "more.toml", MORE), UNATTENDED)
    with Store.open(first, readonly=True) as store:
        slopes: dict[float, list[float]] = {}
        for run in store.runs():
            samples = store.samples(run.run_id)
            x = samples["stage_x_mm"] - samples["stage_x_mm"].mean()
            slopes.setdefault(run.conditions["theta_asked_deg"], []).append(float(samples["accel_v"] @ x / (x @ x)))
    for one, two in slopes.values():
        assert one != two
        # 100 V/(m/s2) over a run of four seconds; another seating would differ by a hundred times this.
        assert one == pytest.approx(two, abs=5e-5)


def test_a_new_mounting_gets_a_number_that_was_never_used(first: Path, tmp_path: Path) -> None:
    runner.extend(first, campaign(tmp_path / "more.toml", FIRST), UNATTENDED)
    runner.extend(first, campaign(tmp_path / "still.toml", MORE), UNATTENDED)
    numbers = [conditions["mounting"] for conditions, _ in recorded(first).values()]
    assert numbers == [1, 1, 2, 2, 2, 2]


@pytest.mark.parametrize(("method", "nth"), [("stream", 1), ("finish", 1), ("finish", 2)])
def test_killed_in_the_extension_a_store_is_resumed_to_the_same_runs(
    first: Path, tmp_path: Path, method: str, nth: int
) -> None:
    more = campaign(tmp_path / "more.toml", MORE)
    copy = tmp_path / "copy.rig.sqlite"
    for suffix in ("", ".truth.toml"):
        Path(f"{copy}{suffix}").write_bytes(Path(f"{first}{suffix}").read_bytes())
    runner.extend(copy, more, UNATTENDED)

    child = os.fork()
    if child == 0:
        original = getattr(RunWriter, method)
        calls = []

        def counted(*arguments: Any, **options: Any) -> Any:
            calls.append(1)
            found = original(*arguments, **options)
            if len(calls) == nth:
                os.kill(os.getpid(), signal.SIGKILL)
            return found

        try:
            setattr(RunWriter, method, counted)
            runner.extend(first, more, UNATTENDED)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert status_of(first)["state"] == "interrupted"
    with pytest.raises(DataError, match="only a campaign that is done"):
        runner.extend(first, more, UNATTENDED)

    runner.resume(first, UNATTENDED)
    undisturbed = recorded(copy)
    assert recorded(first) == undisturbed
    runner.resume(first, UNATTENDED)
    assert recorded(first) == undisturbed, "a store that is done stays as it is"


def test_what_cannot_be_added_leaves_the_store_done(first: Path, tmp_path: Path) -> None:
    refused = [
        (MORE.replace('["X"]', '["Y"]'), ConfigError, "X is mounted in flag, not Y in flag"),
        (MORE.replace("[-0.5, 0.5]", "[175.0]"), LimitError, "175 deg is outside"),
    ]
    for text, kind, fact in refused:
        with pytest.raises(kind, match=fact):
            runner.extend(first, campaign(tmp_path / "more.toml", text), UNATTENDED)
    assert status_of(first)["state"] == "done"
    with Store.open(first, readonly=True) as store:
        assert len(parts_of(store)) == 1


def test_what_drifts_goes_on_drifting_where_the_mounting_is_the_same(tmp_path: Path, campaigns: Path) -> None:
    rate_v_s = 1e-5
    rig_text = (campaigns / "isa-rig.toml").read_text() + f"\n[world.effects.bias-drift]\nrate = {rate_v_s}\n"
    (tmp_path / "rig.toml").write_text(rig_text)
    store_path = tmp_path / "drift.rig.sqlite"
    first = campaign(tmp_path / "first.toml", FIRST)
    runner.start(first, read_rig(tmp_path / "rig.toml"), store_path, UNATTENDED)
    runner.extend(store_path, campaign(tmp_path / "more.toml", MORE), UNATTENDED)
    with Store.open(store_path, readonly=True) as store:
        runs = store.runs()
        start_s = [run.conditions["start_s"] for run in runs]
        level_v = [float(np.mean(store.samples(run.run_id)["accel_v"])) for run in runs]
    assert start_s[2] - start_s[1] > 500.0
    assert level_v[2] - level_v[1] == pytest.approx(rate_v_s * (start_s[2] - start_s[1]), abs=2e-3)
