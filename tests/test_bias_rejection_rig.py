"""The shipped rig of the rotating platform: it opens, it measures, in this process and over loopback TCP."""

from __future__ import annotations

import json
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, LimitError
from rigctl.core.interfaces import StreamedRecorder, TimedRotationStage
from rigctl.core.voltage_sources import VoltageSource, Waveform
from rigctl.files.rig_file import RigFile, parse_rig, read_rig
from rigctl.rig import Rig, build_simulation
from simulators.clock import VirtualClock

RIG = "bias-rejection-rig.toml"
NAMES = ("platform", "q_a", "q_b", "tilt", "thermometer")
SIGMA_PERIOD_M_S2 = 1.808e-7 * 60.0**0.5
"""Of one period of a minute: the theory for an hour, sixty times less long (pattern c; b is some per cent worse)."""


@pytest.fixture
def file(campaigns: Path) -> RigFile:
    return read_rig(campaigns / RIG)


@dataclass
class Record:
    """Samples of one record, and the encoder's angle in each dwell."""

    start_s: float
    q_a_v: FloatArray
    q_b_v: FloatArray
    angles_deg: list[float]
    tilt: dict[str, Waveform]
    tilt_start_s: float


def modulate(
    rig: Rig, waveforms: dict[str, Waveform], period_s: float, turn_s: float, periods: int, *, lazily: bool = False
) -> Record:
    """Pattern (b): two turns a period, both meters read after each turn, or only at the end."""
    stage, a, b, source = rig.only("rotation"), rig.only("readout"), rig.only("voltmeter"), rig.only("source")
    if not stage.is_homed():
        stage.home()
    stage.turn_to(0.0, turn_s)
    started = source.start(waveforms)
    samples = round(10.0 * period_s * periods)
    b.follow(samples, 0.1)
    start_s = a.start(samples, 0.1)
    rows_a, rows_b, angles = [], [], [stage.angle().value]
    for begin_s in start_s + period_s * np.arange(periods):
        for at_s, target_deg in ((0.25 * period_s, 180.0), (0.75 * period_s, 0.0)):
            rig.clock.sleep_s(begin_s + at_s - 0.5 * turn_s - rig.clock.now_s())
            stage.turn_to(target_deg, turn_s)
            angles.append(stage.angle().value)
            if not lazily:
                rows_a.append(a.fetch())
                rows_b.append(b.fetch())
    while sum(map(len, rows_a)) < samples or sum(map(len, rows_b)) < samples:
        rig.clock.sleep_s(0.2)
        rows_a.append(a.fetch())
        rows_b.append(b.fetch())
    columns = (np.concatenate(rows)[:, 0] for rows in (rows_a, rows_b))
    return Record(start_s, *columns, angles, dict(started.waveforms), started.start_s)


def accelerations(record: Record, period_s: float, turn_s: float, periods: int) -> tuple[FloatArray, FloatArray]:
    """Mean a_z and a_y of each period by the projection, with a margin of two samples about each turn."""
    place = (0.1 * np.arange(len(record.q_a_v))) % period_s
    sign = np.where((place < 0.25 * period_s) | (place >= 0.75 * period_s), 1.0, -1.0)
    for centre in (0.25, 0.75):
        sign[np.abs(place - centre * period_s) < 0.5 * turn_s + 0.2] = 0.0
    kept = np.abs(sign).reshape(periods, -1).sum(axis=1)
    z, y = (
        (sign * volts).reshape(periods, -1).sum(axis=1) / kept / gain
        for volts, gain in ((record.q_a_v, 846.73), (record.q_b_v, 804.32))
    )
    return z, y


def test_every_instrument_is_what_the_experiment_asks_for(file: RigFile) -> None:
    with Rig(file) as rig:
        assert isinstance(rig.only("rotation"), TimedRotationStage)
        assert isinstance(rig.only("voltmeter"), StreamedRecorder)
        assert isinstance(rig.only("source"), VoltageSource)
        assert [rig.only(role).channels()[0].name for role in ("readout", "voltmeter")] == ["q_a_v", "q_b_v"]
        assert [channel.name for channel in rig.only("source").channels()] == ["dm1_y_v", "dm1_z_v"]
        assert rig.only("thermometer").temperature().value == pytest.approx(22.0, abs=0.5)
        assert {name: identity.model for name, identity in rig.identities().items()} == {
            "platform": "XPS-C8",
            "q_a": "34465A",
            "q_b": "34465A",
            "tilt": "33522B",
            "thermometer": "34465A",
        }


