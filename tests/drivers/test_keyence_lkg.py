"""The Keyence LK-G driver: against its manual's bytes, and against the simulated controllers."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.keyence_lkg import KeyenceSettings, Lkg3001, Lkg5000
from drivers.keyence_values import parse_values
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import (
    BadReply,
    InstrumentError,
    LimitError,
    LinkLost,
    LinkTimeout,
    RigError,
    WrongInstrument,
)
from rigctl.core.interfaces import DisplacementMeter
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.keyence_lkg import Lkg3001Settings, Lkg5000Settings, SimulatedLkg3001, SimulatedLkg5000
from simulators.wiring import Signal, TriggerLine
from tests.drivers.expected import Expected, Send

HEADS = {"laser_1_mm": 1, "laser_2_mm": 2}
GENERATIONS = ("lkg3001", "lkg5000")
both_generations = pytest.mark.parametrize("generation", GENERATIONS)


class Tap:
    """Passes bytes on to another endpoint and may change them, and what comes back."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.sent = bytearray()
        self.on_send: Callable[[bytes], None] = lambda _: None
        self.on_command: Callable[[bytes], bytes] = lambda data: data
        self.on_reply: Callable[[bytes], bytes] = lambda data: data
        self.hung_up = False

    def connect(self, send: Send) -> Tap:
        self.hung_up = False
        self.send = send
        self._inner = self.endpoint.connect(lambda data: send(self.on_reply(data)))
        return self

    def receive(self, data: bytes) -> None:
        self.sent += data
        self.on_send(data)
        self._inner.receive(self.on_command(data))

    def close(self) -> None:
        self._inner.close()


def settings(generation: str, /, **values: object) -> KeyenceSettings:
    return KeyenceSettings.model_validate({"generation": generation, "heads": HEADS} | values)


DRIVERS: dict[str, type[Lkg3001] | type[Lkg5000]] = {"lkg3001": Lkg3001, "lkg5000": Lkg5000}


def driver(endpoint: Endpoint, clock: SimulationClock, configured: KeyenceSettings, guarded: bool = True) -> Any:
    made = DRIVERS[configured.generation]
    return made(
        "lasers", configured, lambda: InProcessTransport("sim:lasers", endpoint, clock, guarded=guarded), clock
    )


def talking(configured: KeyenceSettings, *exchanges: tuple[bytes, bytes]) -> tuple[Any, Expected]:
    conversation = Expected(*exchanges)
    return driver(conversation, VirtualClock(), configured), conversation


class Bench:
    """A driver, a simulated controller, and the wire that triggers it."""

    def __init__(
        self,
        generation: str,
        *heads: Signal,
        clock: SimulationClock | None = None,
        simulated: dict[str, float] | None = None,
        **configured: object,
    ) -> None:
        self.clock = clock or VirtualClock()
        self.line = TriggerLine(pulse_s=4e-3)
        self.tap = Tap(self._controller(generation, heads or (ramp, minus_two), simulated or {}))
        self.lasers = driver(self.tap, self.clock, settings(generation, **configured))

    def _controller(
        self, generation: str, heads: tuple[Signal, ...], simulated: dict[str, float]
    ) -> SimulatedLkg3001 | SimulatedLkg5000:
        if generation == "lkg3001":
            built = Lkg3001Settings(**simulated)  # type: ignore[arg-type]
            return SimulatedLkg3001(self.clock, heads, self.line, built)
        return SimulatedLkg5000(self.clock, heads, self.line, Lkg5000Settings(**simulated))  # type: ignore[arg-type]

    def record(self, samples: int, period_s: float, edges: int | None = None) -> tuple[FloatArray, FloatArray]:
        """The edges' times and what was recorded at them."""
        self.lasers.open()
        self.lasers.arm(samples, period_s)
        first_s = self.clock.now_s() + 0.3
        self.line.begin(first_s, period_s, samples if edges is None else edges)
        return np.asarray(first_s + period_s * np.arange(samples)), self.lasers.collect()


def ramp(times_s: FloatArray) -> FloatArray:
    return 0.1 * times_s


def minus_two(times_s: FloatArray) -> FloatArray:
    return np.full_like(times_s, -2.0)


