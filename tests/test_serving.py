"""`rigctl simulate`: a rig on real ports and pseudo-terminals, for our clients and for others'."""

from __future__ import annotations

import json
import math
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial

from rigctl.campaign.session.operator_link import TcpOperatorLink
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.core.clock import RealClock
from rigctl.core.errors import ConfigError
from rigctl.files.rig_file import parse_rig, read_rig
from rigctl.serving import Served

SERVED = (
    ("clock_speed = 1.0", "clock_speed = 40.0"),
    # A millisecond on the way is 40 of these.
    ("heads = { laser_1_mm = 1", "start_u_s = 0.1\nheads = { laser_1_mm = 1"),
    ("heads = { laser_3_mm = 1", "start_u_s = 0.1\nheads = { laser_3_mm = 1"),
    ("seed = 2022", "seed = 2022\nremount_s = 10.0\nlevel_s = 5.0"),
)
SHORT = (('["pendulum", "flag"]', '["pendulum"]'), ("noise_check_s = 20.0", "noise_check_s = 0.0"))
TIMEOUT_S = 10.0


class Simulator:
    """`rigctl simulate` in another process."""

    def __init__(self, desk: Any, *options: object) -> None:
        self.process: subprocess.Popen[str] = desk.process("simulate", "rig.toml", "--json", *options)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, self.process.communicate()
        self.instruments = {each["name"]: each for each in json.loads(line)["instruments"]}

    def ask(self, name: str, line: bytes, terminator: bytes = b"\n") -> bytes:
        """Send a line to a TCP instrument over a raw socket and read the answer."""
        where = self.instruments[name]
        with socket.create_connection((where["host"], where["port"]), timeout=TIMEOUT_S) as link:
            link.sendall(line)
            with link.makefile("rb") as answers:
                answer = b""
                while not answer.endswith(terminator):
                    byte = answers.read(1)
                    assert byte, answer
                    answer += byte
                return answer

    def ask_serially(self, name: str, line: bytes) -> bytes:
        """Send a line to a pseudo-terminal with pyserial and read the answer."""
        where = self.instruments[name]
        with serial.Serial(where["device"], where["baud"], timeout=TIMEOUT_S) as port:
            port.write(line)
            return bytes(port.read_until(b"\r"))

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """Interrupt it; its status and what it said on stderr."""
        self.process.send_signal(number)
        _, err = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, err


def motion(found: Any) -> np.ndarray:
    return np.array([null["vector_coc"] for null in found["result"]["nulls"]])


def test_a_campaign_over_the_wire_finds_what_the_embedded_one_finds_within_its_sigma(desk: Any) -> None:
    desk.rig(*SERVED)
    embedded = desk.rigctl("run", "campaign.toml", "--store", "embedded", "--yes", "--json").json
    simulator = Simulator(desk, "--write-rig", "client.toml")
    client = (desk.directory / "client.toml").read_text()
    assert "\n[world" not in client
    assert '"sim:"' not in client

    remote = desk.rigctl("run", "campaign.toml", "--rig", "client.toml", "--store", desk.store, "--yes", "--json")
    assert remote.status == 0, remote.err
    assert not (desk.directory / "x.rig.sqlite.truth.toml").exists()
    for ours, theirs in zip(remote.json["result"]["nulls"], embedded["result"]["nulls"], strict=True):
        sigma_deg = math.hypot(ours["theta0_sigma_arcsec"], theirs["theta0_sigma_arcsec"]) / 3600.0
        assert 0.0 < sigma_deg < math.hypot(15.0, 15.0) / 3600.0
        assert abs(ours["theta0_deg"] - theirs["theta0_deg"]) < 4.0 * sigma_deg
    sigma_rad = np.radians([null["theta0_sigma_arcsec"] / 3600.0 for null in embedded["result"]["nulls"]])
    apart = np.linalg.norm(motion(remote.json) - motion(embedded), axis=1)
    assert (apart < 4.0 * math.sqrt(2.0) * sigma_rad).all()
    with Store.open(desk.store, readonly=True) as store:
        assert store.identities()["lasers_a"]["model"] == "LK-G3001"
        assert store.header.world_sha256 is None
    assert simulator.end() == (0, "")