def test_a_modulation_gives_the_tilt_without_the_bias(file: RigFile) -> None:
    rig = Rig(file)
    with rig:
        assert rig.operator_link is not None
        assert "done" in rig.operator_link.request({"run": 1})
        record = modulate(rig, {"dm1_z_v": Waveform(offset_v=1.0)}, 60.0, 10.0, 40)
    z, y = accelerations(record, 60.0, 10.0, 40)
    sigma = 1.2 * SIGMA_PERIOD_M_S2
    assert z.mean() == pytest.approx(2.8757e-4 + 0.964 / 825.0, abs=4.0 * sigma / 40**0.5)
    assert y.mean() == pytest.approx(-2.98e-4, abs=4.0 * sigma / 40**0.5)
    assert z.std(ddof=1) == pytest.approx(sigma, rel=0.5)
    assert record.angles_deg[1::2] == pytest.approx([180.0] * 40, abs=1e-4)
    assert record.angles_deg[::2] == pytest.approx([0.0] * 41, abs=1e-4)


def test_a_run_taken_again_is_the_same_run(file: RigFile) -> None:
    records = []
    for before in ((), (7,)):
        with Rig(file) as rig:
            assert rig.operator_link is not None
            for number in (*before, 3):
                rig.operator_link.request({"run": number})
                record = modulate(rig, {}, 60.0, 10.0, 1)
            records.append(record)
    assert records[0].start_s != records[1].start_s
    assert np.array_equal(records[0].q_a_v, records[1].q_a_v)
    assert np.array_equal(records[0].q_b_v, records[1].q_b_v)


def test_it_does_not_matter_how_long_the_meters_keep_their_readings(file: RigFile) -> None:
    records = []
    for lazily in (False, True):
        with Rig(file) as rig:
            tilt = {"dm1_z_v": Waveform("triangle", 0.0, 1.0, 900.0)}
            records.append(modulate(rig, tilt, 1200.0, 10.0, 2, lazily=lazily))
    assert np.array_equal(records[0].q_a_v, records[1].q_a_v)
    assert np.array_equal(records[0].q_b_v, records[1].q_b_v)


def test_a_sine_of_the_source_is_what_the_platform_feels(file: RigFile) -> None:
    with Rig(file) as rig:
        record = modulate(rig, {"dm1_z_v": Waveform("sine", 0.0, 1.5, 20.0, 90.0)}, 60.0, 5.0, 2)
    first_s = record.start_s + 1e-3
    elapsed_s = first_s + 0.1 * np.arange(len(record.q_a_v)) - record.tilt_start_s
    command_v = record.tilt["dm1_z_v"].volts(elapsed_s)
    dwell = slice(0, 120)
    slope = np.polyfit(command_v[dwell], record.q_a_v[dwell], 1)[0]
    # White noise of 1.8e-2 V on 120 samples of a command of 1 V rms.
    assert slope == pytest.approx(846.73 / 855.81, abs=5.0 * 1.8e-2 / 120**0.5)


def test_the_flip_is_an_operators_action(file: RigFile) -> None:
    with Rig(file) as rig:
        link = rig.operator_link
        assert link is not None
        volts = {}
        for sign in (1, -1):
            link.request({"flip": sign})
            volts[sign] = rig.only("readout").voltage().value
        assert 1010.9 * (volts[1] - volts[-1]) / (2 * 9.81) == pytest.approx(846.73, abs=0.1)
        assert "no such action" in link.request({"level": True})["error"]
        assert "a flip is +1, -1" in link.request({"flip": 3})["error"]