# The manual's bytes


def found_out(target: int, *outputs: int) -> list[tuple[bytes, bytes]]:
    """What an LK-G3001 is asked when it is opened and accepts the first form of its storage."""
    counts = [(f"AN,{output}\r".encode(), f"AN,{output},1,00012\r".encode()) for output in outputs]
    ended = [(question, answer.replace(b",1,0", b",0,0")) for question, answer in counts]
    return [
        (b"Q0\r", b"Q0\r"),
        (f"SW,CI,{target},00100,0\r".encode(), b"SW,CI\r"),
        (b"R0\r", b"R0\r"),
        (b"AQ\r", b"AQ\r"),
        (b"AS\r", b"AS\r"),
        *counts,
        (b"AP\r", b"AP\r"),
        *ended,
    ]


def test_the_first_generation_is_read_by_the_manuals_bytes() -> None:
    lasers, conversation = talking(
        settings("lkg3001"),
        (b"R0\r", b"ER,R0,01\r"),
        (b"M1\r", b"M1,+00.0123\r"),
        *found_out(3, 1, 2),
        (b"M0\r", b"M0,+00.0123,-00.4567\r"),
        (b"M0\r", b"M0,+FFFFFFF,XXXXXXXX\r"),
    )
    lasers.open()
    assert [reading.value for reading in lasers.displacements()] == [0.0123, -0.4567]
    assert all(math.isnan(reading.value) for reading in lasers.displacements())
    assert not conversation.left


def test_one_head_of_two_is_asked_alone() -> None:
    lasers, _ = talking(
        settings("lkg3001", heads={"side_mm": 2}),
        (b"R0\r", b"R0\r"),
        (b"M1\r", b"M1,XXXXXXXX\r"),
        *found_out(2, 2),
        (b"M2\r", b"M2,-00.0120\r"),
    )
    lasers.open()
    (reading,) = lasers.displacements()
    assert (reading.value, reading.unit) == (-0.012, "mm")


def test_the_second_generation_is_recorded_by_the_manuals_bytes() -> None:
    configured = settings("lkg5000", heads={"main_mm": 1}, sampling_us=100.0, averaging=16)
    lasers, conversation = talking(
        configured,
        (b"R0\r", b"ER,R0,51\r"),
        (b"MS,01\r", b"MS,01,+00.0012\r"),
        (b"Q0\r", b"Q0\r"),
        *((b"SW,CA,5\r", b"SW,CA\r"), (b"SR,CA\r", b"SR,CA,5\r")),
        *((b"SW,OC,01,0,2\r", b"SW,OC\r"), (b"SR,OC,01\r", b"SR,OC,01,0,2\r")),
        *((b"SW,CF,0000003,10\r", b"SW,CF\r"), (b"SR,CF\r", b"SR,CF,3,10\r")),
        *((b"SW,OK,01,1\r", b"SW,OK\r"), (b"SR,OK,01\r", b"SR,OK,01,1\r")),
        (b"R0\r", b"R0\r"),
        (b"AQ\r", b"AQ\r"),
        (b"AS\r", b"AS\r"),
        (b"AN\r", b"AN,1,0000002,0000000\r"),
        (b"AN\r", b"AN,0,3,0\r"),
        (b"AO,01\r", b"AO,+00.0012,-FFFFFFF,+00.0013\r"),
    )
    lasers.open()
    lasers.arm(3, 0.01)
    np.testing.assert_array_equal(lasers.collect(), [[0.0012], [math.nan], [0.0013]])
    assert not conversation.left


def test_several_heads_of_the_second_generation_are_asked_at_once() -> None:
    lasers, _ = talking(
        settings("lkg5000", heads={"top_mm": 12, "main_mm": 1}),
        (b"R0\r", b"R0\r"),
        (b"MS,01\r", b"MS,01,+00.0012\r"),
        (b"MM,100000000001\r", b"MM,100000000001,+000.260,-001.500\r"),
    )
    lasers.open()
    assert [reading.value for reading in lasers.displacements()] == [-1.5, 0.26]


# Values