MULTIMETER = (
    'driver = "keysight-34465a"\naddress = "sim:"                  # TCPIP::192.168.0.20::5025::SOCKET',
    ('driver = "keysight-3458a"\naddress = "sim:"'),
)
GCS = (
    ('driver = "newport-xps"', 'driver = "pi-gcs2"\nunit = "deg"'),
    ('group = "Group1"\npositioner = "Pos"\n', ""),
)
LKG5000 = (('driver = "keyence-lkg3001"', 'driver = "keyence-lkg5000"\ntiming_pulse_s = 4e-3'),) * 2
SOLOIST = ('driver = "aerotech-ensemble"', 'driver = "aerotech-soloist"\nunit = "mm"'), ('axis = "X"\n', "")


def test_a_campaign_with_a_gcs_stage_a_soloist_lkg5000s_and_a_3458a_over_the_wire_finds_the_same(desk: Any) -> None:
    desk.campaign(*SHORT)
    desk.rig(*SERVED)
    by_others = desk.rigctl("run", "campaign.toml", "--store", "others", "--yes", "--json").json["result"]
    desk.rig(*SERVED, *GCS, *SOLOIST, *LKG5000, MULTIMETER)
    simulator = Simulator(desk, "--write-rig", "client.toml")
    ran = desk.rigctl("run", "campaign.toml", "--rig", "client.toml", "--store", desk.store, "--yes", "--json")
    assert ran.status == 0, ran.err
    assert ran.json["status"]["runs_done"] == ran.json["status"]["runs_planned"]
    for ours, theirs in zip(ran.json["result"]["nulls"], by_others["nulls"], strict=True):
        sigma_deg = math.hypot(ours["theta0_sigma_arcsec"], theirs["theta0_sigma_arcsec"]) / 3600.0
        assert abs(ours["theta0_deg"] - theirs["theta0_deg"]) < 4.0 * sigma_deg
    with Store.open(desk.store, readonly=True) as store:
        identities = store.identities()
        models = [identities[name]["model"] for name in ("rotation", "stage", "lasers_a", "accelerometer")]
        assert models == ["C-863.12", "Soloist", "LK-G5000", "HP3458A"]
    assert simulator.end() == (0, "")


def test_a_campaign_aborted_over_the_wire_leaves_the_served_stages_at_rest(desk: Any) -> None:
    desk.rig(*SERVED)
    desk.campaign(*SHORT)
    simulator = Simulator(desk, "--write-rig", "client.toml")
    process = desk.process("run", "campaign.toml", "--rig", "client.toml", "--store", desk.store, "--yes", "--json")

    desk.until(lambda: desk.runs() >= 1, process)
    desk.rigctl("run", "campaign.toml", "--rig", "client.toml", "--store", "other").refused(
        1, "client.toml", "another campaign holds these instruments"
    )
    process.send_signal(signal.SIGINT)
    ended = desk.end(process)
    assert (ended.status, ended.err.splitlines()[-1]) == (130, "aborted: interrupted by SIGINT")
    assert simulator.ask("stage", b"PFBK(X)\n") == simulator.ask("stage", b"PFBK(X)\n")


TCP = ("rotation", "stage", "lasers_a", "lasers_b", "accelerometer", "thermometer", "operator")


def at_ports(text: str, ports: dict[str, int]) -> str:
    """A rig file's text with every address fixed on loopback."""
    for name, port in ports.items():
        head = f"[instruments.{name}]\n"
        where = text.find(head)
        if where < 0:
            text = f'[{name}]\naddress = "tcp://127.0.0.1:{port}"\n\n{text}'
        else:
            text = text[:where] + text[where:].replace('"sim:"', f'"tcp://127.0.0.1:{port}"', 1)
    return text


@pytest.fixture
def ports() -> dict[str, int]:
    """A free port for each."""
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in TCP]
        return {name: probe.getsockname()[1] for name, probe in zip(TCP, probes, strict=True)}


