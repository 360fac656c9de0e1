"""The record of what was measured: what drivers hand on without a fault, and what it was when a wire spoils it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.core.errors import ConfigError
from rigctl.files.rig_file import RigFile, parse_rig
from rigctl.rig import Rig
from rigctl.serving import Served
from simulators.measured import Measured, Measurement, from_file, into_file, joined

RIG = Path(__file__).parent.parent.parent / "campaigns" / "all-instruments.rig.toml"
SAMPLES, PERIOD_S = 600, 0.004


def rig_file(addition: str = "", world: str = "") -> RigFile:
    text = RIG.read_text(encoding="utf-8").replace("[world]\n", f"{addition}\n[world]\n{world}\n", 1)
    return parse_rig(text, RIG)


def record(rig: Rig) -> dict[str, np.ndarray]:
    """One run of every recorder and a look at the rest, as the drivers give it, by column."""
    stage, readout = rig.only("linear"), rig.only("readout")
    rig.only("rotation").home()
    rig.instruments["spare_rotation"].home()
    stage.home()
    stage.oscillate(0.0, 4.0, 0.5, 30.0)
    lasers = rig.by_role("displacement")
    stage.arm(SAMPLES, PERIOD_S)
    for laser in lasers:
        laser.prepare(SAMPLES, PERIOD_S)
        laser.begin()
    readout.start(SAMPLES, PERIOD_S)
    rig.clock.sleep_s(SAMPLES * PERIOD_S + 1.0)
    columns = {"accel_v": readout.fetch()[:, 0]}
    for recorder, values in ((stage, stage.collect()), *((laser, laser.finish().values) for laser in lasers)):
        columns |= {channel.name: values[:, i] for i, channel in enumerate(recorder.channels())}
    columns["temperature_c"] = np.array([rig.only("thermometer").temperature().value])
    columns["theta_deg"] = np.array([rig.only("rotation").angle().value])
    return columns


def latest(kept: list[Measurement], instrument: str, channel: str) -> np.ndarray:
    mine = [each for each in kept if (each.instrument, each.channel) == (instrument, channel)]
    return np.concatenate([each.values for each in mine if each.record == mine[-1].record])


SOURCES = {
    "accel_v": "accelerometer",
    "stage_x_mm": "stage",
    "laser_1_mm": "lasers_a",
    "laser_2_mm": "lasers_a",
    "laser_3_mm": "lasers_b",
    "temperature_c": "thermometer",
    "theta_deg": "rotation",
}


def test_what_drivers_hand_on_is_what_was_measured() -> None:
    with Rig(rig_file()) as rig:
        assert rig.simulation is not None
        kept = rig.simulation.measured.keep()
        rig.simulation.request({"run": 7})
        columns = record(rig)
    end_s = rig.clock.now_s()
    for column, instrument in SOURCES.items():
        truth = latest(kept, instrument, column)[-len(columns[column]) :]
        np.testing.assert_allclose(columns[column], truth, rtol=1e-8, atol=1e-12, err_msg=column)
    assert np.ptp(columns["stage_x_mm"]) > 1.0
    assert {each.run for each in kept} == {7}
    for each in kept:
        assert np.all(np.diff(each.at_s) > 0), each
        assert each.at_s[-1] <= end_s, each
    assert latest(kept, "rotation", "true theta_deg")[-1] == pytest.approx(columns["theta_deg"][0], abs=1e-4)
    assert latest(kept, "stage", "true stage_x_mm") == pytest.approx(columns["stage_x_mm"], abs=1e-5)
    (captured,) = [each for each in joined(kept) if each.channel == "stage_x_mm"]
    (volts,) = [each for each in joined(kept) if each.channel == "accel_v"]
    assert captured.at_s == pytest.approx(volts.at_s, abs=1e-9)


def test_a_second_record_is_told_from_the_first() -> None:
    with Rig(rig_file()) as rig:
        assert rig.simulation is not None
        kept = rig.simulation.measured.keep()
        record(rig)
        record(rig)
    for column, instrument in SOURCES.items():
        numbers = {each.record for each in kept if (each.instrument, each.channel) == (instrument, column)}
        # An LK-G3001 has stored a few values before, when it was found out how it does that.
        assert len(numbers) == {"theta_deg": 1, "l": 3}.get(column if column == "theta_deg" else column[0], 2), column


def test_a_source_tells_what_it_puts_on_its_outputs() -> None:
    with Rig(rig_file()) as rig:
        assert rig.simulation is not None
        kept = rig.simulation.measured.keep()
        wire = rig.simulation.instruments["spare_source"].connect(lambda _: None)
        wire.receive(b"SOUR2:FUNC DC\nOUTP2:LOAD INF\nSOUR2:VOLT:OFFS 0.125\nOUTP2 ON\n")
        (now_v,) = kept[-1].values
        assert (kept[-1].instrument, kept[-1].channel, now_v) == ("spare_source", "2", 0.125)


def test_a_spoilt_wire_leaves_the_truth_alone() -> None:
    spoilt = '[instruments.thermometer.faults]\nwrong_identity = { text = "E+01", instead = "E+02" }\n'
    with Rig(rig_file(spoilt)) as rig:
        assert rig.simulation is not None
        kept = rig.simulation.measured.keep()
        read_c = rig.only("thermometer").temperature().value
    assert read_c == pytest.approx(10 * latest(kept, "thermometer", "temperature_c")[-1])


def test_a_file_holds_the_same(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    measured = Measured()
    kept = measured.keep()
    measured.listen(into_file(path))
    tap = measured.tap("lasers", {"1": "laser_1_mm"})
    tap.begin()
    tap.note("1", [0.1, 0.2, 0.3], [1.5, np.nan, -np.inf])
    measured.run = 3
    tap.note("2", 1.0 / 3.0, 2.0 / 3.0)
    with path.open("a") as file:
        file.write('{"instrument": "cut')
    for written, told in zip(from_file(path), kept, strict=True):
        assert (written.instrument, written.channel, written.run, written.record) == (
            told.instrument,
            told.channel,
            told.run,
            told.record,
        )
        np.testing.assert_array_equal(written.at_s, told.at_s)
        np.testing.assert_array_equal(written.values, told.values)
    assert kept[0].channel == "laser_1_mm"
    assert np.isnan(kept[0].values[1:]).all()


def test_where_a_stage_is_and_what_it_believes_differ_when_its_reference_is_lost() -> None:
    cycle = "[instruments.rotation.faults]\npower_cycle = { at_s = 60.0, lasting_s = 5.0 }\n"
    with Rig(rig_file(cycle)) as rig:
        assert rig.simulation is not None
        kept = rig.simulation.measured.keep()
        rig.only("rotation").home()
        rig.only("rotation").move_to(30.0)
        rig.clock.sleep_s(70.0 - rig.clock.now_s())
        wire = rig.simulation.instruments["rotation"].connect(lambda _: None)
        wire.receive(b"GroupPositionCurrentGet(Group1,double *)")
    assert latest(kept, "rotation", "theta_deg")[-1] == 0.0
    assert latest(kept, "rotation", "true theta_deg")[-1] == pytest.approx(30.0)


def test_pieces_of_a_record_are_put_together() -> None:
    measured = Measured()
    kept = measured.keep()
    tap = measured.tap("stage")
    for first_s in (3.0, 1.0, 3.0):
        tap.note("x", [first_s, first_s + 1.0], [10.0 * first_s, 10.0 * first_s + 10.0])
    tap.begin()
    tap.note("x", [], [])
    tap.note("x", 9.0, 90.0)
    assert len(kept) == 4
    one, other = joined(kept)
    assert one.at_s.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert one.values.tolist() == [10.0, 20.0, 30.0, 40.0]
    assert (other.record, other.values.tolist()) == (1, [90.0])


@pytest.mark.parametrize("how", ["world", "served"])
def test_a_rig_writes_it_where_it_is_told(tmp_path: Path, how: str) -> None:
    path = tmp_path / "truth.jsonl"
    kelvin: dict[str, Any] = {}
    if how == "world":
        with Rig(rig_file(world=f'measured = "{path}"')) as rig:
            kelvin["read"] = rig.only("thermometer").temperature().value
    else:
        with Served(rig_file(), measured=path) as served:
            served.simulation.instruments["thermometer"].connect(lambda _: None).receive(b"MEAS:TEMP? FRTD\n")
            served.simulation.clock.sleep_s(0.5)
    (found,) = [each for each in from_file(path) if each.instrument == "thermometer"][-1:]
    assert np.isfinite(found.values).all()
    assert kelvin.get("read", found.values[-1]) == pytest.approx(found.values[-1])


def test_a_place_that_cannot_be_written_is_named() -> None:
    with pytest.raises(ConfigError, match=r"world\.measured: cannot write /dev/null/truth"):
        Rig(rig_file(world='measured = "/dev/null/truth"'))
    with pytest.raises(ConfigError, match="cannot write /dev/null/truth"):
        Served(rig_file(), measured=Path("/dev/null/truth"))