def test_the_special_values_are_not_a_number() -> None:
    values = parse_values(b"+01.2345,XXXXXXXX,-00001.2,+FFFFFFF,-FFFFFFF,+1234.56,-123456.,+.000001")
    nan = math.nan
    np.testing.assert_array_equal(values, [1.2345, nan, -1.2, nan, nan, 1234.56, -123456.0, 1e-6])
    assert parse_values(b"").shape == (0,)


_number = st.builds(
    lambda sign, digits, point: f"{sign}{digits[:point]}.{digits[point:]}",
    st.sampled_from("+-"),
    st.text("0123456789", min_size=6, max_size=6),
    st.integers(0, 6),
)


@given(st.lists(_number, min_size=1, max_size=30))
def test_a_number_is_read_as_the_double_nearest_to_it(numbers: list[str]) -> None:
    assert parse_values(",".join(numbers).encode()).tolist() == [float(number) for number in numbers]


@given(st.lists(_number, min_size=1, max_size=5), st.data())
def test_a_value_with_a_character_changed_or_lost_never_passes_for_another_form(
    numbers: list[str], data: st.DataObject
) -> None:
    text = bytearray(",".join(numbers).encode())
    position = data.draw(st.integers(0, len(text) - 1))
    if data.draw(st.booleans()):
        del text[position]
    else:
        text[position] = data.draw(st.sampled_from(b"XF :/\x00\xffe"))
    with pytest.raises(ValueError, match=r"characters|number"):
        parse_values(bytes(text))


@pytest.mark.parametrize(
    "text",
    [b"+01.2345,", b",", b"01.23456", b"+0123456", b"+0.1.234", b"+FFFF.FF", b"XXXXXXXF", b"+01.2345;+01.2345"],
)
def test_what_is_not_in_the_manuals_form_is_no_value(text: bytes) -> None:
    with pytest.raises(ValueError, match=r"characters|number"):
        parse_values(text)


def test_a_full_storage_is_read() -> None:
    values = np.round(np.random.default_rng(1).uniform(-15, 15, 65_536), 4)
    text = ",".join([f"{value:+08.4f}" for value in values]).encode()
    np.testing.assert_array_equal(parse_values(text), values)


# Both generations, by their simulators


@both_generations
def test_it_is_a_displacement_meter_that_touches_nothing_until_opened(generation: str) -> None:
    bench = Bench(generation, latency_s=1e-3, range_mm=5.0)
    assert isinstance(bench.lasers, DisplacementMeter)
    channels = bench.lasers.channels()
    assert [(c.name, c.unit, c.kind, c.latency_s, c.full_scale) for c in channels] == [
        ("laser_1_mm", "mm", "displacement", 1e-3, 5.0),
        ("laser_2_mm", "mm", "displacement", 1e-3, 5.0),
    ]
    bench.lasers.close()
    assert not bench.tap.sent
    with pytest.raises(LinkLost, match="open"):
        bench.lasers.displacements()
    bench.lasers.stop()
    assert bench.tap.sent == (b"AP\rAN,1\rAN,2\r" if generation == "lkg3001" else b"AP\rAN\r")


@both_generations
def test_identity_is_the_generation(generation: str) -> None:
    bench = Bench(generation, minus_two, heads={"laser_1_mm": 1})
    bench.lasers.open()
    bench.lasers.open()
    identity = bench.lasers.identify()
    assert identity.model == {"lkg3001": "LK-G3001", "lkg5000": "LK-G5000"}[generation]
    assert identity.text.endswith(",-02.0000")
    bench.lasers.close()
    bench.lasers.close()


def test_each_edge_gives_a_row_with_each_heads_value() -> None:
    bench = Bench("lkg5000")
    edges_s, rows = bench.record(500, 0.05)
    np.testing.assert_allclose(rows, np.column_stack([ramp(edges_s), minus_two(edges_s)]), atol=0.6e-4)


def test_columns_follow_the_settings_not_the_outputs() -> None:
    bench = Bench("lkg5000", heads={"second_mm": 2, "first_mm": 1})
    edges_s, rows = bench.record(10, 0.05)
    np.testing.assert_allclose(rows, np.column_stack([minus_two(edges_s), ramp(edges_s)]), atol=0.6e-4)
    assert bench.lasers.displacements()[0].value == -2.0


