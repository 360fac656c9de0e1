"""The store between processes: killed at any instant, and read while it is written."""

import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store

ROOT = Path(__file__).parents[2]

WRITER = """
import sys
from pathlib import Path
import numpy as np
from rigctl.campaign.store.store import Store

first, last = int(sys.argv[2]), int(sys.argv[3])
with Store.open(Path(sys.argv[1])) as store:
    for i in range(first, last):
        with store.begin_run(f"key {i}", "s", {"i": i}) as writer:
            for _ in range(4):
                writer.append({"t_s": np.full(250, float(i)), "accel_v": np.full(250, i / 3)})
                print("appended", i, flush=True)
            writer.finish()
        print("finished", i, flush=True)
"""

READER = """
import sys
from pathlib import Path
import numpy as np
from rigctl.campaign.store.store import Store

with Store.open(Path(sys.argv[1]), readonly=True) as store:
    seen = 0
    while seen < int(sys.argv[2]):
        runs = store.runs()
        assert [r.conditions["i"] for r in runs] == list(range(len(runs)))
        assert len(runs) >= seen
        for run in runs[seen:]:
            samples = store.samples(run.run_id)
            assert samples["t_s"].shape == samples["accel_v"].shape == (1000,)
            assert (samples["accel_v"] == run.conditions["i"] / 3).all()
        seen = len(runs)
print("saw", seen)
"""


def start(script, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def runs_until_killed(path, first, word, lines):
    """The runs the writer said it had finished before it was killed on the n-th line that begins with `word`."""
    process = start(WRITER, path, first, first + 1000)
    finished = []
    for line in process.stdout:
        said, number = line.split()
        if said == "finished":
            finished.append(int(number))
        if said == word:
            lines -= 1
        if lines == 0:
            break
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    return finished


@pytest.mark.parametrize("word", ["appended", "finished"])
def test_kill_loses_no_finished_run(tmp_path, word):
    path = tmp_path / "s.rig.sqlite"
    Store.create(path, Header("sensing-axis")).close()
    finished = []
    for lines in (1, 7, 23):
        finished += runs_until_killed(path, len(finished), word, lines)
        with Store.open(path) as store:
            held = [run.conditions["i"] for run in store.runs()]
            # The writer may have got further than what it had told.
            assert held[: len(finished)] == finished
            for run in store.runs():
                expected = np.full(1000, run.conditions["i"] / 3)
                np.testing.assert_array_equal(store.samples(run.run_id)["accel_v"], expected)
            assert all(run.state != "finished" for run in store.interrupted_runs())
            finished = held
        connection = sqlite3.connect(path)
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        connection.close()
    assert len(finished) >= {"appended": 6, "finished": 31}[word]


def test_two_readers_see_whole_runs_while_one_writes(tmp_path):
    path = tmp_path / "s.rig.sqlite"
    Store.create(path, Header("sensing-axis")).close()
    readers = [start(READER, path, 60) for _ in range(2)]
    writer = start(WRITER, path, 0, 60)
    for process in (writer, *readers):
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors
