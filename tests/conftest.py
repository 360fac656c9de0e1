"""Small campaigns on the shipped rigs, run in this process or in another one."""

from __future__ import annotations

import gc
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from _pytest.approx import ApproxScalar

from drivers.transport import InProcessTransport
from rigctl import cli
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError

# An example on a busy machine takes as long as it takes: no wall clock in a test.
hypothesis.settings.register_profile("unhurried", deadline=None)
hypothesis.settings.load_profile("unhurried")

# By default anything below 1e-12 is as good as zero: accelerations in orbit were compared with nothing.
ApproxScalar.DEFAULT_ABSOLUTE_TOLERANCE = 0.0

# What tests make is mostly kept until they end: collected as often as by default, it is looked through for nothing.
gc.set_threshold(20_000, 20, 50)

# Whatever the terminal of whoever tests; pytest-xdist gives its workers the same.
os.environ["COLUMNS"] = "80"

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"

SMALL = """\
experiment = "sensing-axis"
title = "small"
rig = "rig.toml"

[procedure]
name = "six-mountings"
axes = ["X"]
configurations = ["pendulum", "flag"]
mountings = 1
frequencies_hz = [0.3, 0.6]
amplitude_mm = 5.0
coarse_s = 4.0
noise_check_s = 20.0

[targets]
theta0_sigma_arcsec = 15.0
noise_m_s2_rthz = 1e-5

[model]
effects = ["roll-gravity", "resonance"]
"""

MOTION = re.compile(rb"Group(?:Initialize|MotionEnable|HomeSearch|MoveAbsolute)|ENABLE|HOME|MOVEABS|OSCILLATE")
"""Commands that set a stage of the shipped rig in motion, or enable it."""


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one JSON document on stdout."""
        return json.loads(self.out)

    def refused(self, status: int, *facts: str) -> None:
        """It failed with this status and one line that holds all the facts."""
        assert self.status == status, self.err
        assert self.out == ""
        assert len(self.err.splitlines()) == 1, self.err
        assert "Traceback" not in self.err
        assert "internal error" not in self.err
        for fact in facts:
            assert fact in self.err


@dataclass
class Desk:
    """A directory with a rig file and a campaign file, and commands run in it."""

    directory: Path
    capture: pytest.CaptureFixture[str]
    patch: pytest.MonkeyPatch
    processes: list[subprocess.Popen[str]] = field(default_factory=list)

    def rig(self, *changes: tuple[str, str], of: str = "isa-rig.toml", name: str = "rig.toml") -> Path:
        """A shipped rig file with changes."""
        return self._write(name, (CAMPAIGNS / of).read_text(), changes)

    def campaign(self, *changes: tuple[str, str], text: str = SMALL, name: str = "campaign.toml") -> Path:
        """The small campaign file with changes."""
        return self._write(name, text, changes)

    def _write(self, name: str, text: str, changes: tuple[tuple[str, str], ...]) -> Path:
        for old, new in changes:
            assert old in text, f"{name} has no {old!r} to change"
            text = text.replace(old, new, 1)
        path = self.directory / name
        path.write_text(text)
        return path

    @property
    def store(self) -> Path:
        """Where `run` keeps its campaign."""
        return self.directory / "x.rig.sqlite"

    def runs(self) -> int:
        """Finished runs in the store, which is perhaps about to be made."""
        try:
            with Store.open(self.store, readonly=True) as store:
                return len(store.runs())
        except DataError:
            return 0

    @property
    def left(self) -> set[str]:
        """What is in the directory beside TOML files of the test."""
        return {path.name for path in self.directory.iterdir()} - {"rig.toml", "campaign.toml"}

    def rigctl(self, *arguments: object) -> Outcome:
        """A command in this process."""
        self.capture.readouterr()
        self.patch.setattr(sys, "argv", ["rigctl", *map(str, arguments)])
        try:
            cli.main()
        except SystemExit as ended:
            status = ended.code
        else:
            status = 0
        out, err = self.capture.readouterr()
        assert isinstance(status, int)
        return Outcome(status, out, err)

    def run(self, *options: object) -> Outcome:
        """`rigctl run` of the campaign file into the store, the simulated operator answering."""
        return self.rigctl("run", "campaign.toml", "--store", self.store, "--yes", "--json", *options)

    def process(self, *arguments: object, **options: Any) -> subprocess.Popen[str]:
        """A command in another process."""
        process = subprocess.Popen(
            [sys.executable, "-m", "rigctl", *map(str, arguments)],
            cwd=self.directory,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **{"stdin": subprocess.DEVNULL, **options},
        )
        self.processes.append(process)
        return process

    def end(self, process: subprocess.Popen[str], timeout_s: float = 60.0) -> Outcome:
        """How a process ended."""
        out, err = process.communicate(timeout=timeout_s)
        return Outcome(process.returncode, out, err)

    def until(self, condition: Callable[[], bool], process: subprocess.Popen[str], timeout_s: float = 60.0) -> None:
        """Wait until something that another process brings about is so."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if process.poll() is not None:
                pytest.fail(f"the process ended first: {self.end(process)}")
            assert time.monotonic() < deadline, "it did not happen"
            time.sleep(0.005)


@pytest.fixture(scope="session", autouse=True)
def data_directory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where records of checks go: not into the data of whoever runs the tests."""
    directory = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(directory))
        yield directory


@pytest.fixture(autouse=True)
def own_records(data_directory: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every test its own: one must not find what another has checked."""
    name = hashlib.sha256(request.node.nodeid.encode()).hexdigest()[:16]
    monkeypatch.setenv("XDG_DATA_HOME", str(data_directory / name))


@pytest.fixture(scope="session")
def campaigns() -> Path:
    """Where the shipped files are."""
    return CAMPAIGNS


@pytest.fixture(scope="session")
def small() -> str:
    """The small campaign's text."""
    return SMALL


@pytest.fixture
def desk(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    """A directory with the small campaign on the shipped rig; commands run in it."""
    monkeypatch.chdir(tmp_path)
    made = Desk(tmp_path, capsys, monkeypatch)
    made.rig()
    made.campaign()
    yield made
    for process in made.processes:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        process.communicate()


@dataclass
class Wire:
    """Everything that was written to simulated instruments of this process."""

    sent: list[bytes] = field(default_factory=list)

    @property
    def motions(self) -> list[bytes]:
        """The commands that moved something."""
        return [command for data in self.sent for command in MOTION.findall(data)]


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    """What goes over the wires of this process."""
    noted = Wire()
    write = InProcessTransport.write

    def note(self: InProcessTransport, data: bytes) -> None:
        noted.sent.append(data)
        write(self, data)

    monkeypatch.setattr(InProcessTransport, "write", note)
    return noted
