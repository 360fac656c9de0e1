"""What is tried beyond asking: ten edges, the emergency stop, a millimetre and a degree."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.session.operator import Operator
from rigctl.check import guide, lasers
from rigctl.check.guide import Wanted
from rigctl.check.hands import Hands
from rigctl.check.interlocks import try_interlocks
from rigctl.check.moving_edges import delay_between
from rigctl.check.record import Line
from rigctl.check.trigger import Edges
from rigctl.core.clock import RealClock
from rigctl.core.errors import Aborted
from rigctl.core.findings import Finding
from rigctl.files.package import HeadSettings
from rigctl.files.rig_file import RigFile, parse_rig
from rigctl.rig import Rig

Lines = list[Line]
ISA, ONE = "isa-rig.toml", "one-axis.rig.toml"
OSCILLATE = 'oscillate_distance = "amplitude"   # of this controller; on yours a millimetre tells: docs/hardware.md\n'


@pytest.fixture
def file(campaigns: Path) -> Callable[..., RigFile]:
    """A shipped rig with changes."""

    def make(*changes: tuple[str, str], of: str = ISA) -> RigFile:
        text = (campaigns / of).read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        return parse_rig(text, Path("rig.toml"))

    return make


def tried(file: RigFile, **wanted: bool) -> tuple[guide.Checked, dict[tuple[str, str], Line]]:
    checked = guide.check(file, Wanted(**wanted))
    return checked, {(line.instrument, line.item): line for line in checked.record.lines if line.step in wanted_steps}


wanted_steps = {"trigger", "interlock", "motion"}


# Edges


def test_ten_edges_are_counted_at_every_recorder(file: Any, wire: Any) -> None:
    _, found = tried(file(of=ONE), trigger=True)
    assert found["accelerometer", "pace"].found == "10 of 10 readings, 100 ms apart"
    assert found["stage", "edges"].found.startswith("10 of 10; ")
    assert found["lasers", "edges"].found.startswith("10 of 10; counted ")
    assert {line.outcome for line in (found["stage", "edges"], found["lasers", "edges"])} == {"ok"}
    assert not [sent for sent in wire.motions if sent not in (b"ENABLE",)], "edges move nothing"


def test_a_controller_on_its_own_clock_needs_no_edges(file: Any) -> None:
    _, found = tried(file(), trigger=True)
    assert "on its own clock" in found["lasers_a", "edges"].found
    assert found["lasers_a", "edges"].outcome == "ok"


ENSEMBLE = 'driver = "aerotech-ensemble"', 'axis = "X"\n'
SOLOIST = 'driver = "aerotech-soloist"', 'unit = "mm"                        # it does not tell: look it up\n'
CAPTURES = "integer_registers = 50010           # GlobalIntegers, raised by the operator: a record has one each\n"


@pytest.mark.parametrize(
    ("controller", "latency_s", "outcome"),
    [
        (ENSEMBLE, 0.0, "ok"),
        (ENSEMBLE, 0.004, "ok"),
        (ENSEMBLE, 0.02, "differs"),
        (SOLOIST, 0.004, "ok"),
        (SOLOIST, 0.02, "differs"),
    ],
)
def test_the_delay_of_a_latched_position_is_found_while_the_stage_moves(
    controller: tuple[str, str], latency_s: float, outcome: str, file: Any
) -> None:
    late = f"{CAPTURES}capture_latency_s = {latency_s}\n"
    changed = file((CAPTURES, late), *zip(ENSEMBLE, controller, strict=True), of=ONE)
    _, found = tried(changed, trigger=True, move=True)
    line = found["stage", "delay"]
    low_ms, high_ms, jitter_ms = map(float, re.findall(r"(-?[\d.e-]+)(?: to| ms after| ms at most)", line.found))
    # Nothing takes time on a virtual clock: what is left is the encoder's step and its noise, at 0.6 mm/s.
    assert low_ms - 0.05 < 1e3 * latency_s < high_ms + 0.05
    assert jitter_ms < 0.05
    assert line.outcome == outcome
    assert ("write latency_s = 0.02" in line.mend) == (outcome == "differs")


def test_questions_that_take_time_bound_the_delay() -> None:
    """A stage at 1 mm/s whose positions are latched 3 ms late, asked by questions of 4 ms that are heard anywhere."""
    edges_s = 100.0 + 0.1 * np.arange(10)
    asked_s = np.arange(99.9, 101.1, 0.007)
    heard = np.random.default_rng(1).uniform(0.0, 4e-3, len(asked_s))
    looks = np.column_stack([asked_s, asked_s + 4e-3, asked_s + heard])
    found = delay_between(edges_s, edges_s + 3e-3, looks)
    assert found is not None
    assert found.low_s <= 3e-3 <= found.high_s
    assert found.high_s - found.low_s < 1e-3
    assert found.jitter_s < 1e-6
    jittery = delay_between(edges_s, edges_s + 3e-3 + 1e-3 * np.random.default_rng(2).standard_normal(10), looks)
    assert jittery is not None
    assert 0.4e-3 < jittery.jitter_s < 2e-3
    assert delay_between(edges_s, np.abs(edges_s - 100.5), looks) is None
    assert delay_between(edges_s, edges_s + 50.0, looks) is None


@pytest.mark.parametrize("who", ["stage", "lasers"])
def test_missing_edges_are_counted_and_named(file: Any, who: str) -> None:
    fault = f"[instruments.{who}.faults]\nmissing_edges = {{ at_s = 0.0, lasting_s = 1e6, share = 0.5 }}\n\n"
    _, found = tried(file(("[lasers.laser_main_mm]", f"{fault}[lasers.laser_main_mm]"), of=ONE), trigger=True)
    line = found[who, "edges"]
    assert line.outcome == "differs"
    assert any(f"{came} of 10" in line.found or f"({came} came)" in line.found for came in range(1, 10)), line.found
    assert "docs/wiring.md" in line.mend


class Late:
    """A recorder that has each edge so much later than it came, as `delays_s` say in turn."""

    name = "late"

    def __init__(self, clock: Any, delays_s: list[float]) -> None:
        self._clock, self._delays_s = clock, delays_s
        self.first_s = self.period_s = 0.0

    def arm(self, samples: int, period_s: float) -> None:
        assert samples == len(self._delays_s)
        self.period_s = period_s

    def edges_seen(self) -> int:
        due_s = [self.first_s + n * self.period_s + delay_s for n, delay_s in enumerate(self._delays_s)]
        return sum(due <= self._clock.now_s() for due in due_s)

    def collect(self) -> list[float]:
        return self._delays_s

    channels = longest_record = None


class Pacing:
    """Gives edges from now on."""

    name, first_sample_after_s = "pacing", 0.0

    def __init__(self, clock: Any, follower: Late) -> None:
        self._clock, self._follower = clock, follower

    def start(self, samples: int, period_s: float) -> float:
        self._follower.first_s = self._clock.now_s()
        return self._follower.first_s

    def fetch(self) -> list[int]:
        return list(range(10))


@pytest.mark.parametrize(
    ("delays_s", "jitter_ms"), [([0.013] * 10, None), ([0.013, 0.043] * 5, 28.0), ([0.013] * 9 + [0.043], 28.0)]
)
def test_delay_and_jitter_are_told_as_well_as_looks_can_tell(
    file: Any, delays_s: list[float], jitter_ms: float | None
) -> None:
    clock = Rig(file()).clock
    late, told = Late(clock, delays_s), []
    Edges(clock, Pacing(clock, late), [late], lambda _, finding: told.append(finding)).count()
    found = told[-1].found
    assert told[-1].outcome == "ok"
    numbers = [float(word) for word in found.replace(";", "").split() if word.replace(".", "").isdigit()]
    if jitter_ms is None:
        # Looked at every 2 ms: the one delay lies between the bounds.
        low_ms, high_ms = numbers[2:4]
        assert "no jitter seen" in found
        assert low_ms <= 13.0 <= high_ms
        assert high_ms - low_ms <= 2.1
    else:
        assert numbers[4] == pytest.approx(jitter_ms, abs=2.1)


# The emergency stop


def pressed(rig: Rig, typed: str = "") -> tuple[list[tuple[str, Finding]], list[str]]:
    """What is found at the stages, and what was said, with these lines typed where somebody can type."""
    told: list[tuple[str, Finding]] = []
    said: list[str] = []
    with rig:
        for stage in (*rig.by_role("rotation"), *rig.by_role("linear")):
            stage.home()
        hands = Hands(said.append, lambda: None, rig.clock)
        hands._typed = typed.encode()
        try_interlocks(rig, hands, lambda name, finding: told.append((name, finding)))
    return told, said


def test_an_emergency_stop_that_is_pressed_is_seen(file: Any) -> None:
    press = "emergency_stop = { at_s = 20.0, lasting_s = 1e5 }"
    tables = "".join(f"[instruments.{name}.faults]\n{press}\n\n" for name in ("rotation", "stage"))
    rig = Rig(file(("[lasers.laser_1_mm]", f"{tables}[lasers.laser_1_mm]")))
    told, said = pressed(rig)
    assert "press its emergency stop now" in said[0]
    first = told[0][1]
    assert (told[0][0], first.outcome) == ("rotation", "ok")
    assert "emergency" in first.found.lower()
    assert 20.0 <= rig.clock.now_s() < 90.0
    # The same press has stopped the next stage already: it is told, not taken for a test of it.
    assert told[1][0] == "stage"
    assert "emergency stop" in told[1][1].found


def test_a_press_that_no_controller_tells_is_a_difference(file: Any) -> None:
    told, _ = pressed(Rig(file()), "done\ndone\nno\n")
    assert [(name, finding.outcome) for name, finding in told] == [
        ("rotation", "differs"),
        ("stage", "differs"),
        ("", "differs"),
    ]
    assert "the controller does not tell" in told[0][1].found


def test_what_nobody_presses_stays_unknown(file: Any) -> None:
    rig = Rig(file())
    told, _ = pressed(rig, "skip\n")
    assert {finding.outcome for _, finding in told} == {"unknown"}
    assert 60.0 <= rig.clock.now_s() < 80.0, "only the second was waited for"


def test_a_stage_that_is_off_cannot_tell(file: Any) -> None:
    told: list[tuple[str, Finding]] = []
    with Rig(file()) as rig:
        try_interlocks(rig, Hands(lambda _: None, lambda: None, rig.clock), lambda *each: told.append(each))
        assert rig.clock.now_s() < 60.0, "nobody is asked to press"
    assert told[0][1].outcome == "unknown"
    assert "home it first" in told[0][1].mend


def test_lines_are_read_from_a_pipe(file: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    near, far = os.pipe()
    with os.fdopen(near) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(far, b"what?\nskip\n")
        os.close(far)
        told, said = pressed(Rig(file()))
    assert told[0][1].outcome == "unknown"
    assert "Type 'done' or 'skip'" in said[0]


# Motions


def test_a_millimetre_and_a_degree_are_held_against_the_heads(file: Any) -> None:
    checked, found = tried(file(), move=True)
    tried_here = {key: line for key, line in found.items() if line.step == "motion" and key[1] != "level"}
    assert {line.outcome for line in tried_here.values()} == {"ok"}, tried_here
    assert found["lasers_a", "laser_1_mm"].found.startswith("+1.0000 mm of the stage changed it by +1.00")
    assert "counter-clockwise" in found["rotation", "sense, by laser_1_mm"].found
    assert checked.record.learned == {}, "the rig file says it already"


def test_a_spare_stage_is_left_alone_and_every_motion_is_told_before_it_is_made(file: Any, wire: Any) -> None:
    said: list[str] = []
    moving: list[int] = []

    def say(text: str) -> None:
        said.append(text)
        moving.append(len(wire.motions))

    guide.check(file(of="all-instruments.rig.toml"), Wanted(move=True), say=say)
    motions = [text for text in said if text.startswith("MOVES: ")]
    assert {text.split()[1] for text in motions} == {"rotation", "stage"}
    assert moving[0] == 0
    assert not any(b"1MO" in data or b"1PA" in data for data in wire.sent), "the spare stage"


def test_what_only_motion_tells_is_learned_kept_and_used(desk: Any, file: Any) -> None:
    silent = file((OSCILLATE, ""))
    checked, found = tried(silent, move=True)
    assert checked.record.learned == {"stage": {"oscillate_distance": "amplitude"}}
    assert found["stage", "oscillate_distance"].found.startswith("amplitude: it went 0.000 to 1.000 mm")
    desk.rig((OSCILLATE, ""))
    desk.campaign(('["pendulum", "flag"]', '["flag"]'), ("[0.3, 0.6]", "[0.6]"), ('"roll-gravity", ', ""))

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Operator, "remount", interrupted)
        assert desk.run().status == 130
    checked.path.unlink()
    assert desk.rigctl("resume", desk.store).status == 0, "the campaign knows it from its store"
    assert desk.rigctl("run", "campaign.toml", "--store", "y.rig.sqlite", "--yes").status != 0
    again, _ = tried(silent, move=True)
    assert again.record.learned == checked.record.learned
    assert tried(silent, trigger=True)[0].record.learned == checked.record.learned
    assert desk.rigctl("run", "campaign.toml", "--store", "z.rig.sqlite", "--yes").status == 0


HEADS = {
    "a_mm": HeadSettings(position="+x", tilt_deg=5.0),
    "b_mm": HeadSettings(position="+y", tilt_deg=5.0),
    "c_mm": HeadSettings(position="-x", tilt_deg=0.0),
}
GOOD = {"a_mm": 1.0038, "b_mm": 0.002, "c_mm": -1.0}


@pytest.mark.parametrize(
    ("changed", "item", "outcome", "words"),
    [
        ({}, "a_mm", "ok", ""),
        ({"a_mm": -1.0038}, "a_mm", "differs", "the wrong sign"),
        ({"a_mm": 2.0}, "a_mm", "differs", "+1.0038 mm expected"),
        ({"c_mm": 1.0}, "c_mm", "differs", "the wrong sign"),
        ({"a_mm": 0.002, "b_mm": 1.0038}, "heads", "differs", "exchanged"),
        ({"a_mm": math.nan}, "a_mm", "unknown", "no valid value"),
        ({"b_mm": 0.2}, "b_mm", "differs", "+0.0000 mm expected"),
    ],
)
def test_heads_are_told_apart_by_what_they_see(
    changed: dict[str, float], item: str, outcome: str, words: str
) -> None:
    found = {finding.item: finding for finding in lasers.along_x(HEADS, 1.0, {**GOOD, **changed}).values()}
    assert found[item].outcome == outcome
    assert words in found[item].found


@pytest.mark.parametrize(
    ("changed_mm", "outcome", "words"),
    [
        (-1.2614, "ok", "counter-clockwise"),
        (1.2614, "differs", "clockwise"),
        (-0.0220, "differs", "0.0174 of it"),
        (math.nan, "unknown", "no valid value"),
    ],
)
def test_the_sense_of_a_turn_shows_at_a_head(changed_mm: float, outcome: str, words: str) -> None:
    found = lasers.about_z("a_mm", HEADS["a_mm"], 72.0, 1.0, changed_mm)
    assert found.outcome == outcome
    assert words in found.found


# The person


@pytest.mark.parametrize(("typed", "goes_on"), [(b"done\n", True), (b"maybe\nskip\n", False)])
def test_somebody_at_a_terminal_is_asked_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch, typed: bytes, goes_on: bool
) -> None:
    near, far = os.openpty()
    with os.fdopen(far) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        said: list[str] = []
        os.write(near, typed)
        assert Hands(said.append, lambda: None, RealClock()).confirm("MOVES: it goes.") is goes_on
    os.close(near)
    assert said == ["MOVES: it goes. Type 'done' or 'skip'."]


def test_whoever_aborts_is_heard_while_a_question_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    def aborted() -> None:
        raise Aborted("by signal")

    near, far = os.openpty()
    with os.fdopen(far) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        with pytest.raises(Aborted):
            Hands(lambda _: None, aborted, RealClock()).confirm("MOVES: it goes.")
    os.close(near)
