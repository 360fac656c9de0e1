"""Every driver against replies that no instrument would send, as fast as it can read them.

What the simulators answer to each question is recorded once; a scripted instrument then answers with that, or with
something made of it or of nothing: other bits, cut, doubled, another question's answer, impossible numbers, noise.
"""

from __future__ import annotations

import functools
import gc
import os
import random
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.transport import InProcessTransport
from rigctl.core import interfaces
from rigctl.core.errors import RigError
from rigctl.core.voltage_sources import VoltageSource, Waveform
from rigctl.files.rig_file import read_rig
from rigctl.rig import build_simulation, drivers_of
from simulators.clock import VirtualClock
from tests.reliability.campaigns import SHIPPED

PROMISE = "Whatever a driver is answered, it raises nothing but typed errors, ends, and does not grow"

RIGS = ("all-instruments.rig.toml", "bias-rejection-rig.toml", "one-axis.rig.toml")
REPLIES = 60_000
RECORDED_ACTIONS = 150
SPOILT = (0.02, 0.1, 0.3, 1.0)
GROWTH_MB = 64.0
REOPENED_EVERY = 100
SAMPLES, PERIOD_S = 10, 0.01

Action = Callable[[], Any]
Answers = dict[bytes, list[bytes]]
Build = Callable[[Any, Any], Any]
"""A driver, given an instrument and a clock."""

ODD = (b"", b"\0", b"\r\n", b"nan", b"inf", b"-inf", b"1e400", b"1_0", b"0x10", b"\xd9\xa3", b"9" * 400, b"\xff" * 30)
ODD += (
    b"+9.9E+37",
    b"-0",
    b"1e-400",
    b",",
    b",,,,",
    b"#",
    b"#0",
    b"#9",
    b"#210",
    b"\n\n\n",
    b"0,,EndOfAPI",
    b"A" * 5000,
)


@dataclass
class Scripted:
    """An instrument that answers from what was recorded; `spoil` says what is made of an answer."""

    answers: Answers
    draw: random.Random
    spoilt: float = 0.0
    sent: int = 0
    actions: int = 0
    last: list[tuple[bytes, bytes]] = field(default_factory=list)
    everything: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.everything = [reply for replies in self.answers.values() for reply in replies] or [b""]

    def connect(self, send: Callable[[bytes], None]) -> ScriptedConnection:
        """One more client."""
        return ScriptedConnection(self, send)

    def reply(self, request: bytes) -> bytes:
        """What is answered to `request`."""
        self.sent += 1
        known = self.answers.get(request)
        reply = self.draw.choice(known or self.everything)
        if self.draw.random() < self.spoilt:
            reply = self.spoil(reply)
        self.last = [*self.last[-5:], (request[:80], reply[:80])]
        return reply

    def spoil(self, reply: bytes) -> bytes:
        """Something else in its place."""
        draw = self.draw
        place = draw.randrange(len(reply) + 1)
        match draw.randrange(9):
            case 0:
                return draw.randbytes(draw.randrange(40))
            case 1:
                spoilt = bytearray(reply or b"?")
                spoilt[place % len(spoilt)] ^= 1 << draw.randrange(8)
                return bytes(spoilt)
            case 2:
                return reply[:place]
            case 3:
                return reply + reply
            case 4:
                return draw.choice(self.everything)
            case 5:
                return reply[:place] + draw.choice(ODD) + reply[place:]
            case 6:
                return draw.choice(ODD) + reply[-2:]
            case 7:
                return reply[:place] + bytes([draw.randrange(256)]) + reply[place:]
            case _:
                return b""


@dataclass
class ScriptedConnection:
    """One client's end of it."""

    instrument: Scripted
    send: Callable[[bytes], None]

    def receive(self, data: bytes) -> None:
        """Answer at once."""
        if reply := self.instrument.reply(data):
            self.send(reply)

    def close(self) -> None:
        """The client has gone."""


@dataclass
class Recording:
    """An instrument whose answers are noted by question: what is sent until the next question."""

    inner: Any
    answers: Answers = field(default_factory=dict)

    def connect(self, send: Callable[[bytes], None]) -> RecordingConnection:
        """One more client."""
        return RecordingConnection(self, send)


class RecordingConnection:
    """One client's end of it."""

    def __init__(self, instrument: Recording, send: Callable[[bytes], None]) -> None:
        self._instrument = instrument
        self._pass_on = send
        self._request = b""
        self._inner = instrument.inner.connect(self._send)

    def receive(self, data: bytes) -> None:
        """A question."""
        self._request = data
        self._instrument.answers.setdefault(data, []).append(b"")
        self._inner.receive(data)

    def close(self) -> None:
        """The client has gone."""
        self._inner.close()

    def _send(self, data: bytes) -> None:
        if self._request:
            self._instrument.answers[self._request][-1] += data
        self._pass_on(data)


