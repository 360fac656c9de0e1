"""Replies that come twice, again, late, cut or not at all: right numbers or a typed error, and in step afterwards."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.keyence_lkg import KeyenceSettings, Lkg3001, Lkg5000
from drivers.keysight_33500b import Keysight33500B, SourceSettings
from drivers.keysight_34465a import MeterThermometer, PacedVoltmeter, PacingVoltmeter
from drivers.keysight_settings import ThermometerSettings, VoltmeterSettings
from drivers.newport_esp301 import Esp301Settings, NewportEsp301
from drivers.newport_xps import NewportXps, XpsSettings
from drivers.transport import InProcessTransport
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import OutOfStep, RigError
from rigctl.core.voltage_sources import Waveform
from simulators.aerotech_ensemble import EnsembleDialect, EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.clock import VirtualClock
from simulators.keyence_lkg import Lkg3001Settings, Lkg5000Settings, SimulatedLkg3001, SimulatedLkg5000
from simulators.keysight_33500b import Simulated33500B
from simulators.keysight_34465a import MeterSettings, Simulated34465A
from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from simulators.newport_xps import SimulatedXps
from simulators.wiring import TriggerLine, VoltageLine

ROUND_TRIP_S = 1e-3
SAMPLES, PERIOD_S = 12, 0.01
STRUCK_MAX = 14
"""As many places in a session are tried per fault."""


@dataclass(frozen=True)
class Spoilt:
    """What comes in place of a reply: pieces, each with its delay [s]."""

    pieces: Callable[[bytes, bytes], list[tuple[float, bytes]]]


FAULTS = {
    "doubled": Spoilt(lambda reply, _: [(0.0, reply), (0.0, reply)]),
    "doubled behind": Spoilt(lambda reply, _: [(0.0, reply), (0.5 * ROUND_TRIP_S, reply)]),
    "previous": Spoilt(lambda _, before: [(0.0, before)]),
    "previous before": Spoilt(lambda reply, before: [(0.0, before), (0.5 * ROUND_TRIP_S, reply)]),
    "half": Spoilt(lambda reply, _: [(0.0, reply[: len(reply) // 2])]),
    "lost": Spoilt(lambda *_: []),
    "late": Spoilt(lambda reply, _: [(2.2, reply)]),
    "very late": Spoilt(lambda reply, _: [(4.5, reply)]),
}


class Distant:
    """An instrument at the end of a network: replies take a while, and one of them is spoilt. In order, always."""

    def __init__(self, instrument: Any, clock: VirtualClock, spoilt: Spoilt | None, number: int) -> None:
        self.replies = 0
        self._instrument, self._clock = instrument, clock
        self._spoilt, self._number = spoilt, number
        self._before = b""

    def connect(self, send: Callable[[bytes], None]) -> Any:
        arrival_s = itertools.accumulate(itertools.repeat(0.0), max)
        last_s = [next(arrival_s)]

        def reply(data: bytes) -> None:
            self.replies += 1
            struck = self._spoilt is not None and self.replies == self._number
            pieces = self._spoilt.pieces(data, self._before) if self._spoilt and struck else [(0.0, data)]
            self._before = data
            for delay_s, piece in pieces:
                last_s[0] = max(last_s[0], self._clock.now_s() + ROUND_TRIP_S + delay_s)
                self._clock.call_at(last_s[0], partial(send, piece))

        return self._instrument.connect(reply)


@dataclass
class Scene:
    """An instrument with its driver: what a session measures."""

    driver: Any
    wire: Distant
    session: Callable[[], list[float]]


Connect = Callable[[Any], Callable[[], InProcessTransport]]


class Stage:
    """Where the instruments of a scene are put up."""

    def __init__(self, spoilt: Spoilt | None, number: int) -> None:
        self.clock = VirtualClock()
        self.line = TriggerLine(pulse_s=4e-3)
        self._fault = spoilt, number

    def wire(self, instrument: Any) -> tuple[Distant, Callable[[], InProcessTransport]]:
        wire = Distant(instrument, self.clock, *self._fault)
        return wire, lambda: InProcessTransport("sim:", wire, self.clock)

    def signal(self, times_s: FloatArray) -> FloatArray:
        """Another value at every edge, whenever the train began."""
        begun_s = self.line.train.first_s if self.line.train else 0.0
        edge = np.round((times_s - begun_s) / PERIOD_S, 3) if self.line.train else np.zeros_like(times_s)
        return np.asarray(np.round(3.0 * np.sin(1.0 + 0.7 * edge), 4))

    def edges(self) -> None:
        self.line.begin(self.clock.now_s() + 0.1, PERIOD_S, SAMPLES)
        self.clock.sleep_s(0.5)


def rotation(stage: Stage, kind: str) -> Scene:
    axis = MotionAxis(2.0)
    driver: NewportXps | NewportEsp301
    if kind == "xps":
        wire, connect = stage.wire(SimulatedXps(stage.clock, {"Group1": {"Pos": axis}}))
        driver = NewportXps("it", XpsSettings(motion_timeout_s=20.0), connect, stage.clock)
    else:
        wire, connect = stage.wire(SimulatedEsp301(stage.clock, [axis]))
        driver = NewportEsp301("it", Esp301Settings(motion_timeout_s=20.0), connect, stage.clock)

    def session() -> list[float]:
        driver.home()
        driver.move_to(3.5)
        return [driver.angle().value]

    return Scene(driver, wire, session)


def ensemble(stage: Stage) -> Scene:
    settings = EnsembleSimulatorSettings(encoder_noise_mm=0.0002, dialect=EnsembleDialect(capture_read="continues"))
    wire, connect = stage.wire(SimulatedEnsemble(stage.clock, MotionAxis(), stage.line, settings))
    driver = AerotechEnsemble(
        "it", EnsembleSettings(capture_registers=8, capture_read="continues"), connect, stage.clock
    )

    def session() -> list[float]:
        driver.home()
        driver.arm(SAMPLES, PERIOD_S)
        stage.edges()
        return list(driver.collect()[:, 0])

    return Scene(driver, wire, session)


KEYENCE_HEADS = {"laser_1_mm": 1, "laser_2_mm": 2}


def lkg5000(stage: Stage) -> Scene:
    signals = [stage.signal, lambda times_s: -2.0 * stage.signal(times_s)]
    wire, connect = stage.wire(SimulatedLkg5000(stage.clock, signals, stage.line, Lkg5000Settings(range_mm=15.0)))
    settings = KeyenceSettings.model_validate({"generation": "lkg5000", "heads": KEYENCE_HEADS})
    driver = Lkg5000("it", settings, connect, stage.clock)

    def session() -> list[float]:
        driver.arm(SAMPLES, PERIOD_S)
        stage.edges()
        return list(driver.collect().ravel())

    return Scene(driver, wire, session)


def lkg3001(stage: Stage) -> Scene:
    def time(times_s: FloatArray) -> FloatArray:
        """Another value in every row, which says when it was taken."""
        return np.asarray(np.round(1e-3 * times_s, 5))

    signals = [time, lambda times_s: -2.0 * time(times_s)]
    simulated = SimulatedLkg3001(
        stage.clock, signals, stage.line, Lkg3001Settings(range_mm=15.0, decimals=5, clock_ppm=0.0)
    )
    wire, connect = stage.wire(simulated)
    settings = KeyenceSettings.model_validate({"generation": "lkg3001", "heads": KEYENCE_HEADS})
    driver = Lkg3001("it", settings, connect, stage.clock)

    def session() -> list[float]:
        driver.prepare(SAMPLES, 0.01)
        driver.begin()
        stage.clock.sleep_s(0.5)
        record = driver.finish()
        first, second = record.values[:SAMPLES].T
        taken_s = record.start_s + record.period_s * np.arange(SAMPLES)
        # When it is carried out at all, a late command is carried out later: how late is in the record's own start.
        started = abs(float(np.mean(1e3 * first - taken_s))) < 4.0 * record.start_u_s
        return [float(len(first)), *np.round(np.diff(first), 4), *np.round(second + 2.0 * first, 4), float(started)]

    return Scene(driver, wire, session)


def meter(stage: Stage, use: str) -> Scene:
    settings = VoltmeterSettings(transfer="ascii" if use == "paced" else "real64")
    master, slave = (stage.line, None) if use == "pacing" else (None, stage.line)
    simulated = Simulated34465A(
        stage.clock, stage.signal, lambda t: np.full_like(t, 21.25), master, slave, MeterSettings(resolution_v=1e-4)
    )
    wire, connect = stage.wire(simulated)
    if use == "thermometer":
        thermometer = MeterThermometer("it", ThermometerSettings(), connect, stage.clock)
        return Scene(
            thermometer,
            wire,
            lambda: [thermometer.temperature().value, thermometer.temperature().value],
        )
    if use == "paced":
        paced = PacedVoltmeter("it", settings, connect, stage.clock)

        def followed() -> list[float]:
            paced.arm(SAMPLES, PERIOD_S)
            stage.edges()
            return list(paced.collect()[:, 0])

        return Scene(paced, wire, followed)
    pacing = PacingVoltmeter("it", settings, connect, stage.clock)

    def paced_by_itself() -> list[float]:
        pacing.start(SAMPLES, PERIOD_S)
        rows: list[float] = []
        for _ in range(4):
            stage.clock.sleep_s(0.05)
            rows += list(pacing.fetch()[:, 0])
        return rows

    return Scene(pacing, wire, paced_by_itself)


def source(stage: Stage) -> Scene:
    wire, connect = stage.wire(Simulated33500B(stage.clock, {1: VoltageLine(), 2: VoltageLine()}))
    driver = Keysight33500B("it", SourceSettings(), connect, stage.clock)

    def session() -> list[float]:
        started = driver.start(
            {"dm1_y_v": Waveform("sine", 0.5, 1.0, 10.0, 30.0), "dm1_z_v": Waveform(offset_v=0.25)}
        )
        return [
            number
            for wave in started.waveforms.values()
            for number in (wave.offset_v, wave.amplitude_v, wave.period_s, wave.phase_deg)
        ]

    return Scene(driver, wire, session)


SCENES: dict[str, Callable[[Stage], Scene]] = {
    "xps": partial(rotation, kind="xps"),
    "esp301": partial(rotation, kind="esp301"),
    "ensemble": ensemble,
    "lkg3001": lkg3001,
    "lkg5000": lkg5000,
    "pacing meter": partial(meter, use="pacing"),
    "paced meter": partial(meter, use="paced"),
    "thermometer": partial(meter, use="thermometer"),
    "33500b": source,
}


def opened(kind: str, spoilt: Spoilt | None = None, number: int = 0) -> Scene:
    scene = SCENES[kind](Stage(spoilt, number))
    scene.driver.open()
    return scene


def places(replies_before: int, replies: int) -> list[int]:
    """Evenly over a session, its first and its last reply among them."""
    count = min(STRUCK_MAX, replies - replies_before)
    return sorted({round(number) for number in np.linspace(replies_before + 1, replies, count)})


def model_in_step(scene: Scene) -> str:
    """Who answers, at the latest when a doubt has been raised, or what is late has come."""
    for _ in range(4):
        try:
            scene.driver.confirm_in_step()
            return str(scene.driver.identify().model)
        except RigError:
            scene.wire._clock.sleep_s(2.0)
    return "nobody"


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", SCENES)
def test_a_spoilt_reply_gives_right_numbers_or_a_typed_error_and_the_next_is_in_step(kind: str, fault: str) -> None:
    clean = opened(kind)
    begun = clean.wire.replies
    truth = clean.session()
    clean.driver.confirm_in_step()
    silent = []
    for number in places(begun, clean.wire.replies):
        scene = opened(kind, FAULTS[fault], number)
        try:
            numbers = scene.session()
            scene.driver.confirm_in_step()
        except RigError:
            pass
        else:
            if numbers != pytest.approx(truth, nan_ok=True):
                silent.append((number, numbers))
        assert model_in_step(scene) == clean.driver.identify().model, f"reply {number}"
    assert not silent, truth


def test_a_doubled_reply_is_told_as_out_of_step() -> None:
    clean = opened("ensemble")
    clean.session()
    scene = opened("ensemble", FAULTS["doubled"], clean.wire.replies - 3)
    with pytest.raises(OutOfStep, match=r"it: .*measure again"):
        scene.session()