def test_a_simulator_that_goes_away_costs_no_run_and_may_come_back(desk: Any, ports: dict[str, int]) -> None:
    desk.campaign(*SHORT)
    rig = desk.rig(*SERVED)
    rig.write_text(at_ports(rig.read_text(), ports))
    simulator = Simulator(desk, "--write-rig", "client.toml")
    assert {name: each["port"] for name, each in simulator.instruments.items()} == ports
    process = desk.process("run", "campaign.toml", "--rig", "client.toml", "--store", desk.store, "--yes", "--json")
    desk.until(lambda: desk.runs() >= 1, process)
    simulator.process.kill()
    desk.until(lambda: status_of(desk.store)["state"] == "paused", process)
    assert "waiting for an instrument: rotation: tcp://" in status_of(desk.store)["step"]

    again = Simulator(desk)
    ended = desk.end(process)
    assert ended.status == 0, ended.err
    assert ended.json["status"]["runs_done"] == 3
    assert "Traceback" not in ended.err
    stands = json.loads(again.ask("operator", b'{"stands": true}\n'))["stands"]
    assert stands[0] == {"remount": {"axis": "X", "configuration": "pendulum", "mounting": 1}}
    assert again.end(signal.SIGTERM) == (0, "")
    with Store.open(desk.store, readonly=True) as store:
        (levelled,) = store.events("levelled")
        (lost, *_), (back,) = store.events("instrument-lost"), store.events("instruments-back")
    assert stands[1]["level"]["at_s"] == levelled.data["at_s"]
    assert "check power and cable" in lost.data["text"]
    assert back.data["after_s"] > 0.0


def test_a_campaign_killed_over_the_wire_finds_its_package_as_it_left_it(desk: Any) -> None:
    desk.campaign(*SHORT)
    desk.rig(*SERVED)
    simulator = Simulator(desk, "--write-rig", "client.toml")
    process = desk.process("run", "campaign.toml", "--rig", "client.toml", "--store", desk.store, "--yes", "--json")
    desk.until(lambda: desk.runs() >= 1, process)
    process.kill()
    stood = json.loads(simulator.ask("operator", b'{"stands": true}\n'))
    resumed = desk.rigctl("resume", desk.store, "--json")
    assert resumed.status == 0, resumed.err
    stands = json.loads(simulator.ask("operator", b'{"stands": true}\n'))
    assert stands["stands"] == stood["stands"]
    with Store.open(desk.store, readonly=True) as store:
        times_s = [event.rig_time_s or 0.0 for event in store.events()]
    assert times_s == sorted(times_s), "its clock was put back"


def test_a_world_started_anew_is_made_as_it_stood(desk: Any) -> None:
    made: list[dict[str, Any]] = [
        {"room": {"temperature_c": 21.5}},
        {"remount": {"axis": "Y", "configuration": "flag", "mounting": 2}},
    ]
    file = desk.rig(("clock_speed = 1.0", "clock_speed = 1e6"))
    with running(file) as (world, address):
        link = TcpOperatorLink(address, RealClock(1e6))
        for action in (*made, {"level": True}):
            assert link.request(action)["done"]
        stood, late_s = world.simulation.bench.stands(), world.simulation.clock.now_s()
    assert [next(iter(each)) for each in stood] == ["room", "remount", "level"]
    file.write_text(f'[operator]\naddress = "{address}"\n' + file.read_text())
    with running(file) as (world, _):
        assert world.simulation.bench.stands() == []
        assert link.request({"run": 7})["stands"] == stood
        assert world.simulation.clock.now_s() > late_s


# One of each kind