def trial(seed: int, work: Path) -> dict[str, Any]:
    """Some thousand replies to every driver in turn."""
    draw = random.Random(seed)
    drivers = _recorded()
    before_mb = _resident_mb()
    failures: list[str] = []
    refused: dict[str, float] = {}
    told = 0
    for name, (build, answers) in drivers.items():
        scripted = Scripted(answers, draw, draw.choice(SPOILT))
        refused[name] = _act(name, build, scripted, draw, failures) / scripted.actions
        told += scripted.sent
    gc.collect()
    grown_mb = _resident_mb() - before_mb
    if grown_mb > GROWTH_MB:
        failures.append(f"grown by {grown_mb:.0f} MB")
    if failures:
        (work / "failures.txt").write_text("\n\n".join(failures), encoding="utf-8")
    return {
        "tried": told,
        "grown_mb": round(grown_mb, 1),
        "refused": {name: round(share, 3) for name, share in refused.items()},
        "failures": len(failures),
        "failed": failures[0].splitlines()[0] if failures else "",
    }


def _act(name: str, build: Build, scripted: Scripted, draw: random.Random, failures: list[str]) -> int:
    """Let a driver do what it can until it has had its replies; returns how often it raised a typed error."""
    driver = build(scripted, VirtualClock())
    can = _actions(driver, draw)
    typed, each = 0, REPLIES // len(_recorded())
    while scripted.sent + scripted.actions < each and len(failures) < 20:
        scripted.actions += 1  # one that asks nothing does not go on for ever
        if scripted.actions % REOPENED_EVERY == 0:
            driver.close()
        try:
            draw.choice(can)()
        except RigError:
            typed += 1
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            failures.append(f"{name}: {type(error).__name__}: {error}\n{scripted.last}\n{traceback.format_exc()}")
            driver = build(scripted, VirtualClock())
            can = _actions(driver, draw)
    return typed


def _actions(driver: Any, draw: random.Random) -> Sequence[Action]:
    """What the interfaces this driver has let a procedure ask."""
    can: list[Action] = [driver.open, driver.identify, driver.stop]
    if isinstance(driver, interfaces.Examinable):
        can.append(lambda: list(driver.examine()))
    for name in ("home", "is_homed", "angle", "position", "rest", "confirm_in_step"):
        if hasattr(driver, name):
            can += [getattr(driver, name)] * 2
    for name in ("displacements", "collect", "fetch", "voltage", "temperature"):
        if hasattr(driver, name):
            can += [getattr(driver, name)] * 6
    return can + _set_points(driver, draw) * 4


def _set_points(driver: Any, draw: random.Random) -> list[Action]:
    if isinstance(driver, VoltageSource) and not hasattr(driver, "fetch"):  # a pacing meter starts too
        return [lambda: driver.start(_waveforms(driver, draw))]
    actions: dict[type, list[Action]] = {
        interfaces.RotationStage: [lambda: driver.move_to(draw.uniform(-90.0, 90.0))],
        interfaces.LinearStage: [
            lambda: driver.move_to(draw.uniform(-20.0, 20.0)),
            lambda: driver.oscillate(0.0, 5.0, 0.5, 4.0),
        ],
        interfaces.PacedRecorder: [lambda: driver.arm(SAMPLES, PERIOD_S)],
        interfaces.StreamedRecorder: [lambda: driver.follow(SAMPLES, PERIOD_S)],
        interfaces.PacingRecorder: [lambda: driver.start(SAMPLES, PERIOD_S)],
    }
    return [action for interface, those in actions.items() if isinstance(driver, interface) for action in those]


def _waveforms(driver: Any, draw: random.Random) -> dict[str, Waveform]:
    shapes = (
        Waveform(offset_v=draw.uniform(-1.0, 1.0)),
        Waveform("sine", 0.0, 0.5, 100.0),
        Waveform("triangle", 0.0, 0.5, 100.0),
    )
    return {channel.name: draw.choice(shapes) for channel in driver.channels()}


@functools.cache
def _recorded() -> dict[str, tuple[Build, Answers]]:
    """Every kind of driver in every role, and what its simulator answers to its questions."""
    found: dict[str, tuple[Build, Answers]] = {}
    for rig in RIGS:
        file = read_rig(SHIPPED / rig)
        simulation = build_simulation(file, VirtualClock(), seed=1)
        for name, driver in drivers_of(file).items():
            table = file.instruments[name]
            kind = f"{table.driver} as {table.role}"
            if (kind not in found and table.role != "spare") or table.driver == "keysight-33500b":
                build = functools.partial(_built, name, driver)
                recording = Recording(simulation.instruments[name])
                _ask_everything(build(recording, simulation.clock))
                found[kind] = build, recording.answers
    return found


def _ask_everything(driver: Any) -> None:
    draw = random.Random(0)
    can = _actions(driver, draw)
    driver.open()
    for _ in range(RECORDED_ACTIONS):
        try:
            draw.choice(can)()
        except RigError:
            continue


def _built(name: str, driver: Any, endpoint: Any, clock: Any) -> Any:
    return driver.build(name, driver.settings, lambda: InProcessTransport(name, endpoint, clock), clock)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1]) if sys.platform == "linux" else 0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
