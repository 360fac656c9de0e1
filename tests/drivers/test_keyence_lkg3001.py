"""The LK-G3001's own storage: found out by asking, on its own clock, read with what is known of its times."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.keyence_lkg import KeyenceSettings, Lkg3001
from drivers.transport import InProcessTransport
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import BadReply, InstrumentError, LimitError, WrongInstrument
from rigctl.core.interfaces import FreeRecorder, OwnClockRecord, PacedRecorder
from simulators.clock import VirtualClock
from simulators.keyence_lkg import Lkg3001Settings, SimulatedLkg3001
from simulators.wiring import Signal, TriggerLine

SWITCHES: dict[str, list[Any]] = {
    "target": ["out1-out2-both", "by-output", "both-out1-out2", "none-out1-out2-both"],
    "count_digits": [6, 7, 5, 0],
    "cycle_digits": [2, 1, 0],
    "status_by_output": [True, False],
    "status_repeats_output": [True, False],
    "values_repeat_output": [True, False],
    "start_delay_s": [0.05, 0.0],
}
"""Every reading of every switch of the simulator's dialect; the first of each is the hardest."""

EASIEST = {name: readings[-1] for name, readings in SWITCHES.items()}
HARDEST = {name: readings[0] for name, readings in SWITCHES.items()}
SINGLY = [{**EASIEST, name: reading} for name, readings in SWITCHES.items() for reading in readings]
PAIRS = [
    {**EASIEST, one: first, other: second}
    for one, other in itertools.combinations(SWITCHES, 2)
    for first, second in itertools.product(SWITCHES[one], SWITCHES[other])
]


def time_mm(times_s: FloatArray) -> FloatArray:
    """Says when it was looked at."""
    return 0.1 * times_s


class Bench:
    """A driver, a simulated controller that stores `time_mm` and its opposite, and what goes over the wire."""

    def __init__(
        self, dialect: dict[str, Any] | None = None, heads: tuple[int, ...] = (1, 2), **settings: Any
    ) -> None:
        self.clock = VirtualClock()
        signals: list[Signal] = [time_mm, lambda t: -time_mm(t)]
        simulator = {"dialect": dialect or {}, **settings.pop("simulated", {})}
        self.simulated = SimulatedLkg3001(
            self.clock, signals, TriggerLine(), Lkg3001Settings.model_validate(simulator)
        )
        self.changed: Callable[[bytes], bytes] = lambda data: data
        self.sent: list[bytes] = []
        names = {f"laser_{output}_mm": output for output in heads}
        configured = KeyenceSettings.model_validate({"generation": "lkg3001", "heads": names, **settings})
        self.lasers = Lkg3001("lasers", configured, lambda: InProcessTransport("sim:", self, self.clock), self.clock)

    def connect(self, send: Callable[[bytes], None]) -> Any:
        session = self.simulated.connect(lambda data: send(self.changed(data)))
        receive = session.receive

        def noted(data: bytes) -> None:
            self.sent.append(data)
            receive(data)

        session.receive = noted  # type: ignore[method-assign]
        return session

    def record(self, samples: int = 200, period_s: float = 0.01, lasting_s: float | None = None) -> OwnClockRecord:
        self.lasers.open()
        self.lasers.prepare(samples, period_s)
        self.lasers.begin()
        self.clock.sleep_s(samples * period_s if lasting_s is None else lasting_s)
        return self.lasers.finish()


def error_s(record: OwnClockRecord) -> FloatArray:
    """How far off the rows' times are from when they were taken."""
    rows = np.arange(len(record.values))
    return np.asarray(record.start_s + record.period_s * rows - 10.0 * record.values[:, 0])


def test_it_records_on_its_own_clock_and_not_on_the_edges() -> None:
    bench = Bench()
    assert isinstance(bench.lasers, FreeRecorder)
    assert not isinstance(bench.lasers, PacedRecorder)
    assert [channel.clock_u_s for channel in bench.lasers.channels()] == [0.02, 0.02]


@pytest.mark.parametrize("dialect", [HARDEST, {}, *SINGLY], ids=str)
@pytest.mark.parametrize("heads", [(1, 2), (1,), (2,)])
def test_in_every_reading_of_the_manual_it_finds_the_form_and_the_values(
    dialect: dict[str, Any], heads: tuple[int, ...]
) -> None:
    record = Bench(dialect, heads).record()
    assert record.values.shape[0] >= 200
    signs = [1.0 if output == 1 else -1.0 for output in heads]
    first = record.values[:, 0] * signs[0]
    np.testing.assert_allclose(record.values, np.outer(first, signs), atol=1e-12)
    np.testing.assert_allclose(np.diff(first), 1e-3, atol=1.01e-4)
    # The bounds are strict: the truth lies within their half width; rounded values, and a clock that is fast.
    late_s = record.start_s + record.period_s * np.arange(len(first)) - 10.0 * first
    assert np.abs(late_s).max() < np.sqrt(3.0) * record.start_u_s + 10.0 * 0.5e-4 + 40e-6 * 2.1