def test_one_instrument_of_each_kind_answers_clients_written_by_others(desk: Any) -> None:
    desk.rig(*SERVED, of="all-instruments.rig.toml")
    all_instruments = Simulator(desk, "--write-rig", "client.toml")
    kinds = {each["kind"] for each in all_instruments.instruments.values()}
    assert kinds == {
        "newport-xps", "newport-esp301", "pi-gcs2", "aerotech-ensemble", "aerotech-soloist", "keyence-lkg3001",
        "keyence-lkg5000", "keysight-34465a", "keysight-3458a", "keysight-33500b", "operator",
    }  # fmt: skip
    where = all_instruments.instruments
    assert (where["rotation"]["group"], where["rotation"]["positioner"]) == ("Group1", "Pos")
    assert where["stage"]["axis"] == "X"
    assert where["lasers_a"]["baud"] == 115200
    ask, ask_serially = all_instruments.ask, all_instruments.ask_serially
    assert ask("rotation", b"FirmwareVersionGet(char *)", b"EndOfAPI").startswith(b"0,XPS")
    assert ask("rotation", b"GroupStatusGet(Group1,int *)", b"EndOfAPI").startswith(b"0,")
    assert ask("stage", b"VERSION\n").startswith(b"%4.")
    assert ask("spare_stage", b"AXISSTATUS\n").startswith(b"%")
    assert ask("accelerometer", b"*IDN?\n").split(b",")[1] == b"34465A"
    assert float(ask("accelerometer", b"MEAS:VOLT:DC?\n")) == pytest.approx(0.0, abs=0.1)
    assert float(ask("thermometer", b"MEAS:TEMP? FRTD,85\n")) == pytest.approx(20.0, abs=2.0)
    assert ask("spare_source", b"SOUR2:FUNC DC;VOLT:OFFS 1.5;OFFS?\n") == b"+1.50000000000000E+00\n"
    assert ask("spare_meter", b"ID?\n") == b"HP3458A\r\n"
    assert ask_serially("lasers_a", b"M1\r").startswith(b"M1,")
    assert ask("spare_lasers", b"MS,01\r", b"\r").startswith(b"MS,01,")
    assert b"ESP301" in ask_serially("spare_rotation", b"VE?\r")
    assert json.loads(ask("operator", b'{"level": true}\n'))["error"].startswith("nothing to level")
    assert "done" in json.loads(ask("operator", b'{"run": 3}\n'))
    assert "error" in json.loads(ask("operator", b"nonsense\n"))
    assert set(desk.rigctl("check", "client.toml", "--json").json["instruments"]) == set(where) - {"operator"}
    # What one client moves another sees.
    moved = desk.rigctl("move", "client.toml", "rotation", "12.5", "--json").json["value"]
    assert moved == pytest.approx(12.5, abs=1e-3)
    found = ask("rotation", b"GroupPositionCurrentGet(Group1,double *)", b"EndOfAPI")
    assert float(found.split(b",")[1]) == pytest.approx(12.5, abs=1e-3)
    request = {"remount": {"axis": "X", "configuration": "flag", "mounting": 1}}
    assert json.loads(ask("operator", json.dumps(request).encode() + b"\n"))["done"] is True
    assert all_instruments.end() == (0, "")


XPS, ESP301 = 'driver = "newport-xps"', 'driver = "newport-esp301"'
FASTER = "clock_speed = 1.0", "clock_speed = 5.0"
NAMES = 'group = "Group1"\npositioner = "Pos"\n'


def test_a_stop_has_who_uses_a_serial_line_leave_it_at_rest(desk: Any) -> None:
    file = desk.rig((XPS, ESP301), (NAMES, ""), FASTER, of="all-instruments.rig.toml")
    with running(file) as (world, _):
        (desk.directory / "client.toml").write_text(world.rig_text())
        axis, clock = world.simulation.bench.axes["rotation"], world.simulation.clock
        process = desk.process("move", "client.toml", "rotation", 170)
        desk.until(lambda: axis.position(clock.now_s()) > 1.0, process)
        stopped = desk.rigctl("stop", "client.toml", "--json")
        assert not axis.moving(clock.now_s())
        assert axis.position(clock.now_s()) < 169.0
    assert stopped.json["not_confirmed"] == []
    assert {"rotation", "lasers_a"} <= set(stopped.json["stopped"])
    ended = desk.end(process)
    assert (ended.status, ended.err.splitlines()[-1]) == (130, "aborted: interrupted by SIGTERM")


# Rig files as they are written for clients


@contextmanager
def running(file: Path) -> Iterator[tuple[Served, str]]:
    """A rig served by a thread of this process, and the address of its operator's port."""
    with Served(read_rig(file)) as made:
        (operator,) = [each for each in made.addresses if each["kind"] == "operator"]
        thread = threading.Thread(target=made._server.serve)
        thread.start()
        try:
            yield made, f"tcp://127.0.0.1:{operator['port']}"
        finally:
            made.stop()
            thread.join()