def test_the_limits_of_the_rig_hold(file: RigFile) -> None:
    with Rig(file) as rig:
        rig.only("rotation").home()
        with pytest.raises(LimitError, match="540 deg is outside the limits -10 to 370 deg"):
            rig.only("rotation").turn_to(540.0, 20.0)
        with pytest.raises(LimitError, match=r"2\.5 V asked for, beyond the limit of 2 V"):
            rig.only("source").start({"dm1_z_v": Waveform("sine", 1.0, 1.5, 60.0)})


def test_leaving_the_rig_takes_the_tilt_away(file: RigFile) -> None:
    rig = Rig(file)
    with rig:
        rig.only("source").start({"dm1_z_v": Waveform(offset_v=1.0)})
        line = rig.simulation.bench.inputs["dm1_z_v"]  # type: ignore[union-attr]
        assert line.sample(np.array([rig.clock.now_s()])) == pytest.approx([1.0])
    assert line.sample(np.array([rig.clock.now_s() + 1.0])) == pytest.approx([0.0])


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('channel = "q_b_v"', 'channel = "accel_v"', r"no chain gives 'accel_v'; there are: q_a_v, q_b_v"),
        (
            "dm1_z_v = 2 }",
            "dm2_z_v = 2 }",
            "nothing is driven by 'dm2_z_v' in this world; inputs are: dm1_y_v",
        ),
        (
            'kind = "rotating-platform"',
            'kind = "swing"',
            "world.kind 'swing' is unknown; one of sensing-axis",
        ),
        ("seed = 2013", "seed = 2013\nadc = { bit = 3 }", "unknown key world.adc.bit; known there: range_v, bits"),
        (
            "seed = 2013",
            "seed = 2013\neffects = { line = { amplitude = 1.0 } }",
            "'line' needs a frequency",
        ),
        ("limit_v = 2.0", "limit_v = 12.0", "limit_v"),
    ],
)
def test_a_rig_file_that_makes_no_sense_is_refused_in_a_line(campaigns: Path, old: str, new: str, fault: str) -> None:
    text = (campaigns / RIG).read_text()
    assert old in text
    with pytest.raises(ConfigError, match=f"^rig.toml: .*{fault}") as refused:
        build_simulation(parse_rig(text.replace(old, new), Path("rig.toml")), VirtualClock())
    assert "\n" not in str(refused.value)


def test_check_names_every_instrument(desk: Any, campaigns: Path) -> None:
    found = desk.rigctl("check", campaigns / RIG, "--json")
    assert found.status == 0
    assert found.json["instruments"]["tilt"]["model"] == "33522B"
    assert len(found.json["instruments"]) == 5


def test_the_same_over_loopback_tcp(desk: Any, campaigns: Path) -> None:
    # Answers may be as late as a busy machine makes them.
    patient = [(f"[instruments.{name}]\n", f"[instruments.{name}]\nlink_timeout_s = 100.0\n") for name in NAMES]
    desk.rig(("clock_speed = 1.0", "clock_speed = 10.0"), *patient, of=RIG)
    process = desk.process("simulate", "rig.toml", "--json", "--write-rig", "client.toml")
    where = {each["name"]: each for each in json.loads(process.stdout.readline())["instruments"]}
    assert set(where) == {*NAMES, "operator"}
    assert (where["tilt"]["kind"], where["tilt"]["transport"]) == ("keysight-33500b", "tcp")
    with Rig.from_file(desk.directory / "client.toml") as rig:
        assert rig.simulation is None
        assert rig.operator_link is not None
        assert "done" in rig.operator_link.request({"run": 1})
        record = modulate(rig, {"dm1_z_v": Waveform(offset_v=1.5)}, 14.0, 3.5, 2)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=10.0)[1] == ""
    assert len(record.q_a_v) == len(record.q_b_v) == 280
    # How late a turn begins depends on how busy this machine is: only the dwells' middles are looked at.
    place = 0.1 * np.arange(280) % 14.0
    away = (place > 7.0) & (place < 8.0)
    home = (place < 1.0) | (place > 13.9)
    difference = record.q_a_v[home].mean() - record.q_a_v[away].mean()
    assert difference / 2.0 / 846.73 == pytest.approx(2.8757e-4 + 1.5 * 0.964 / 825.0, abs=5e-5)
