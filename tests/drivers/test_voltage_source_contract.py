"""What every voltage source must do, whatever it speaks: one suite, run over each driver."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from drivers.keysight_33500b import Keysight33500B, SourceSettings
from drivers.transport import InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkLost
from rigctl.core.voltage_sources import VoltageSource, Waveform
from simulators.clock import SimulationClock, VirtualClock
from simulators.keysight_33500b import Simulated33500B
from simulators.wiring import VoltageLine


class Tap:
    """Passes bytes on to a simulator and counts connections and messages."""

    def __init__(self, simulator: Any) -> None:
        self.simulator = simulator
        self.connections = 0
        self.messages = 0

    def connect(self, send: Callable[[bytes], None]) -> Any:
        self.connections += 1
        connection = self.simulator.connect(send)
        receive = connection.receive

        def tapped(data: bytes) -> None:
            self.messages += 1
            receive(data)

        connection.receive = tapped
        return connection


@dataclass
class Bench:
    source: VoltageSource
    lines: dict[str, VoltageLine]
    tap: Tap
    clock: SimulationClock

    def volts(self, output: str, times_s: Any) -> Any:
        return self.lines[output].sample(np.asarray(times_s, dtype=np.float64))


def bench_33500b() -> Bench:
    clock, lines = VirtualClock(), {1: VoltageLine(), 2: VoltageLine()}
    tap = Tap(Simulated33500B(clock, lines))
    source = Keysight33500B("source", SourceSettings(), lambda: InProcessTransport("sim:source", tap, clock), clock)
    return Bench(source, {"dm1_y_v": lines[1], "dm1_z_v": lines[2]}, tap, clock)


@pytest.fixture(params=[bench_33500b], ids=["33500b"])
def bench(request: pytest.FixtureRequest) -> Bench:
    made: Bench = request.param()
    return made


def test_it_is_a_voltage_source_and_its_constructor_touches_nothing(bench: Bench) -> None:
    assert isinstance(bench.source, VoltageSource)
    assert [(c.name, c.unit, c.full_scale) for c in bench.source.channels()] == [
        ("dm1_y_v", "V", 5.0),
        ("dm1_z_v", "V", 5.0),
    ]
    assert bench.tap.connections == 0


def test_opening_identifies_and_changes_no_output(bench: Bench) -> None:
    bench.source.open()
    bench.source.start({"dm1_z_v": Waveform(offset_v=1.0)})
    bench.source.close()
    bench.source.open()
    assert bench.source.identify().model
    bench.clock.sleep_s(1.0)
    assert bench.volts("dm1_z_v", [bench.clock.now_s()]) == pytest.approx([1.0])


@pytest.mark.parametrize(
    "waveform",
    [
        Waveform(offset_v=-1.5),
        Waveform("sine", 0.0, 1.0, 45.0),
        Waveform("sine", 0.5, 1.0, 300.0, 90.0),
        Waveform("triangle", 0.0, 1.0, 60.0),
        Waveform("triangle", -0.2, 0.7, 300.0, -120.0),
    ],
)
def test_what_is_on_the_wire_is_what_it_says_it_makes(bench: Bench, waveform: Waveform) -> None:
    bench.source.open()
    bench.clock.sleep_s(12.3)
    started = bench.source.start({"dm1_z_v": waveform})
    assert started.start_s == pytest.approx(bench.clock.now_s(), abs=0.1)
    taken = started.waveforms["dm1_z_v"]
    assert taken.shape == waveform.shape
    assert taken.period_s == pytest.approx(waveform.period_s, rel=1e-3)
    bench.clock.sleep_s(700.0)
    elapsed_s = np.linspace(0.0, 700.0, 1401)
    assert bench.volts("dm1_z_v", started.start_s + elapsed_s) == pytest.approx(taken.volts(elapsed_s), abs=1e-6)
    assert bench.volts("dm1_y_v", started.start_s + elapsed_s) == pytest.approx(np.zeros(1401))


def test_both_outputs_begin_at_once(bench: Bench) -> None:
    bench.source.open()
    started = bench.source.start(
        {"dm1_y_v": Waveform("sine", 0.0, 1.0, 10.0, 90.0), "dm1_z_v": Waveform("sine", 0.0, 1.0, 10.0)}
    )
    elapsed_s = np.linspace(0.0, 20.0, 41)
    y_v, z_v = (bench.volts(name, started.start_s + elapsed_s) for name in ("dm1_y_v", "dm1_z_v"))
    assert y_v**2 + z_v**2 == pytest.approx(np.ones(41), abs=1e-9)
    assert z_v[1] > 0.0


@pytest.mark.parametrize("phase_deg", [0.0, 90.0, -30.0])
def test_a_waveform_with_an_end_needs_nobody_to_end_it(bench: Bench, phase_deg: float) -> None:
    bench.source.open()
    bench.clock.sleep_s(3.0)
    waveform = Waveform("triangle", 0.5, 1.0, 10.0, phase_deg)
    started = bench.source.start({"dm1_y_v": waveform, "dm1_z_v": Waveform(offset_v=0.25)}, lasting_s=34.0)
    bench.source.close()  # the computer has died
    bench.clock.sleep_s(200.0)
    during_s, after_s = np.linspace(0.0, 40.0, 401), np.linspace(40.0, 200.0, 161)
    taken = started.waveforms["dm1_y_v"]
    # Four whole periods last for 34 s; then it stays where it began.
    assert bench.volts("dm1_y_v", started.start_s + during_s) == pytest.approx(taken.volts(during_s), abs=1e-6)
    level_v = float(taken.volts(np.zeros(1))[0])
    assert bench.volts("dm1_y_v", started.start_s + after_s) == pytest.approx(np.full(161, level_v), abs=1e-6)
    assert bench.volts("dm1_z_v", [started.start_s + 200.0]) == pytest.approx([0.25]), "a constant has no end"


def test_waveforms_with_an_end_begin_at_once_and_are_over_when_they_are(bench: Bench) -> None:
    bench.source.open()
    sines = {"dm1_y_v": Waveform("sine", 0.0, 1.0, 10.0, 90.0), "dm1_z_v": Waveform("sine", 0.0, 1.0, 10.0)}
    started = bench.source.start(sines, lasting_s=30.0)
    elapsed_s = np.linspace(0.0, 30.0, 61)
    y_v, z_v = (bench.volts(name, started.start_s + elapsed_s) for name in sines)
    assert y_v**2 + z_v**2 == pytest.approx(np.ones(61), abs=1e-9)
    bench.clock.sleep_s(29.0)
    bench.source.require_running()
    bench.clock.sleep_s(2.0)
    with pytest.raises(InstrumentError, match="were to last for 30 s and are over"):
        bench.source.require_running()
    # The next start goes on without an end, or with another, and constants follow bursts.
    bench.source.start({"dm1_y_v": Waveform("sine", 0.0, 1.0, 10.0)})
    bench.clock.sleep_s(100.0)
    bench.source.require_running()
    bench.source.start(sines, lasting_s=5.0)
    bench.source.start({"dm1_y_v": Waveform(offset_v=0.5)}, lasting_s=5.0)
    bench.clock.sleep_s(100.0)
    bench.source.require_running()


def test_a_new_start_replaces_every_output(bench: Bench) -> None:
    bench.source.open()
    bench.source.start({"dm1_y_v": Waveform(offset_v=1.0), "dm1_z_v": Waveform("sine", 0.0, 2.0, 10.0)})
    bench.clock.sleep_s(5.0)
    bench.source.start({"dm1_z_v": Waveform(offset_v=0.5)})
    at_s = [bench.clock.now_s() + 1.0]
    assert [*bench.volts("dm1_y_v", at_s), *bench.volts("dm1_z_v", at_s)] == pytest.approx([0.0, 0.5])


def test_an_output_that_somebody_switched_off_is_noticed(bench: Bench) -> None:
    bench.source.open()
    bench.source.require_running()
    bench.source.start({"dm1_z_v": Waveform("sine", 0.0, 1.0, 300.0)})
    bench.source.require_running()
    bench.source.stop()
    with pytest.raises(InstrumentError, match=r"output \d .*is off; was its power off"):
        bench.source.require_running()


def test_a_setting_that_somebody_changed_is_noticed() -> None:
    bench = bench_33500b()
    bench.source.open()
    bench.source.start({"dm1_z_v": Waveform(offset_v=1.0)})
    other = InProcessTransport("sim:other", bench.tap, bench.clock)
    other.write(b"SOUR2:VOLT:OFFS 0.5\n")
    with pytest.raises(BadReply, match=r"0\.5.*about 1"):
        bench.source.require_running()


def test_stop_takes_the_voltage_away_from_any_thread_any_number_of_times(bench: Bench) -> None:
    bench.source.stop()
    bench.source.open()
    bench.source.start({"dm1_z_v": Waveform(offset_v=1.0)})
    thread = threading.Thread(target=bench.source.stop)
    thread.start()
    thread.join(10.0)
    bench.source.stop()
    assert bench.volts("dm1_z_v", [bench.clock.now_s() + 1.0]) == pytest.approx([0.0])
    bench.source.start({"dm1_z_v": Waveform(offset_v=1.0)})
    assert bench.volts("dm1_z_v", [bench.clock.now_s() + 1.0]) == pytest.approx([1.0])


def test_what_is_beyond_the_limits_sends_nothing(bench: Bench) -> None:
    bench.source.open()
    before = bench.tap.messages
    for waveform in (Waveform(offset_v=5.1), Waveform("sine", 3.0, 3.0, 10.0), Waveform("sine", 0.0, 1.0, 0.0)):
        with pytest.raises(LimitError, match=r"^source: dm1_z_v: "):
            bench.source.start({"dm1_z_v": waveform})
    assert bench.tap.messages == before


def test_a_closed_one_says_so(bench: Bench) -> None:
    bench.source.open()
    bench.source.close()
    bench.source.close()
    with pytest.raises(LinkLost, match="source: not connected"):
        bench.source.start({})