def test_a_second_recording_replaces_the_first() -> None:
    bench = Bench("lkg5000")
    bench.record(20, 0.05)
    edges_s, rows = bench.record(10, 0.1)
    assert rows.shape == (10, 2)
    np.testing.assert_allclose(rows[:, 0], ramp(edges_s), atol=0.6e-4)


def test_a_lost_target_and_an_end_of_range_are_not_a_number() -> None:
    def leaving(times_s: FloatArray) -> FloatArray:
        return np.where(times_s < 2.0, np.nan, 10.0 * (times_s - 1.0))

    bench = Bench("lkg5000", leaving, minus_two)
    edges_s, rows = bench.record(30, 0.1)
    expected = leaving(edges_s)
    expected[expected > 15.0] = np.nan
    assert 0 < np.isnan(expected).sum() < 30
    np.testing.assert_allclose(rows[:, 0], expected, atol=0.6e-4)
    assert not np.isnan(rows[:, 1]).any()
    assert math.isnan(bench.lasers.displacements()[0].value)


def test_sampling_and_averaging_are_set_up() -> None:
    bench = Bench("lkg5000", sampling_us=500.0, averaging=64)
    edges_s, rows = bench.record(20, 0.05)
    np.testing.assert_allclose(rows[:, 0], ramp(edges_s - 63 / 2 * 500e-6), atol=0.6e-4)


@pytest.mark.parametrize("simulated", [{"mode_return_s": 2.1}, {"mode_settle_s": 2.1}, {"reply_delay_s": 0.4}])
def test_a_slow_return_to_measuring_is_waited_for(simulated: dict[str, float]) -> None:
    bench = Bench("lkg5000", simulated=simulated)
    assert bench.record(5, 0.05)[1].shape == (5, 2)


def test_a_return_to_measuring_that_takes_too_long_is_an_error() -> None:
    bench = Bench("lkg5000", simulated={"mode_settle_s": 60.0})
    bench.lasers.open()
    with pytest.raises(InstrumentError, match=r"AQ refused with error .1 .status error") as refused:
        bench.lasers.arm(5, 0.05)
    assert refused.value.code == "51"
    assert refused.value.text == "status error"


# Settings are believed when they are read back


