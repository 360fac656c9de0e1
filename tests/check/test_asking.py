"""What each instrument is asked before anything moves, over the wire of its simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.keysight_meter import Keysight34465A
from drivers.newport_xps_socket import Reply, XpsSocket
from rigctl.check.asking import Asking
from rigctl.check.elsewhere import Elsewhere, found_elsewhere
from rigctl.check.record import ASKED_FOR
from rigctl.core.errors import InstrumentError, LinkTimeout
from rigctl.core.findings import Finding
from rigctl.files.rig_file import parse_rig, read_rig
from rigctl.rig import Rig, drivers_of
from tests.check.conftest import FASTER

ALL = "all-instruments.rig.toml"
Told = list[tuple[str, Finding]]
Ask = Callable[..., dict[str, Finding]]


@pytest.fixture
def made(campaigns: Path) -> Callable[..., Rig]:
    """The rig with one instrument of each kind, its settings and those of its simulators changed."""

    def make(simulator: str = "", *changes: tuple[str, str]) -> Rig:
        text = (campaigns / ALL).read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        text = text.replace("[lasers.laser_1_mm]", f"{simulator}\n\n[lasers.laser_1_mm]", 1)
        return Rig(parse_rig(text, Path("rig.toml")))

    return make


def asked(rig: Rig, name: str) -> dict[str, Finding]:
    """What the check says of one instrument, by item."""
    told: Told = []
    Asking(rig, lambda each, finding: told.append((each, finding))).ask_all()
    return {finding.item: finding for each, finding in told if each == name}


def test_nothing_differs_on_a_rig_as_its_file_says_and_nothing_moves(made: Any, wire: Any) -> None:
    told: Told = []
    asking = Asking(rig := made(), lambda name, finding: told.append((name, finding)))
    asking.ask_all()
    assert [each for each in told if each[1].outcome == "differs"] == []
    assert set(asking.identities) == set(rig.file.instruments)
    for name in rig.file.instruments:
        steps = [finding.step for each, finding in told if each == name]
        assert steps[:2] == ["found", "identity"], "first whether it is there, then who it is"
    assert not [each for each in told if each[1].step in ASKED_FOR and each[1].outcome != "unknown"], (
        "nothing is tried"
    )
    assert wire.motions == []
    assert all(finding.mend for _, finding in told if finding.outcome != "ok")


@pytest.mark.parametrize(
    ("simulator", "name", "item", "found", "mend"),
    [
        ("[instruments.rotation.simulator]\ntravel_max_deg = 90.0", "rotation", "travel", "-170 to 90", "= 90"),
        (
            "[instruments.rotation.simulator]\nspeed_max_deg_s = 5.0",
            "rotation",
            "speed",
            "allows 5",
            "speed_deg_s = 5",
        ),
        ("[instruments.spare_rotation.simulator]\nunit = 2", "spare_rotation", "unit", "counts in mm", "1SN7"),
        (
            '[instruments.spare_rotation.simulator]\nversion = "ESP300 Version 2.1 1/1/97"',
            "spare_rotation",
            "firmware",
            "2.1 1/1/97: older than 3.0",
            "updated by the maker",
        ),
        (
            '[instruments.accelerometer.simulator]\nfirmware = "A.02.14-02.40-02.14-00.49-02-01"',
            "accelerometer",
            "firmware",
            "A.02.14",
            "update it",
        ),
        ('[instruments.thermometer.simulator]\nfirmware = "A.02.14-x"', "thermometer", "firmware", "A.02", "update"),
    ],
)
def test_what_an_instrument_is_set_to_is_compared(
    made: Any, simulator: str, name: str, item: str, found: str, mend: str
) -> None:
    # The shipped file has a table for this simulator already.
    changes = [("[instruments.accelerometer.simulator]\nnoise_v_rms = 2e-5\n", "")]
    line = asked(made(simulator, *changes), name)[item]
    assert line.outcome == "differs"
    assert found in line.found
    assert mend in line.mend


@pytest.mark.parametrize(
    ("text", "outcome", "told"),
    [
        ("nan,320", "unknown", "'nan' is no number"),
        ("", "unknown", "expected 2 finite numbers"),
        ("20,80,1", "unknown", "expected 2 finite numbers"),
        ("0,0", "differs", "the controller allows 0 deg/s"),
    ],
)
def test_maxima_that_can_be_no_limits_are_told_and_the_check_goes_on(
    made: Any, monkeypatch: pytest.MonkeyPatch, text: str, outcome: str, told: str
) -> None:
    exchange = XpsSocket.exchange

    def odd(socket: XpsSocket, request: str, *how: Any) -> Reply:
        there = exchange(socket, request, *how)
        return Reply(0, text) if request.startswith("PositionerMaximumVelocity") else there

    monkeypatch.setattr(XpsSocket, "exchange", odd)
    lines = asked(made(), "rotation")
    assert lines["speed"].outcome == outcome
    assert told in lines["speed"].found
    # What a rig file cannot hold is no mend of it.
    assert lines["speed"].rig_file == {}
    assert "sense and unit" in lines


def test_an_error_without_a_mend_sends_to_the_manual(made: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Keysight34465A) -> None:
        raise InstrumentError('-113,"Undefined header" after *CLS')

    monkeypatch.setattr(Keysight34465A, "examine", refuse)
    line = asked(made(), "thermometer")["questions"]
    assert line.found == '-113,"Undefined header" after *CLS'
    assert line.mend == "look the code up in the instrument's manual, and remove its cause"


STAGE = "integer_registers = 50010           # GlobalIntegers, raised by the operator: a record has one each\n"


@pytest.mark.parametrize(
    ("simulator", "item", "found", "mend"),
    [
        ('units = "inch"', "unit", "counts in 'inch'", "UnitsName"),
        ("position_min_mm = -20.0", "travel", "are -20 to 25 mm", "position_min_mm = -20"),
        ("rigctl_program = false", "oscillation and capture", "no program 'rigctl.bcx'", "compile"),
    ],
)
def test_an_ensemble_is_asked_on_after_what_differs(
    made: Any, simulator: str, item: str, found: str, mend: str
) -> None:
    lines = asked(made("", (STAGE, f"{STAGE}{simulator}\n")), "stage")
    assert lines[item].outcome == "differs"
    assert found in lines[item].found
    assert mend in lines[item].mend
    assert list(lines)[-1] == "oscillation and capture"


def test_too_few_registers_are_told_with_how_many_more(made: Any) -> None:
    line = asked(made("", (STAGE, "integer_registers = 50\n")), "stage")["registers"]
    assert (line.outcome, "40 captured positions, 0.4 s" in line.found) == ("differs", True)
    assert "raise GlobalIntegers (parameter 124) by 5960" in line.mend


def test_faults_that_an_axis_ignores_are_named(made: Any) -> None:
    rig = made()
    stage = rig.instruments["stage"]
    stage.open()
    stage._link.tell("SETPARM X, 26, 16775163")  # without bits 2 and 11
    stage.close()
    line = asked(rig, "stage")["fault mask"]
    assert line.outcome == "differs"
    assert "positive hard limit, emergency stop" in line.found
    assert "set bits 2, 11 of FaultMask" in line.mend


def test_what_only_motion_tells_is_unknown(made: Any) -> None:
    silent = ('oscillate_distance = "amplitude"   # of this controller; on yours a millimetre tells', "#")
    line = asked(made("", silent), "stage")["oscillate_distance"]
    assert (line.step, line.outcome) == ("motion", "unknown")
    assert "rigctl check --move" in line.mend


def test_an_aperture_too_short_for_an_old_meter_is_mended(made: Any) -> None:
    old = 'noise_v_rms = 2e-5\nfirmware = "A.02.14-02.40-02.14-00.49-02-01"\noptions = []\n'
    rig = made("", ("aperture_s = 1e-3", "aperture_s = 1e-4"), ("noise_v_rms = 2e-5\n", old))
    line = asked(rig, "accelerometer")["aperture"]
    assert line.outcome == "differs"
    assert line.rig_file == {"aperture_s": 0.3e-3}


def test_more_memory_than_the_meter_has_is_mended(made: Any) -> None:
    line = asked(made("", ("aperture_s = 1e-3", "aperture_s = 1e-3\nmemory_readings = 60000")), "accelerometer")
    assert line["memory"].rig_file == {"memory_readings": 50_000}


def test_an_output_that_is_on_is_told(made: Any) -> None:
    rig = made()
    source = rig.instruments["spare_source"]
    source.open()
    source._link.send("OUTP2 ON")
    source.close()
    lines = asked(rig, "spare_source")
    assert (lines["output 1"].outcome, lines["output 2"].outcome) == ("ok", "differs")


def test_errors_of_others_are_told_and_taken_off_the_queues(made: Any) -> None:
    rig = made()
    for name, send in (("accelerometer", "NONSENSE 1"), ("spare_source", "NONSENSE 1")):
        rig.instruments[name].open()
        rig.instruments[name]._link.send(send)
        rig.instruments[name].close()
    rotation = rig.instruments["spare_rotation"]
    rotation.open()
    rotation._line.tell("1XX5")
    queues: dict[tuple[str, str], list[str]] = {}
    for _ in range(2):
        Asking(rig, lambda name, finding: queues.setdefault((name, finding.item), []).append(finding.found)).ask_all()
    for name in ("accelerometer", "spare_source", "spare_rotation"):
        first, second = queues[name, "error queue"]
        assert first.startswith("emptied of old errors: "), name
        assert second == "empty"


def test_a_soloist_is_asked_what_it_can_tell(made: Any) -> None:
    lines = asked(made("", ('unit = "mm"', 'unit = "unknown"')), "spare_stage")
    assert (lines["unit"].outcome, lines["fault mask"].outcome) == ("unknown", "unknown")
    assert "Soloist.chm" in lines["unit"].mend
    assert lines["state"].found == "not enabled, not homed"
    told = asked(made("", ('unit = "mm"', 'unit = "mm"\nposition_max_mm = 30.0')), "spare_stage")
    assert (told["unit"].outcome, told["travel"].outcome) == ("ok", "differs")
    later = asked(made('[instruments.spare_stage.simulator.dialect]\nparameters = "ensemble"'), "spare_stage")
    assert {later[item].outcome for item in ("unit", "fault mask", "travel", "deceleration")} == {"ok"}


def test_a_stage_that_moves_is_told(made: Any) -> None:
    rig = made()
    stage = rig.instruments["stage"]
    stage.open()
    stage.home()
    stage.oscillate(0.0, 2.0, 0.5, 60.0)
    stage.close()
    assert asked(rig, "stage")["motion now"].outcome == "differs"


class Plain:
    """An instrument as a driver from elsewhere may have it: it answers who it is, and no more."""

    def __init__(self, inner: Any) -> None:
        self.name, self.open, self.close, self.identify = inner.name, inner.open, inner.close, inner.identify


def test_a_driver_that_cannot_examine_is_asked_who_answers(made: Any) -> None:
    rig = made()
    rig.instruments["rotation"] = Plain(rig.instruments["rotation"])
    lines = asked(rig, "rotation")
    assert lines["who answers"].found.startswith("XPS-C8")
    assert lines["questions"].outcome == "unknown"


# Not where the rig file says


def test_an_instrument_that_is_nowhere_is_told_with_what_was_tried(desk: Any, dead_port: int) -> None:
    desk.rig(
        ('"virtual"', '"real"'),
        ('address = "sim:"                  # tcp://192.168.0.254:5001', f'address = "tcp://127.0.0.1:{dead_port}"'),
    )
    checked = desk.rigctl("check", "rig.toml", "--json")
    assert checked.status == 1
    (line,) = [line for line in checked.json["findings"] if line["outcome"] == "differs"]
    assert (line["instrument"], line["step"], line["item"]) == ("rotation", "found", "address")
    assert "tried besides: port 5001" in line["found"]
    assert line["mend"].startswith("check power and cable")
    assert "rotation" not in checked.json["instruments"]


def test_at_a_silent_line_it_is_said_where_each_is_asked_and_nobody_waits_long(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = made("", ('"virtual"', '"real"'), ('address = "sim:"', 'address = "serial:/dev/none?baud=9600"'))
    (name,) = [name for name, table in rig.file.instruments.items() if not table.simulated]
    waits_s: list[float] = []

    class Dead:
        """Takes everything and gives nothing."""

        address, guarded = "serial:/dev/none", False
        write, unread, close = (lambda *_: None), (lambda _: b""), (lambda _: None)

        def read_until(self, _: object, timeout_s: float) -> bytes:
            waits_s.append(timeout_s)
            raise LinkTimeout("nothing came; check the cable")

        read_exactly = read_until

    monkeypatch.setattr("rigctl.check.elsewhere.connector", lambda *_, **__: Dead)
    # Whatever instrument is on that line.
    for driver in drivers_of(rig.file).values():
        said: list[str] = []
        monkeypatch.setattr("rigctl.check.elsewhere.drivers_of", lambda _, driver=driver: {name: driver})
        assert found_elsewhere(rig, name, said.append) is None
        assert said[0] == f"{name}: no answer yet; asked at 115200 baud, parity N, 1 of 11"
        assert said[-1].endswith("11 of 11")
    assert len(waits_s) >= 22 * len(rig.file.instruments)
    assert max(waits_s) <= 1.0


def test_an_instrument_at_its_usual_port_is_found_there(
    desk: Any, real_rig: Any, monkeypatch: pytest.MonkeyPatch, dead_port: int
) -> None:
    rig = real_rig(FASTER)
    port = int(read_rig(rig).instruments["rotation"].address.rpartition(":")[2])
    monkeypatch.setattr(
        "rigctl.check.elsewhere.drivers_of",
        lambda file: {
            name: replace(driver, declaration=replace(driver.declaration, port=port))
            for name, driver in drivers_of(file).items()
        },
    )
    rig.write_text(rig.read_text().replace(f":{port}", f":{dead_port}"))
    lines = [
        line for line in desk.rigctl("check", rig, "--json").json["findings"] if line["instrument"] == "rotation"
    ]
    assert lines[0]["rig_file"] == {"address": f"tcp://127.0.0.1:{port}"}
    assert [line["outcome"] for line in lines[1:3]] == ["ok", "ok"]


def test_a_place_that_answers_once_and_never_again_is_given_up(made: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = made()
    silent = Silent(rig.instruments["rotation"])
    rig.instruments["rotation"] = silent
    monkeypatch.setattr("rigctl.check.asking.found_elsewhere", lambda *_: Elsewhere("tcp://x:1", "port 1", silent))
    lines = asked(rig, "rotation")
    assert silent.opened == 2
    assert lines["address"].outcome == "differs"


class Silent(Plain):
    """Connects and says nothing."""

    def __init__(self, inner: Any) -> None:
        super().__init__(inner)
        self.opened = 0
        self.open = self._open

    def _open(self) -> None:
        self.opened += 1
        raise LinkTimeout("nothing came; check the cable")