@contextmanager
def served(text: str) -> Iterator[Served]:
    with Served(parse_rig(text, Path("rig.toml"))) as made:
        yield made


@pytest.fixture
def text(campaigns: Path) -> str:
    return (campaigns / "all-instruments.rig.toml").read_text()


def test_a_written_rig_file_says_the_same_but_for_addresses_clock_and_world(text: str) -> None:
    with served(text) as made:
        client = parse_rig(made.rig_text(), Path("client.toml"))
    original = parse_rig(text, Path("rig.toml"))
    assert client.world is None
    assert client.rig == original.rig.model_copy(update={"clock": "real"})
    assert (client.package, client.lasers, client.constants) == (
        original.package,
        original.lasers,
        original.constants,
    )
    for name, table in client.instruments.items():
        assert table.model_copy(update={"address": "sim:"}) == original.instruments[name]
        serial = table.driver in {"keyence-lkg3001", "newport-esp301", "pi-gcs2"}
        assert table.address.startswith("serial:/dev/" if serial else "tcp:")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[rig]\n", '[operator]\naddress = ""\n[rig]\n'),
        ("[rig]\n", "[operator]\n[rig]\n"),
        ('clock = "virtual"', ""),
        ('address = "sim:"', "address = 'sim:'"),
        ("[instruments.rotation]\n", "[instruments.rotation]  # on the table\n"),
    ],
)
def test_a_rig_file_may_be_written_in_several_ways(text: str, old: str, new: str) -> None:
    assert old in text
    with served(text.replace(old, new)) as made:
        client = parse_rig(made.rig_text(), Path("client.toml"))
        listed = {each["name"]: each for each in made.addresses}
    assert client.operator.address == f"tcp://127.0.0.1:{listed['operator']['port']}"
    assert client.instruments["rotation"].address == f"tcp://127.0.0.1:{listed['rotation']['port']}"
    assert client.rig.clock == "real"


def test_instruments_that_cannot_be_rewritten_are_refused(text: str) -> None:
    inline = 'rotation = { driver = "newport-xps", address = "sim:", role = "rotation" }'
    start, end = text.index("[instruments.rotation]"), text.index("[instruments.stage]")
    message = r"rig.toml: write every instrument as a table \[instruments.NAME\]"
    with (
        served(f"{text[:start]}[instruments]\n{inline}\n{text[end:]}") as made,
        pytest.raises(ConfigError, match=message),
    ):
        made.rig_text()


def test_hislip_addresses_and_fixed_ports_are_honoured(text: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    start = text.index("[instruments.accelerometer]")
    fixed = text[:start] + text[start:].replace("sim:", f"TCPIP::127.0.0.1::hislip0,{port}::INSTR", 1)
    with served(fixed) as made:
        (found,) = [each for each in made.addresses if each["name"] == "accelerometer"]
        assert (found["transport"], found["port"]) == ("hislip", port)
        assert f"TCPIP::127.0.0.1::hislip0,{port}::INSTR" in made.rig_text()


def test_a_port_that_is_taken_is_named(text: str, desk: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        desk.rig(('"sim:"', f'"tcp://127.0.0.1:{port}"'))
        desk.rigctl("simulate", "rig.toml", "--json").refused(2, "rotation", f"port {port}", "choose another")


def test_serving_needs_a_world_and_good_tables(desk: Any) -> None:
    text = desk.rig().read_text()
    desk.rig((text[text.index("# Nature.") :], ""))
    desk.rigctl("simulate", "rig.toml").refused(2, "rig.toml", "[world]")
    desk.rig(("angle_min_deg", "angle_min"))
    desk.rigctl("simulate", "rig.toml").refused(2, "rig.toml", "unknown key instruments.rotation.angle_min")


def test_serving_is_ended_from_another_thread(text: str) -> None:
    with served(text) as made:
        thread = threading.Timer(0.05, made.stop)
        thread.start()
        made.serve()
        thread.join()