def once(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    """Spoils one message on its way."""
    left = [old]

    def spoil(data: bytes) -> bytes:
        return data.replace(left.pop(), new) if left and left[0] in data else data

    return spoil


SPOILT_SETTINGS = [
    ("lkg5000", b"SW,CA,8", b"SW,CA,0"),
    ("lkg5000", b"SW,OC,01,0,0", b"SW,OC,01,0,4"),
    ("lkg5000", b"SW,OC,01,0,0", b"SW,OC,01,1,0"),
    ("lkg5000", b"SW,CF,0000010,10", b"SW,CF,0000010,00"),
    ("lkg5000", b"SW,CF,0000010,10", b"SW,CF,0000050,10"),
    ("lkg5000", b"SW,OK,02,1", b"SW,OK,02,0"),
    ("lkg3001", b"SW,CA,5", b"SW,CA,4"),
    ("lkg3001", b"SW,OC,2,0,0", b"SW,OC,2,0,1"),
    ("lkg3001", b",03", b",02"),
]
"""Of each setting one bit, turned on the way to the controller, which answers as if nothing were wrong."""


def set_up(bench: Bench, generation: str) -> None:
    (bench.lasers.prepare if generation == "lkg3001" else bench.lasers.arm)(10, 0.01)


@pytest.mark.parametrize(("generation", "written", "came"), SPOILT_SETTINGS)
def test_a_setting_that_came_as_another_is_no_setting(generation: str, written: bytes, came: bytes) -> None:
    bench = Bench(generation)
    bench.lasers.open()
    set_up(bench, generation)
    bench.tap.on_command = once(written, came)
    with pytest.raises(BadReply, match=r"SW,.* is .* when it is read back; bits turn on the line"):
        set_up(bench, generation)
    assert bench.lasers.displacements()[1].value == -2.0
    set_up(bench, generation)


def test_the_name_of_a_setting_that_came_as_another_is_told_by_the_reply() -> None:
    bench = Bench("lkg5000")
    bench.lasers.open()
    # The unit on display, which every later value would be in.
    bench.tap.on_command = once(b"SW,OK", b"SW,OI")
    with pytest.raises(BadReply, match=r"SW,OK,01,1 was answered by b'OI', not by SW,OK"):
        bench.lasers.arm(10, 0.01)


def test_a_question_for_a_setting_that_names_more_of_it_is_tried_where_one_is_refused() -> None:
    configured = settings("lkg5000", heads={"main_mm": 1})
    lasers, conversation = talking(
        configured,
        *((b"R0\r", b"R0\r"), (b"MS,01\r", b"MS,01,+00.0012\r"), (b"Q0\r", b"Q0\r")),
        *((b"SW,CA,8\r", b"SW,CA\r"), (b"SR,CA\r", b"SR,CA,8\r"), (b"SW,OC,01,0,0\r", b"SW,OC\r")),
        *((b"SR,OC,01\r", b"ER,SR,61\r"), (b"SR,OC,01,0\r", b"SR,OC,01,0,0\r")),
        *((b"SW,CF,0000003,10\r", b"SW,CF\r"), (b"SR,CF\r", b"SR,CF,0000003,10\r")),
        *((b"SW,OK,01,1\r", b"SW,OK\r"), (b"SR,OK,01\r", b"SR,OK,01,1\r")),
        *((b"R0\r", b"R0\r"), (b"AQ\r", b"AQ\r"), (b"AS\r", b"AS\r")),
    )
    lasers.open()
    lasers.arm(3, 0.01)
    assert not conversation.left


# Whatever happens with its settings open ends in measuring


@both_generations
@pytest.mark.parametrize("spoilt", [b"", b"Q8\r", b"\xd10\r"])
def test_a_spoilt_reply_to_the_opening_of_settings_leaves_it_measuring(generation: str, spoilt: bytes) -> None:
    bench = Bench(generation)
    bench.lasers.open()
    bench.tap.on_reply = once(b"Q0\r", spoilt)
    with pytest.raises((LinkTimeout, BadReply)):
        set_up(bench, generation)
    assert bytes(bench.tap.sent).endswith(b"R0\r")
    assert bench.lasers.displacements()[1].value == -2.0


@both_generations
@pytest.mark.parametrize("use", ["displacements", "arm", "stop"])
def test_settings_that_could_not_be_closed_are_closed_on_the_next_use(generation: str, use: str) -> None:
    bench = Bench(generation)
    bench.lasers.open()
    bench.tap.on_command = lambda data: b"" if data == b"R0\r" else data
    with pytest.raises(LinkTimeout, match="R0"):
        set_up(bench, generation)
    bench.tap.on_command = lambda data: data
    if use == "arm":
        set_up(bench, generation)
    else:
        getattr(bench.lasers, use)()
    answers: list[bytes] = []
    bench.tap.endpoint.connect(answers.append).receive(b"R0\r")
    assert answers == [b"ER,R0,01\r" if generation == "lkg3001" else b"ER,R0,51\r"]
    assert bench.lasers.displacements()[1].value == -2.0


# Current values


@pytest.mark.parametrize("other", [b"MM,011000000000,+02.5000,+03.5000\r", b"MM,110000000000,+02.5000\r"])
def test_values_of_other_outputs_than_were_asked_for_are_refused(other: bytes) -> None:
    bench = Bench("lkg5000")
    bench.lasers.open()
    bench.tap.on_reply = lambda data: other if data.startswith(b"MM") else data
    with pytest.raises(BadReply, match="MM,110000000000 was answered by"):
        bench.lasers.displacements()


@both_generations
@pytest.mark.parametrize("spoilt", [1, 2, 3])
def test_on_a_line_without_parity_the_middle_one_of_three_readings_is_taken(generation: str, spoilt: int) -> None:
    """Of a target that moves, a bit turned in one of them."""
    bench = Bench(generation)
    lasers = driver(bench.tap, bench.clock, settings(generation), guarded=False)
    lasers.open()
    readings = 0

    def turn(data: bytes) -> bytes:
        nonlocal readings
        if not data.startswith((b"M0,", b"MM,")):
            return data
        readings += 1
        bench.clock.sleep_s(0.1)
        return data.replace(b"-02.", b"-42.").replace(b"+0", b"+4") if readings == spoilt else data

    bench.tap.on_reply = turn
    asked_s = bench.clock.now_s()
    moving, standing = lasers.displacements()
    assert readings == 3
    assert ramp(np.array([asked_s]))[0] <= moving.value <= ramp(np.array([bench.clock.now_s()]))[0]
    assert standing.value == -2.0


# Limits and missing edges


@pytest.mark.parametrize(("generation", "samples_max"), [("lkg3001", 65_036), ("lkg5000", 600_000)])
def test_more_than_the_storage_holds_is_refused_before_a_byte_is_sent(generation: str, samples_max: int) -> None:
    bench = Bench(generation)
    set_up = bench.lasers.prepare if generation == "lkg3001" else bench.lasers.arm
    for samples in (0, samples_max + 1):
        with pytest.raises(LimitError, match=f"1 to {samples_max}"):
            set_up(samples, 0.01)
    with pytest.raises(LimitError, match="sampling_us"):
        set_up(10, 0.9e-3)
    assert not bench.tap.sent


@pytest.mark.parametrize("edges", [0, 1, 99])
def test_missing_edges_are_an_error_that_says_how_many_came(edges: int) -> None:
    bench = Bench("lkg5000", edge_timeout_s=3.0)
    with pytest.raises(InstrumentError, match=f"{edges} of 100 trigger edges came, then no more"):
        bench.record(100, 0.05, edges=edges)
    assert bench.clock.now_s() < 0.6 + 100 * 0.05 + 3.0 + 2 * 0.05 + 2.0
    assert bench.record(10, 0.05)[1].shape == (10, 2)


def test_pulses_too_short_for_the_timing_input_are_told_with_the_mend() -> None:
    bench = Bench("lkg5000", edge_timeout_s=1.0)
    bench.line.pulse_s = 2e-6
    with pytest.raises(InstrumentError, match=r"0 of 20 trigger edges came.*2 us is too short.*timing_pulse_s"):
        bench.record(20, 0.05)
    bench.line.pulse_s = 2e-3
    assert bench.record(20, 0.05)[1].shape == (20, 2)


def test_stretched_pulses_must_leave_a_pause() -> None:
    bench = Bench("lkg5000", timing_pulse_s=4e-3)
    assert bench.lasers.longest_record(8e-3) == 600_000
    with pytest.raises(LimitError, match=r"pulses of 0.004 s at its TIMING input .*lower the rate"):
        bench.lasers.arm(10, 7e-3)
    assert not bench.tap.sent


def test_a_pause_of_the_edges_shorter_than_the_patience_is_no_end() -> None:
    bench = Bench("lkg5000", edge_timeout_s=3.0)
    bench.lasers.open()
    bench.lasers.arm(20, 0.05)
    bench.line.begin(bench.clock.now_s(), 0.05, 10)
    bench.clock.call_at(bench.clock.now_s() + 3.0, lambda: bench.line.begin(bench.clock.now_s(), 0.05, 10))
    assert bench.lasers.collect().shape == (20, 2)


def test_nothing_is_collected_that_was_not_armed() -> None:
    bench = Bench("lkg5000")
    bench.lasers.open()
    with pytest.raises(InstrumentError, match="arm first"):
        bench.lasers.collect()


def test_stop_from_another_thread_ends_a_collect_that_waits() -> None:
    bench = Bench("lkg5000", clock=ScaledClock(speed=200.0), simulated={"mode_return_s": 0.0})
    asked = threading.Event()
    failures: list[RigError] = []

    def collect() -> None:
        try:
            bench.lasers.collect()
        except RigError as error:
            failures.append(error)

    bench.lasers.open()
    bench.lasers.arm(1000, 10.0)
    bench.line.begin(bench.clock.now_s(), 10.0, 1000)
    bench.tap.on_send = lambda data: asked.set() if data == b"AN\r" else None
    collecting = threading.Thread(target=collect)
    collecting.start()
    assert asked.wait(20.0)
    bench.lasers.stop()
    bench.lasers.stop()
    collecting.join(20.0)
    assert not collecting.is_alive()
    (failure,) = failures
    assert "of 1000 trigger edges came, then the storage was stopped" in str(failure)


@pytest.mark.parametrize("turned", [False, True])
def test_on_a_line_without_parity_stored_values_are_read_twice(turned: bool) -> None:
    bench = Bench("lkg5000")
    bench.lasers = driver(bench.tap, bench.clock, settings("lkg5000"), guarded=False)
    reads: list[bytes] = []

    def spoil(reply: bytes) -> bytes:
        if reply.startswith(b"AO"):
            reads.append(reply)
            if turned and len(reads) == 2:
                return reply.replace(b"0", b"8", 1)
        return reply

    bench.tap.on_reply = spoil
    if turned:
        with pytest.raises(BadReply, match="read twice; bits turn on the line: set even parity"):
            bench.record(5, 0.1)
    else:
        bench.record(5, 0.1)
        assert len(reads) == 4


# What goes wrong on a wire


@pytest.mark.parametrize(
    ("configured", "connected", "words"),
    [
        ("lkg3001", "lkg5000", "an LK-G5000 answers, not an LK-G3001"),
        ("lkg5000", "lkg3001", "an LK-G3001 answers, not an LK-G5000"),
    ],
)
@pytest.mark.parametrize("left_in", ["measuring", "settings"])
def test_the_other_generation_is_told_by_what_it_answers(
    configured: str, connected: str, words: str, left_in: str
) -> None:
    bench = Bench(connected)
    if left_in == "settings":
        bench.tap.endpoint.connect(lambda _: None).receive(b"Q0\r")
    with pytest.raises(WrongInstrument, match=words):
        driver(bench.tap, bench.clock, settings(configured)).open()


class Parrot:
    """Answers every command with the same bytes."""

    def __init__(self, reply: bytes) -> None:
        self.reply = reply

    def connect(self, send: Send) -> Parrot:
        self._send = send
        return self

    def receive(self, data: bytes) -> None:
        self._send(self.reply)

    def close(self) -> None:
        pass


@both_generations
@pytest.mark.parametrize("reply", [b"-113\r", b"\xff\x00\r", b"\r", b"ER\r", b"ER,R0,77\r"])
def test_something_else_is_not_taken_for_a_controller(generation: str, reply: bytes) -> None:
    lasers = driver(Parrot(reply), VirtualClock(), settings(generation))
    with pytest.raises(WrongInstrument, match="address"):
        lasers.open()
    with pytest.raises(LinkLost, match="not connected"):
        lasers.displacements()


@both_generations
def test_silence_is_a_time_out_that_names_instrument_and_command(generation: str) -> None:
    lasers = driver(Parrot(b""), VirtualClock(), settings(generation))
    with pytest.raises(LinkTimeout, match=r"lasers: R0: .*nothing came"):
        lasers.open()


def test_a_hardware_fault_of_the_second_generation_is_not_mistaken_for_the_first() -> None:
    lasers, _ = talking(
        settings("lkg5000"),
        (b"R0\r", b"R0\r"),
        (b"MS,01\r", b"ER,MS,00\r"),
        (b"R0\r", b"ER,R0,51\r"),
    )
    with pytest.raises(InstrumentError, match="head connection error") as raised:
        lasers.open()
    assert not isinstance(raised.value, WrongInstrument)


@pytest.mark.parametrize("middle", ["SW", "CF", "SW,CF"])
def test_a_refused_setting_is_reported_and_leaves_the_controller_measuring(middle: str) -> None:
    bench = Bench("lkg5000")
    bench.lasers.open()
    code = "62"
    refuse = f"ER,{middle},{code}\r".encode()
    bench.tap.on_reply = lambda data: refuse if data == b"SW,CF\r" else data
    with pytest.raises(InstrumentError, match=f"SW,CF,0000010,10 refused with error {code} .*parameter") as raised:
        bench.lasers.arm(10, 0.01)
    assert raised.value.code == code
    assert bench.lasers.displacements()[1].value == -2.0


@both_generations
def test_garbage_in_place_of_values_is_a_bad_reply(generation: str) -> None:
    bench = Bench(generation)
    bench.lasers.open()
    bench.tap.on_reply = lambda data: data.replace(b"-02.", b"-0 .")
    with pytest.raises(BadReply, match="8 characters"):
        bench.lasers.displacements()
    bench.tap.on_reply = lambda data: data.replace(b",-02.0000", b"")
    with pytest.raises(BadReply):
        bench.lasers.displacements()


@pytest.mark.parametrize("status", [b"AN\r", b"AN,1\r", b"AN,x,1,1\r", b"AN,1,0000001\r"])
def test_a_status_that_lacks_an_outputs_count_is_a_bad_reply(status: bytes) -> None:
    bench = Bench("lkg5000")
    bench.tap.on_reply = lambda data: status if data.startswith(b"AN") else data
    with pytest.raises(BadReply, match="a count per output"):
        bench.record(10, 0.05)


def test_values_lost_in_the_read_out_are_a_bad_reply() -> None:
    bench = Bench("lkg5000")
    bench.tap.on_reply = lambda data: data[:29] + b"\r" if data.startswith(b"AO,-") else data
    with pytest.raises(BadReply, match="3 values of 10"):
        bench.record(10, 0.05)


def test_automatic_output_between_the_replies_is_passed_over() -> None:
    bench = Bench("lkg5000")
    bench.tap.on_reply = lambda data: b"TG,1,+00.0001\r" + data + b"TG,1,+00.0002\r"
    assert bench.record(10, 0.05)[1].shape == (10, 2)


@both_generations
def test_automatic_output_alone_is_a_time_out(generation: str) -> None:
    lasers = driver(Parrot(b"TG,1,+00.0001\r"), VirtualClock(), settings(generation))
    with pytest.raises(LinkTimeout):
        lasers.open()


@both_generations
def test_a_late_reply_is_not_taken_for_the_next_one(generation: str) -> None:
    bench = Bench(generation, simulated={"reply_delay_s": 1.5}, link_timeout_s=2.0)
    clock = bench.clock

    def later(data: bytes) -> bytes:
        clock.call_at(clock.now_s() + 1.5, lambda: bench.tap.send(data))
        return b""

    bench.lasers.open()
    bench.tap.on_reply = later
    with pytest.raises(LinkTimeout):
        bench.lasers.displacements()
    timed_out_s = clock.now_s()
    bench.tap.on_reply = lambda data: data
    assert bench.lasers.displacements()[0].value >= ramp(np.array([timed_out_s]))[0]


@both_generations
def test_a_lost_connection_is_made_anew_for_the_next_question(generation: str) -> None:
    bench = Bench(generation)
    bench.lasers.open()
    bench.tap.hung_up = True
    assert bench.lasers.displacements()[1].value == -2.0


# Settings


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"heads": {}}, "at least 1"),
        ({"heads": {"laser_1": 1}}, "must end in _mm"),
        ({"heads": {"a_mm": 3}}, "outputs 1 to 2"),
        ({"heads": {"a_mm": 0}}, "outputs 1 to 2"),
        ({"heads": {"a_mm": 1, "b_mm": 1}}, "output of its own"),
        ({"sampling_us": 2.55}, "20, 50, 100, 200, 500, 1000"),
        ({"averaging": 2}, "1, 4, 16"),
        ({"storage_max": 65_537}, "stores 65536"),
        ({"storage_max": 0}, "greater than or equal"),
        ({"latency_s": -1.0}, "greater than or equal"),
        ({"baud": 9600}, "Extra inputs"),
        ({"generation": "lkg4000"}, "lkg3001"),
    ],
)
def test_settings_no_controller_can_have_are_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        settings("lkg3001", **values)


def test_the_storage_is_per_output_or_shared() -> None:
    assert settings("lkg3001", storage_max=1000).samples_max == 1000
    assert settings("lkg5000", storage_max=1000).samples_max == 500