def test_in_all_pairs_of_readings_it_records() -> None:
    for dialect in PAIRS:
        record = Bench(dialect).record(20)
        np.testing.assert_allclose(record.values[:, 1], -record.values[:, 0], atol=1e-12)
        assert np.abs(error_s(record)).max() < 2.0 * record.start_u_s + 1e-3, dialect


def test_what_accepts_no_form_is_refused_with_the_manuals_pages() -> None:
    bench = Bench()
    bench.changed = lambda data: b"ER,CI,22\r" if data.startswith(b"SW,CI") else data
    with pytest.raises(WrongInstrument, match=r"lasers: .*manual, pages 5-7 to 5-23.*keyence_storage.py") as refused:
        bench.lasers.open()
    assert "\n" not in str(refused.value)
    assert bench.sent[-1] == b"R0\r"


def test_an_output_without_values_is_told_when_it_is_opened() -> None:
    bench = Bench()
    bench.changed = lambda data: re.sub(rb"AN,2,(\d),\d+", rb"AN,2,\1,0000000", data)
    with pytest.raises(WrongInstrument, match="has each of them a head"):
        bench.lasers.open()


def test_an_output_that_was_asked_before_it_stored_is_asked_again() -> None:
    """Questions may take longer than the trial: the first output had no value yet when the other's were all there."""
    bench, asked = Bench(), list[bytes]()

    def first_too_early(data: bytes) -> bytes:
        if data.startswith(b"AN,"):
            bench.clock.sleep_s(0.75)
            asked.append(data)
        return re.sub(rb"AN,1,(\d),\d+", rb"AN,1,\1,0000000", data) if len(asked) == 1 else data

    bench.changed = first_too_early
    bench.lasers.open()
    assert len(asked) > 2


def test_an_error_that_says_nothing_of_the_form_ends_the_search() -> None:
    bench = Bench()
    bench.changed = lambda data: b"ER,CI,88\r" if data.startswith((b"SW,CI", b"ER,CI")) else data
    with pytest.raises(InstrumentError, match="refused with error 88") as refused:
        bench.lasers.open()
    assert not isinstance(refused.value, WrongInstrument)


def test_the_form_is_looked_for_once() -> None:
    bench = Bench()
    bench.lasers.open()
    bench.lasers.close()
    del bench.sent[:]
    bench.lasers.open()
    assert bench.sent == [b"R0\r", b"M1\r"]


@pytest.mark.parametrize(("period_s", "step_s"), [(0.01, 0.01), (0.0125, 0.01), (0.02, 0.02), (0.001, 0.001)])
def test_its_step_is_the_slowest_that_is_not_slower_than_the_edges(period_s: float, step_s: float) -> None:
    record = Bench().record(100, period_s)
    assert record.period_s == pytest.approx(step_s)
    assert len(record.values) * step_s >= 100 * period_s


def test_a_storage_that_was_stopped_too_early_is_an_error() -> None:
    bench = Bench()
    with pytest.raises(InstrumentError, match=r"\d+ of 200 values were stored, then the storage was stopped"):
        bench.record(200, lasting_s=0.5)
    with pytest.raises(InstrumentError, match="call prepare first"):
        bench.lasers.finish()
    assert len(bench.record(20).values) >= 20


def test_more_than_the_storage_holds_is_refused() -> None:
    bench = Bench(storage_max=1000)
    assert bench.lasers.longest_record(0.01) == 500
    with pytest.raises(LimitError, match="1 to 500"):
        bench.lasers.prepare(501, 0.01)
    assert not bench.sent


def test_a_line_too_slow_to_see_when_it_began_is_an_error() -> None:
    bench = Bench(simulated={"reply_delay_s": 0.3})
    with pytest.raises(InstrumentError, match=r"first value is known to [\d.]+ ms only, 20 ms are wanted"):
        bench.record()


def test_a_storage_that_does_not_begin_is_an_error() -> None:
    bench = Bench()
    bench.lasers.open()
    bench.lasers.prepare(20, 0.01)
    bench.changed = lambda data: b"AN,1,1,0000000\r" if data.startswith(b"AN,1") else data
    with pytest.raises(InstrumentError, match="no value was stored in 2 s after AS"):
        bench.lasers.begin()


@pytest.mark.parametrize("status", [b"AN\r", b"AN,x,1\r", b"AN,2,1,0000001\r", b"AN,1,2,0000001\r"])
def test_a_status_of_another_output_or_of_none_is_a_bad_reply(status: bytes) -> None:
    bench = Bench(heads=(1,))
    bench.lasers.open()
    bench.changed = lambda data: status if data.startswith(b"AN,1") else data
    with pytest.raises(BadReply, match="a count per output"):
        bench.record()


def test_values_lost_in_the_read_out_are_a_bad_reply() -> None:
    bench = Bench()
    bench.changed = lambda data: data[:31] + b"\r" if data.startswith(b"AO,1") else data
    with pytest.raises(BadReply, match=r"3 values of \d+"):
        bench.record()
