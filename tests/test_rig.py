"""A rig: opened as one, brought to rest as one, whatever its instruments do."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.transport import InProcessTransport
from procedures.sensing_axis.wiring import bench_of
from rigctl import runner
from rigctl.core.errors import ConfigError, LinkError, LinkLost, LinkTimeout, RigError, WrongInstrument
from rigctl.core.interfaces import Instrument, LinearStage, RotationStage, Thermometer, Voltmeter
from rigctl.files.rig_file import RigFile, read_rig
from rigctl.rig import DRIVERS, Rig, build_simulation
from simulators.clock import ScaledClock, VirtualClock
from simulators.rig import LockedInstrument


@pytest.fixture
def file(campaigns: Path) -> RigFile:
    return read_rig(campaigns / "isa-rig.toml")


def names(instruments: list[Any]) -> list[str]:
    return [instrument.name for instrument in instruments]


def test_instruments_are_made_closed_and_found_by_role(file: RigFile, wire: Any) -> None:
    rig = Rig(file)
    assert wire.sent == []
    assert all(isinstance(instrument, Instrument) for instrument in rig.instruments.values())
    assert isinstance(rig.only("rotation"), RotationStage)
    assert isinstance(rig.only("linear"), LinearStage)
    assert isinstance(rig.only("readout"), Voltmeter)
    assert isinstance(rig.only("thermometer"), Thermometer)
    assert names(rig.by_role("displacement")) == ["lasers_a", "lasers_b"]
    with pytest.raises(ConfigError, match=r"2 instruments with role 'displacement', needs one"):
        rig.only("displacement")


def test_an_opened_rig_knows_who_answered_and_has_not_moved(file: RigFile, wire: Any) -> None:
    with Rig(file) as rig:
        identities = rig.identities()
        assert wire.motions == []
    assert identities["rotation"].model.startswith("XPS")
    assert identities["lasers_a"].model == "LK-G3001"
    assert {identities[name].model for name in ("accelerometer", "thermometer")} == {"34465A"}


def test_every_driver_opens_on_its_simulator(campaigns: Path) -> None:
    file = read_rig(campaigns / "all-instruments.rig.toml")
    assert {table.driver for table in file.instruments.values()} == {
        driver.kind for driver in DRIVERS.sound() if driver.wired
    }
    with Rig(file) as rig:
        assert set(rig.identities()) == set(file.instruments)


def test_leaving_a_rig_stops_every_stage_whatever_happened(file: RigFile, wire: Any) -> None:
    rig = Rig(file)

    def work() -> None:
        with rig:
            rig.only("linear").home()
            rig.only("linear").oscillate(0.0, 5.0, 0.5, 60.0)
            wire.sent.clear()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert any(data.startswith(b"ABORT") for data in wire.sent)
    assert any(b"GroupMoveAbort" in data or b"GroupKill" in data for data in wire.sent)
    with pytest.raises(RigError):
        rig.only("linear").position()


def test_what_somebody_left_moving_is_at_rest_before_anything_else_is_asked_of_it(file: RigFile, wire: Any) -> None:
    real = file.model_copy(update={"rig": file.rig.model_copy(update={"clock": "real", "clock_speed": 100.0})})
    rig = Rig(real)
    rig.open()
    rig.only("linear").home()
    rig.only("linear").oscillate(0.0, 5.0, 0.5, 3600.0)
    rig.close()  # as a crash does
    wire.sent.clear()
    with rig:
        assert rig.found_moving == ("stage",)
        assert rig.moving() == ()
        assert wire.motions == []
    assert any(data.startswith(b"ABORT") for data in wire.sent)


def test_half_a_rig_is_brought_to_rest_when_the_other_half_does_not_answer(
    file: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[str] = []
    rig = Rig(file)
    for name, instrument in rig.instruments.items():
        monkeypatch.setattr(instrument, "stop", lambda name=name: stopped.append(name))
    monkeypatch.setattr(rig.instruments["lasers_a"], "open", failing(LinkLost("lasers_a: no connection")))
    with pytest.raises(LinkLost, match="lasers_a"):
        rig.__enter__()
    assert set(stopped) == set(file.instruments)


def failing(error: Exception) -> Any:
    def stop() -> None:
        raise error

    return stop


@pytest.mark.parametrize("error", [LinkLost("rotation: no connection"), ZeroDivisionError("rotation: a bug of ours")])
def test_an_instrument_that_will_not_stop_does_not_keep_the_others_from_it(
    file: RigFile, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[str] = []

    def work() -> None:
        with Rig(file) as rig:
            for name, instrument in rig.instruments.items():
                monkeypatch.setattr(instrument, "stop", lambda name=name: stopped.append(name))
            monkeypatch.setattr(rig.instruments["rotation"], "stop", failing(error))

    with pytest.raises(RigError, match=r"^NOT known to be at rest: rotation: "):
        work()
    assert sorted(stopped) == ["accelerometer", "lasers_a", "lasers_b", "stage", "thermometer"]


def test_what_could_not_be_stopped_is_told_beside_the_error_that_ended_it(
    file: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work() -> None:
        with Rig(file) as rig:
            monkeypatch.setattr(rig.instruments["rotation"], "stop", failing(LinkLost("rotation: no connection")))
            raise LinkTimeout("lasers_a: nothing came")

    with pytest.raises(LinkTimeout) as ended:
        work()
    assert str(ended.value) == "lasers_a: nothing came"
    assert ended.value.__notes__ == ["NOT known to be at rest: rotation: no connection"]


def test_one_failure_keeps_its_class_and_several_are_joined(file: RigFile, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(file)
    closed: list[str] = []
    for name, instrument in rig.instruments.items():
        monkeypatch.setattr(instrument, "close", lambda name=name: closed.append(name))
    monkeypatch.setattr(rig.instruments["stage"], "open", failing(WrongInstrument("stage: answers as another")))
    with pytest.raises(WrongInstrument, match=r"^stage: answers as another$"):
        rig.open()
    assert set(closed) == set(file.instruments), "nothing stays connected to half a rig"
    monkeypatch.setattr(rig.instruments["lasers_b"], "open", failing(LinkTimeout("lasers_b: nothing came")))
    with pytest.raises(RigError, match=r"^stage: answers as another; lasers_b: nothing came$"):
        rig.open()


def test_stop_from_another_thread_ends_an_oscillation(file: RigFile) -> None:
    real = file.model_copy(update={"rig": file.rig.model_copy(update={"clock": "real", "clock_speed": 100.0})})
    with Rig(real) as rig:
        stage = rig.only("linear")
        stage.home()
        stage.oscillate(0.0, 5.0, 0.5, 3600.0)
        assert rig.simulation is not None
        thread = threading.Thread(target=rig.stop)
        thread.start()
        thread.join()
        rig.clock.sleep_s(2.0)
        position_mm = stage.position().value
        rig.clock.sleep_s(1.3)
        assert stage.position().value == position_mm


def test_a_virtual_rig_runs_on_a_virtual_clock_and_a_real_one_on_the_wall_clock(file: RigFile) -> None:
    assert isinstance(Rig(file, start_s=500.0).clock, VirtualClock)
    assert Rig(file, start_s=500.0).clock.now_s() == 500.0
    real = Rig(file.model_copy(update={"rig": file.rig.model_copy(update={"clock": "real", "clock_speed": 50.0})}))
    assert isinstance(real.clock, ScaledClock)
    assert real.clock.speed == 50.0


def test_a_seed_replaces_the_rig_files(file: RigFile) -> None:
    def truth(seed: int | None) -> Any:
        simulation = build_simulation(file, VirtualClock(), seed=seed)
        simulation.request({"remount": {"axis": "X", "configuration": "flag", "mounting": 1}})
        return simulation.world.truth()

    assert truth(None) == truth(2022)
    assert truth(1) != truth(2022)
    assert truth(1) == truth(1)


def test_hands_that_are_asked_for_nonsense_say_what_there_is(file: RigFile) -> None:
    simulation = build_simulation(file, VirtualClock())
    for action in ({"level": True}, {"remount": {"axis": "Q", "configuration": "flag", "mounting": 1}}, {"dance": 1}):
        assert "error" in simulation.request(action)


class Listener:
    """An instrument and its connection; notes what happens to it."""

    kind = "listener"

    def __init__(self) -> None:
        self.heard: list[str] = []

    def connect(self, send: Callable[[bytes], None]) -> Listener:
        self.heard.append("connect")
        return self

    def receive(self, data: bytes) -> None:
        self.heard.append("receive")

    def close(self) -> None:
        self.heard.append("close")


@pytest.mark.parametrize("what", ["connect", "receive", "close"])
def test_instruments_in_this_process_are_talked_to_one_at_a_time(what: str) -> None:
    clock, listener = VirtualClock(), Listener()
    locked = LockedInstrument(listener, clock)
    connection = locked.connect(lambda _: None)
    talk = {
        "connect": lambda: locked.connect(lambda _: None),
        "receive": lambda: connection.receive(b"x"),
        "close": connection.close,
    }
    listener.heard.clear()
    thread = threading.Thread(target=talk[what])
    with clock.lock:
        thread.start()
        thread.join(0.05)
        assert listener.heard == [], "it is in the middle of an event"
    thread.join()
    assert listener.heard == [what]


def test_the_bench_of_a_rig_has_its_parts(file: RigFile) -> None:
    bench = bench_of(Rig(file))
    assert bench.rotation.name == "rotation"
    assert bench.linear.name == "stage"
    assert names(list(bench.lasers)) == ["lasers_a", "lasers_b"]
    assert set(bench.heads) == {"laser_1_mm", "laser_2_mm", "laser_3_mm"}
    assert bench.thermometer is not None
    assert bench.g_m_s2 == 9.803


def test_a_rig_without_lasers_or_thermometer_is_a_bench_as_well(desk: Any) -> None:
    text = desk.rig().read_text()
    start, end = text.index("[instruments.lasers_a]"), text.index("[instruments.accelerometer]")
    thermometer = text[text.index("[instruments.thermometer]") : text.index("# Where the heads stand")]
    desk.rig((text[start:end], ""), (thermometer, ""))
    found = desk.run()
    assert found.status == 0
    nulls = found.json["result"]["nulls"]
    assert [null["vector_coc"] for null in nulls] == [None, None]
    assert all(null["theta0_sigma_arcsec"] < 15.0 for null in nulls)


# Instruments that fail in the middle of a campaign


@pytest.mark.parametrize(
    ("table", "fault", "words"),
    [
        ("lasers_a", "silent = { after = 150 }", "lasers_a"),
        ("stage", "silent = { after = 1000 }", "NOT known to be at rest: "),
        ("rotation", "silent = { after = 36 }", "NOT known to be at rest: "),
        ("accelerometer", "silent = { after = 120 }", "accelerometer"),
        ("accelerometer", "truncated = { after = 120, keep_bytes = 1 }", "accelerometer"),
        ("thermometer", "silent = { after = 24 }", "thermometer"),
    ],
)
def test_an_instrument_that_fails_in_the_middle_costs_no_run_and_the_campaign_can_be_resumed(
    desk: Any, wire: Any, monkeypatch: pytest.MonkeyPatch, table: str, fault: str, words: str
) -> None:
    spoilt = f"[instruments.{table}.faults]\n{fault}\n[instruments.{table}]\n"
    desk.rig((f"[instruments.{table}]\n", spoilt))
    found = desk.run()
    assert found.status == 1
    assert found.out == ""
    assert words in found.err.splitlines()[-1]
    assert "Traceback" not in found.err
    assert "internal error" not in found.err
    status = desk.rigctl("status", desk.store, "--json").json
    assert status["state"] == "interrupted"
    assert 1 <= status["runs_done"] < 6
    last_motion = max(i for i, data in enumerate(wire.sent) if b"OSCILLATE" in data or b"MOVEABS" in data)
    after = b"".join(wire.sent[last_motion + 1 :])
    assert b"ABORT" in after
    assert b"GroupMoveAbort" in after or b"GroupKill" in after or table == "rotation"

    mended = runner.rig_file_of

    def without_faults(*arguments: Any, **options: Any) -> RigFile:
        file = mended(*arguments, **options)
        tables = {name: each.model_copy(update={"faults": {}}) for name, each in file.instruments.items()}
        return file.model_copy(update={"instruments": tables})

    monkeypatch.setattr(runner, "rig_file_of", without_faults)
    again = desk.rigctl("resume", desk.store, "--json")
    assert again.status == 0, again.err
    assert again.json["status"]["runs_done"] == 6
    assert len(again.json["result"]["nulls"]) == 2


def test_an_error_on_the_wire_is_one_of_ours(file: RigFile, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut(self: InProcessTransport, _: bytes) -> None:
        raise LinkLost(f"{self.address}: no connection")

    with Rig(file) as rig, monkeypatch.context() as patch:
        patch.setattr(InProcessTransport, "write", cut)
        with pytest.raises(LinkError, match="stage"):
            rig.only("linear").position()
