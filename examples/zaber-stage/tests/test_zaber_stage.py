"""The stage against the suite that all linear stages share, its wire in bytes, and rigctl that finds it."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from zaber_stage.driver import ZaberLinear, ZaberSettings
from zaber_stage.messages import checksum, command, parse_reply
from zaber_stage.simulator import SimulatedZaber, ZaberSimulatorSettings

from drivers.transport import InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, MotionStopped, OutOfStep, WrongInstrument
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.faults.mishaps import FollowingError
from simulators.motion import MotionAxis
from tests.drivers.linear_stage_contract import *  # noqa: F403 - the suite itself
from tests.drivers.linear_stage_contract import Backend, MakeBackend

HERE = Path(__file__).parent.parent


def device(clock: SimulationClock, **settings: float) -> SimulatedZaber:
    return SimulatedZaber(clock, MotionAxis(), ZaberSimulatorSettings(**settings))


def driver(simulated: SimulatedZaber, **settings: float) -> ZaberLinear:
    def connect() -> InProcessTransport:
        return InProcessTransport("sim:stage", simulated, simulated.clock)

    return ZaberLinear("stage", ZaberSettings(move_speed_mm_s=2.0, **settings), connect, simulated.clock)


@pytest.fixture
def make_backend() -> MakeBackend:
    return lambda clock: Backend(driver(device(clock)), clock)


def test_the_bytes_are_those_of_the_manual() -> None:
    wire = InProcessTransport("wire", device(clock := VirtualClock()), clock)
    for said, heard in (
        (b"/\n", b"@01 0 OK IDLE WR 0\r\n"),
        (b"/1 1 get limit.max\r\n", b"@01 1 OK IDLE WR 1066667\r\n"),
        (b"/1 1 07 get limit.min\n", b"@01 1 07 OK IDLE WR 0\r\n"),
        (b"/1 2 home\n", b"@01 2 RJ IDLE WR BADAXIS\r\n"),
        (b"/1 1 move abs 100\n", b"@01 1 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 dance\n", b"@01 1 RJ IDLE WR BADCOMMAND\r\n"),
        (b"/1 1 home\n", b"@01 1 OK BUSY WR 0\r\n"),
    ):
        wire.write(said)
        assert wire.read_until(b"\r\n", 1.0) == heard
    wire.write(b"/2 1 home\n/1 1 home:00\n")
    assert wire.unread() == b""


def test_who_sees_the_search_at_its_end_sees_the_reference() -> None:
    # Nobody runs the clock's events here: the answers alone have to agree with each other.
    wire = InProcessTransport("wire", device(clock := ScaledClock(1000.0)), clock)
    wire.write(b"/home\n")
    reply = wire.unread()
    while b"BUSY" in reply:
        wire.write(b"/\n")
        reply = wire.unread()
    assert reply == b"@01 0 OK IDLE -- 0\r\n"
    wire.write(b"/warnings\n")
    assert wire.unread() == b"@01 0 OK IDLE -- 00\r\n"


def test_a_sum_makes_all_bytes_behind_the_first_zero() -> None:
    sent = command(1, 1, 7, "get pos")
    text, _, total = sent[1:-1].decode().partition(":")
    assert (sum(text.encode()) + int(total, 16)) % 256 == 0


@pytest.mark.parametrize(
    "line",
    [
        b"@01 1 07 OK IDLE -- 5\r\n",
        f"@01 1 07 OK IDLE -- 5:{checksum('01 1 07 OK IDLE -- 4')}\r\n".encode(),
        f"@02 1 07 OK IDLE -- 5:{checksum('02 1 07 OK IDLE -- 5')}\r\n".encode(),
        "@01 1 ٠7 OK IDLE -- 5\r\n".encode(),
        b"@01 1 07 OK IDLE",
    ],
)
def test_what_is_no_reply_is_none(line: bytes) -> None:
    with pytest.raises(ValueError, match="reply"):
        parse_reply(line, 1, 1, summed=True)


class Spoilt(InProcessTransport):
    """Gives the next reply twice, or that of the question before."""

    spoil = ""
    before = b""

    def read_until(self, end: bytes, timeout_s: float) -> bytes:
        reply = super().read_until(end, timeout_s)
        said, self.before = self.before, reply
        mode, self.spoil = self.spoil, ""
        return said if mode == "previous" else reply

    def unread(self) -> bytes:
        mode, self.spoil = self.spoil, self.spoil if self.spoil == "previous" else ""
        return super().unread() + (self.before if mode == "twice" else b"")


def test_a_reply_to_another_question_is_never_taken() -> None:
    simulated = device(clock := VirtualClock())
    wire = Spoilt("wire", simulated, clock)
    stage = ZaberLinear("stage", ZaberSettings(), lambda: wire, clock)
    stage.open()
    stage.position()
    wire.spoil = "previous"
    with pytest.raises(BadReply, match="another question"):
        stage.position()
    stage.confirm_in_step()
    wire.spoil = "twice"
    with pytest.raises(OutOfStep):
        stage.confirm_in_step()
    assert stage.position().value == pytest.approx(25.4, abs=1e-4)


def test_a_stall_is_told_and_forgotten_with_the_next_motion() -> None:
    simulated = device(clock := VirtualClock())
    stage = driver(simulated)
    stage.open()
    stage.home()
    clock.call_at(clock.now_s() + 1.0, lambda: simulated.befall(FollowingError(at_s=0.0)))
    with pytest.raises(MotionStopped, match="stalled and stopped"):
        stage.move_to(10.0)
    stage.move_to(1.0)
    assert stage.safety_stop() == ""


def test_another_stage_than_the_rig_file_says_is_refused() -> None:
    with pytest.raises(WrongInstrument, match=r"travels from -25\.4 to -1\.5875e-05 mm; correct position_min_mm"):
        driver(device(VirtualClock(), travel_mm=25.4)).open()


def test_a_motion_that_does_not_end_is_stopped() -> None:
    stage = driver(simulated := device(VirtualClock()), motion_timeout_s=1.0)
    stage.open()
    with pytest.raises(InstrumentError, match="'home' has not ended after 1 s and was stopped"):
        stage.home()
    simulated.clock.sleep_s(1.0)
    assert not stage.is_moving()


RIG = HERE.parent.parent / "campaigns" / "all-instruments.rig.toml"
MOVER = """
[instruments.mover]
driver = "zaber-linear"
address = "sim:"
role = "spare"
"""


def test_rigctl_check_finds_it_by_its_entry_point(tmp_path: Path) -> None:
    listed = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]["entry-points"]["rigctl.drivers"]
    meta = tmp_path / "zaber_stage-0.1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: zaber-stage\nVersion: 0.1.0\n")
    points = "".join(f"{name} = {value}\n" for name, value in listed.items())
    (meta / "entry_points.txt").write_text(f"[rigctl.drivers]\n{points}")
    (tmp_path / "rig.toml").write_text(RIG.read_text(encoding="utf-8") + MOVER)
    path = os.pathsep.join([str(tmp_path), str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    found = subprocess.run(
        [sys.executable, "-m", "rigctl", "check", str(tmp_path / "rig.toml")],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (found.returncode, found.stderr) == (0, "")
    assert (
        "mover:\n  ok       found, address: sim:\n  ok       identity, who answers: Zaber 50081, serial 12345, "
        in found.stdout
    )
