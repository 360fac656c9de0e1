"""The simulated Keyence LK-G controllers, asked in bytes."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.core.arrays import FloatArray
from simulators.clock import VirtualClock
from simulators.keyence_lkg import (
    Lkg3001Settings,
    Lkg5000Settings,
    SimulatedLkg3001,
    SimulatedLkg5000,
)
from simulators.keyence_lkg.heads import high_pass, low_pass, moving_average
from simulators.keyence_lkg.values import format_value, format_values
from simulators.wiring import Signal, TriggerLine

Simulated = SimulatedLkg3001 | SimulatedLkg5000


def constant(value_mm: float) -> Signal:
    return lambda times_s: np.full_like(times_s, value_mm)


def ramp(times_s: FloatArray) -> FloatArray:
    return times_s


class Bench:
    """A controller on a virtual clock, and a client's end of its line."""

    def __init__(self, generation: str, *heads: Signal, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.line = TriggerLine(pulse_s=4e-3)
        signals = heads or (constant(0.0123), constant(-0.4567))
        self.controller: Simulated
        if generation == "lkg3001":
            self.controller = SimulatedLkg3001(
                self.clock,
                signals,
                self.line,
                Lkg3001Settings(**settings),
            )
        else:
            self.controller = SimulatedLkg5000(
                self.clock,
                signals,
                self.line,
                Lkg5000Settings(**settings),
            )
        self.received = bytearray()
        self.session = self.controller.connect(self.received.extend)

    def send(self, data: bytes) -> None:
        self.session.receive(data)

    def ask(self, command: str) -> str:
        """The reply to one command, delays included."""
        self.received.clear()
        self.send(command.encode() + b"\r")
        self.clock.wait_for(lambda: self.received.endswith(b"\r"), 10.0)
        assert self.received.count(b"\r") == 1, (command, bytes(self.received))
        return self.received[:-1].decode()

    def converse(self, *exchanges: tuple[str, str]) -> None:
        assert [(command, self.ask(command)) for command, _ in exchanges] == list(exchanges)

    def set(self, *commands: str) -> None:
        """Write settings and go back to measuring."""
        for command in ("Q0", *commands, "R0"):
            assert not self.ask(command).startswith("ER"), command

    def stored(self, output: str) -> list[float]:
        _, *values = self.ask(f"AO,{output}").split(",")
        return [math.nan if v == "XXXXXXXX" else float(v.replace("FFFFFFF", "inf")) for v in values]


GENERATIONS = ("lkg3001", "lkg5000")
OUTPUT = {"lkg3001": "1", "lkg5000": "01"}
MEASURE = {"lkg3001": "M1", "lkg5000": "MS,01"}
CODES = {
    "lkg3001": {"command": "00", "status": "01", "length": "20", "count": "21", "parameter": "22"},
    "lkg5000": {"command": "50", "status": "51", "length": "60", "count": "61", "parameter": "62"},
}
both_generations = pytest.mark.parametrize("generation", GENERATIONS)


# The exchanges of the protocol notes


def test_the_first_generation_answers_as_its_manual_and_its_users_report() -> None:
    position_mm = [0.0123]
    bench = Bench("lkg3001", lambda t: np.full_like(t, position_mm[0]), constant(-0.4567))
    bench.converse(
        ("R0", "ER,R0,01"),
        ("M1", "M1,+00.0123"),
        ("M2", "M2,-00.4567"),
        ("M0", "M0,+00.0123,-00.4567"),
        ("Q0", "Q0"),
        ("M1", "ER,M1,01"),
        ("SW,CA,2", "SW,CA"),
        ("SR,CA", "SR,CA,2"),
        ("R0", "R0"),
    )
    position_mm[0] = 15.1
    bench.converse(("M1", "M1,+FFFFFFF"), ("ZZ", "ER,ZZ,00"))


def test_the_second_generation_stores_and_reads_out_as_its_users_report() -> None:
    bench = Bench("lkg5000", constant(0.0012), constant(1.0))
    bench.converse(
        ("Q0", "Q0"),
        ("SW,CA,5", "SW,CA"),
        ("SW,OC,01,0,2", "SW,OC"),
        ("SW,CF,0010000,03", "SW,CF"),
        ("SW,OK,01,1", "SW,OK"),
        ("R0", "R0"),
        ("AQ", "AQ"),
        ("AS", "AS"),
    )
    bench.clock.sleep_s(4.7115)
    bench.converse(("AN", "AN,1,0004711,0000000"))
    bench.clock.sleep_s(10.0)
    bench.converse(
        ("AN", "AN,0,0010000,0000000"),
        ("AO,01", "AO," + ",".join(["+00.0012"] * 10_000)),
        ("MS,01", "MS,01,+00.0012"),
        ("SW,CA,5", "ER,SW,51"),
        ("MM,110000000000", "MM,110000000000,+00.0012,+01.0000"),
        ("MA", "MA,+00.0012,+01.0000" + ",XXXXXXXX" * 10),
    )


# Values


@pytest.mark.parametrize(
    ("value_mm", "decimals", "text"),
    [
        (1.2345, 4, "+01.2345"),
        (-0.012, 4, "-00.0120"),
        (1234.56, 4, "+1234.56"),
        (-1.2, 1, "-00001.2"),
        (0.26, 3, "+000.260"),
        (99.99996, 4, "+100.000"),
        (-0.00001, 4, "+00.0000"),
        (99_999.94, 4, "+99999.9"),
        (1e6, 4, "+FFFFFFF"),
        (-math.inf, 4, "-FFFFFFF"),
        (math.nan, 4, "XXXXXXXX"),
    ],
)
def test_a_value_has_eight_characters(value_mm: float, decimals: int, text: str) -> None:
    assert format_value(value_mm, decimals) == text


@given(st.floats(-99_999, 99_999), st.integers(1, 5))
def test_a_written_value_is_the_value_within_half_its_last_place(value_mm: float, decimals: int) -> None:
    text = format_value(value_mm, decimals)
    assert re.fullmatch(r"[+-]\d+\.\d+", text)
    assert len(text) == 8
    last_place = 10.0 ** -len(text.partition(".")[2])
    assert abs(float(text) - value_mm) <= 0.5 * last_place * (1 + 1e-6)


@given(
    st.lists(st.floats(-99.0, 99.0) | st.floats(-1e-3, 1e-3) | st.floats(allow_nan=True, allow_infinity=True)),
    st.integers(1, 5),
)
def test_values_written_together_are_those_written_one_by_one(values_mm: list[float], decimals: int) -> None:
    assert format_values(values_mm, decimals) == ",".join(format_value(each, decimals) for each in values_mm)


@both_generations
@pytest.mark.parametrize(
    ("head_mm", "text"), [(math.nan, "XXXXXXXX"), (15.0001, "+FFFFFFF"), (-16.0, "-FFFFFFF"), (15.0, "+15.0000")]
)
def test_a_head_without_a_value_says_why(generation: str, head_mm: float, text: str) -> None:
    assert Bench(generation, constant(head_mm)).ask(MEASURE[generation]).endswith("," + text)


def test_an_output_without_a_head_has_no_valid_value() -> None:
    assert Bench("lkg3001", constant(1.0)).ask("M0") == "M0,+01.0000,XXXXXXXX"
    assert Bench("lkg5000", constant(1.0)).ask("MS,12") == "MS,12,XXXXXXXX"


# Grammar


@both_generations
def test_letters_may_be_small_and_bytes_may_come_one_by_one(generation: str) -> None:
    bench = Bench(generation)
    for byte in f"{MEASURE[generation].lower()}\rq0\r".encode():
        bench.send(bytes([byte]))
    assert bytes(bench.received) == f"{MEASURE[generation]},+00.0123\rQ0\r".encode()


@both_generations
@pytest.mark.parametrize(
    ("line", "middle", "fault"),
    [
        ("ZZ", "ZZ", "command"),
        ("\tAN", "?AN", "command"),
        ("AO", "AO", "count"),
        ("PW", "PW", "count"),
        ("Q0,1", "Q0", "count"),
        ("AO,13", "AO", "parameter"),
        ("AO,x", "AO", "parameter"),
        ("PW,8", "PW", "parameter"),
        ("KL,2", "KL", "parameter"),
        ("M" * 150 + "\xe9", "M" * 10, "command"),
    ],
)
def test_a_wrong_command_is_refused_with_the_generations_code(
    generation: str, line: str, middle: str, fault: str
) -> None:
    bench = Bench(generation)
    bench.send(line.encode("latin-1") + b"\r")
    assert bytes(bench.received) == f"ER,{middle},{CODES[generation][fault]}\r".encode()


@pytest.mark.parametrize(
    ("generation", "line", "reply"),
    [
        ("lkg3001", "MS,01", "ER,MS,00"),
        ("lkg3001", "M3", "ER,M3,00"),
        ("lkg3001", "M1,1", "ER,M1,21"),
        ("lkg3001", "VR,3", "ER,VR,22"),
        ("lkg3001", "AN", "ER,AN,21"),
        ("lkg5000", "AN,1", "ER,AN,61"),
        ("lkg5000", "M1", "ER,M1,50"),
        ("lkg5000", "MS", "ER,MS,61"),
        ("lkg5000", "MS,13", "ER,MS,62"),
        ("lkg5000", "MM,11", "ER,MM,62"),
        ("lkg5000", "TS,2,01", "ER,TS,62"),
    ],
)
def test_a_generation_refuses_what_only_the_other_knows(generation: str, line: str, reply: str) -> None:
    assert Bench(generation).ask(line) == reply


@both_generations
@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("SW,ZZ,1", "parameter"),
        ("SW", "parameter"),
        ("SW,CA,9", "parameter"),
        ("SW,CA,-1", "parameter"),
        ("SW,CA", "count"),
        ("SW,CA,1,1", "count"),
        ("SR,CA,1", "count"),
        ("SW,OC", "count"),
        ("SW,OC,0,0,1", "parameter"),
        ("SW,OF,1,+01.234", "parameter"),
    ],
)
def test_a_wrong_setting_is_refused(generation: str, line: str, fault: str) -> None:
    bench = Bench(generation)
    bench.ask("Q0")
    assert bench.ask(line).split(",")[::2] == ["ER", CODES[generation][fault]]


@pytest.mark.parametrize(
    ("generation", "names_setting", "reply"),
    [
        ("lkg3001", True, "ER,OF,01"),
        ("lkg3001", False, "ER,SW,01"),
        ("lkg5000", True, "ER,OF,51"),
        ("lkg5000", False, "ER,SW,51"),
    ],
)
def test_which_command_a_refused_setting_names_is_a_matter_of_configuration(
    generation: str, names_setting: bool, reply: str
) -> None:
    assert Bench(generation, refusal_names_setting=names_setting).ask("SW,OF,1,+000000") == reply


@both_generations
@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_an_endless_line_is_refused_once_and_forgotten(generation: str, cut: int) -> None:
    bench = Bench(generation)
    line = b"A" * 450
    for start in range(0, len(line), cut):
        bench.send(line[start : start + cut])
    refusal = f"ER,AAAAAAAAAA,{CODES[generation]['length']}\r".encode()
    assert bytes(bench.received) == refusal
    bench.send(b"\rPR\r")
    assert bytes(bench.received) == refusal + b"PR,0\r"


@both_generations
def test_an_overlong_line_that_comes_at_once_is_refused_once(generation: str) -> None:
    bench = Bench(generation)
    bench.send(b"AO" + b"1" * 300 + b"\rPR\r")
    assert bytes(bench.received) == f"ER,AO11111111,{CODES[generation]['length']}\rPR,0\r".encode()


_measuring = ["M0", "M1", "MS", "MM", "MA", "V1", "W0", "VS", "WM", "T1", "TS", "DS", "DO", "DQ", "VR", "PW", "PR"]
_storing = ["AS", "AP", "AQ", "AN", "AO"]
_setting = ["SW", "SR", "Q0", "R0", "CA", "CF", "CI", "OC", "OF", "OK", "HB", "HA", "OE", "M", "KL"]
_parameters = ["0", "1", "01", "2", "10", "110000000000", "0000003", "+012345", "", "-1", "1e5", "\xb2"]
_words = st.sampled_from([*_measuring, *_storing, *_setting, *_parameters])
_command = st.lists(_words, min_size=1, max_size=6).map(lambda words: ",".join(words).encode("latin-1"))
_noise = st.binary(max_size=40).map(lambda data: data.replace(b"\r", b""))


@both_generations
@given(lines=st.lists(_command | _noise, max_size=20), cut=st.integers(1, 9))
def test_any_line_that_is_not_empty_gets_exactly_one_reply(generation: str, lines: list[bytes], cut: int) -> None:
    bench = Bench(generation, constant(1.0), constant(math.nan), mode_return_s=0.3)
    data = b"".join(line + b"\r" for line in lines)
    for start in range(0, len(data), cut):
        bench.send(data[start : start + cut])
    bench.clock.sleep_s(60.0)
    assert bench.received.count(b"\r") == sum(bool(line.lstrip(b"\n")) for line in lines)
    assert re.fullmatch(rb"(?:[\x20-\x7e]*\r)*", bytes(bench.received))


# Modes


@both_generations
def test_measuring_and_settings_exclude_each_other(generation: str) -> None:
    bench = Bench(generation, refusal_names_setting=False)
    status = CODES[generation]["status"]
    status_of = "AN,1" if generation == "lkg3001" else "AN"
    measuring = [MEASURE[generation], "AS", "AP", "AQ", status_of, f"AO,{OUTPUT[generation]}", "PR"]
    bench.converse(("SR,CA", f"ER,SR,{status}"), ("R0", f"ER,R0,{status}"), ("Q0", "Q0"), ("Q0", f"ER,Q0,{status}"))
    for command in measuring:
        assert bench.ask(command) == f"ER,{command[:2]},{status}"
    bench.converse(("R0", "R0"))
    for command in measuring:
        assert bench.ask(command).startswith(command.removesuffix(f",{OUTPUT[generation]}"))


def test_a_command_sent_before_the_reply_is_answered_after_it() -> None:
    bench = Bench("lkg5000", mode_return_s=0.6)
    bench.send(b"Q0\rR0\rMS,01\r")
    assert bytes(bench.received) == b"Q0\r"
    bench.clock.sleep_s(0.59)
    assert bytes(bench.received) == b"Q0\r"
    bench.clock.sleep_s(0.02)
    assert bytes(bench.received) == b"Q0\rR0\rMS,01,+00.0123\r"


def test_measuring_may_be_refused_for_a_while_after_the_return_to_it() -> None:
    bench = Bench("lkg5000", mode_settle_s=0.5)
    bench.converse(("Q0", "Q0"), ("R0", "R0"), ("MS,01", "ER,MS,51"))
    bench.clock.sleep_s(0.5)
    bench.converse(("MS,01", "MS,01,+00.0123"))


def test_a_client_that_has_gone_is_sent_nothing() -> None:
    bench = Bench("lkg5000", reply_delay_s=0.1)
    bench.send(b"MS,01\rMS,02\r")
    bench.session.close()
    bench.clock.sleep_s(1.0)
    assert not bench.received


@both_generations
def test_two_clients_share_the_controller_but_not_their_lines(generation: str) -> None:
    bench = Bench(generation)
    other = bytearray()
    session = bench.controller.connect(other.extend)
    bench.send(b"Q")
    session.receive(b"PR\r")
    bench.send(b"0\r")
    session.receive(b"PR\r")
    assert bytes(bench.received) == b"Q0\r"
    assert bytes(other) == f"PR,0\rER,PR,{CODES[generation]['status']}\r".encode()


# Settings


@pytest.mark.parametrize(
    ("generation", "address", "written", "read"),
    [
        ("lkg3001", "CA", "3", "3"),
        ("lkg3001", "CI", "2,004711,03", "2,004711,03"),
        ("lkg3001", "OC,2", "0,9", "0,9"),
        ("lkg3001", "OF,1", "+012345", "+01.2345"),
        ("lkg3001", "HA,M,1", "1", "1"),
        ("lkg3001", "HB,2", "4", "4"),
        ("lkg3001", "HE,1", "1", "1"),
        ("lkg5000", "CA", "0", "0"),
        ("lkg5000", "CF", "1200000,09", "1200000,09"),
        ("lkg5000", "OA,T,01", "2", "2"),
        ("lkg5000", "OB,01", "+000.000,+000.001,+1.5,-1.5", "+000.000,+000.001,+1.5,-1.5"),
        ("lkg5000", "OC,12", "2,3", "2,3"),
        ("lkg5000", "OD,01", "4", "4"),
        ("lkg5000", "OE,M,01", "1", "1"),
        ("lkg5000", "OF,01", "-000001", "-00.0001"),
        ("lkg5000", "OI,01", "3", "3"),
        ("lkg5000", "OJ,01", "1", "1"),
        ("lkg5000", "OK,12", "1", "1"),
        ("lkg5000", "LM,01", "+500.000,-500.000,0000.000", "+500.000,-500.000,0000.000"),
        ("lkg5000", "HB,M,01", "3", "3"),
        ("lkg5000", "HE,01", "1", "1"),
        ("lkg5000", "CH", "2", "2"),
        ("lkg5000", "EF", "2", "02"),
    ],
)
def test_a_setting_is_remembered_in_its_program(generation: str, address: str, written: str, read: str) -> None:
    bench = Bench(generation)
    bench.ask("Q0")
    default = bench.ask(f"SR,{address}")
    assert default != f"SR,{address},{read}"
    bench.converse(
        (f"SW,{address},{written}", f"SW,{address[:2]}"),
        (f"SR,{address}", f"SR,{address},{read}"),
        ("R0", "R0"),
        ("PW,3", "PW"),
        ("PR", "PR,3"),
        ("Q0", "Q0"),
        (f"SR,{address}", default),
        ("R0", "R0"),
        ("PW,0", "PW"),
        ("Q0", "Q0"),
        (f"SR,{address}", f"SR,{address},{read}"),
    )


@both_generations
def test_an_offset_is_added_and_auto_zero_taken_away(generation: str) -> None:
    bench = Bench(generation, lambda t: 2.0 + t)
    out = OUTPUT[generation]
    zero, unzero = ("V1", "W1") if generation == "lkg3001" else ("VS,01", "WS,01")

    def shown() -> float:
        return float(bench.ask(MEASURE[generation]).rpartition(",")[2])

    bench.set(f"SW,OF,{out},-005000")
    start_s = bench.clock.now_s()
    assert shown() == pytest.approx(1.5 + start_s, abs=1e-4)
    assert bench.ask(zero) == zero[:2]
    bench.clock.sleep_s(0.25)
    assert shown() == pytest.approx(-0.25, abs=1e-4)
    assert bench.ask(unzero) == unzero[:2]
    assert shown() == pytest.approx(1.75 + start_s, abs=1e-4)


@both_generations
def test_each_program_measures_with_its_own_settings(generation: str) -> None:
    bench = Bench(generation, constant(2.0), mode_return_s=0.0)
    bench.ask("PW,3")
    bench.set(f"SW,OF,{OUTPUT[generation]},+010000")
    shown = [bench.ask(MEASURE[generation]).rpartition(",")[2]]
    for program in "03":
        bench.ask(f"PW,{program}")
        shown.append(bench.ask(MEASURE[generation]).rpartition(",")[2])
    assert shown == ["+03.0000", "+02.0000", "+03.0000"]


@both_generations
def test_auto_zero_without_a_value_changes_nothing(generation: str) -> None:
    lost = [True]
    bench = Bench(generation, lambda t: np.full_like(t, math.nan if lost[0] else 3.0))
    bench.ask("V1" if generation == "lkg3001" else "VS,01")
    lost[0] = False
    assert bench.ask(MEASURE[generation]).endswith(",+03.0000")


@both_generations
def test_timing_holds_the_value_until_let_go_or_reset(generation: str) -> None:
    first = generation == "lkg3001"
    hold, release, reset = ("T1,1", "T0,1", "VR,1") if first else ("TS,1,01", "TS,0,01", "DS,01")
    bench = Bench(generation, ramp)
    for end in (release, reset):
        bench.ask(hold)
        held = bench.ask(MEASURE[generation])
        bench.clock.sleep_s(1.0)
        assert bench.ask(MEASURE[generation]) == held
        assert bench.ask(end) == end[:2]
        assert bench.ask(MEASURE[generation]) != held


def test_outputs_are_controlled_singly_in_groups_and_all_at_once() -> None:
    bench = Bench("lkg5000", constant(1.0), constant(2.0), constant(3.0))
    three = "MM,111000000000"
    bench.converse(
        ("VS,02", "VS"),
        (three, three + ",+01.0000,+00.0000,+03.0000"),
        ("VM,101000000000", "VM"),
        (three, three + ",+00.0000,+00.0000,+00.0000"),
        ("WM,001000000000", "WM"),
        (three, three + ",+00.0000,+00.0000,+03.0000"),
        ("WA", "WA"),
        (three, three + ",+01.0000,+02.0000,+03.0000"),
        ("VA", "VA"),
        (three, three + ",+00.0000,+00.0000,+00.0000"),
        ("DA", "DA"),
        ("DM,110000000000", "DM"),
    )
    pair = Bench("lkg3001", constant(1.0), constant(2.0))
    pair.converse(("V0", "V0"), ("M0", "M0,+00.0000,+00.0000"), ("W2", "W2"), ("M0", "M0,+00.0000,+02.0000"))


def test_statistics_reach_back_to_where_they_were_cleared() -> None:
    bench = Bench("lkg3001", ramp)
    bench.clock.sleep_s(2.0)
    bench.converse(("DO,1", "DO,1,+02.0000,+00.0000,+02.0000,+01.0000"), ("DQ,1", "DQ,1"))
    bench.clock.sleep_s(1.0)
    bench.converse(("DO,1", "DO,1,+03.0000,+02.0000,+01.0000,+02.5000"))
    bench.converse(("DO,2", "DO,2" + ",XXXXXXXX" * 4))


# Filters


@pytest.mark.parametrize("cycles", [1, 4, 64, 4096, 262_144])
def test_a_moving_average_delays_by_half_its_length(cycles: int) -> None:
    kernel = moving_average(cycles, 1e-3)
    assert len(kernel.lags_s) <= 64
    assert kernel.weights.sum() == pytest.approx(1.0)
    assert kernel.lags_s @ kernel.weights == pytest.approx((cycles - 1) / 2 * 1e-3)


def test_a_low_pass_delays_by_its_time_constant_and_a_high_pass_blocks_what_stands() -> None:
    slow, fast = low_pass(3.0), high_pass(3.0)
    assert slow.weights.sum() == pytest.approx(1.0)
    assert slow.lags_s @ slow.weights == pytest.approx(1 / (2 * math.pi * 3.0), rel=0.1)
    assert fast.weights.sum() == pytest.approx(0.0, abs=1e-12)


@both_generations
def test_the_average_chosen_shows_in_the_value(generation: str) -> None:
    bench = Bench(generation, ramp, sampling_us=1000.0, mode_return_s=0.0)
    bench.set(f"SW,OC,{OUTPUT[generation]},0,5")
    bench.clock.sleep_s(2.0)
    assert bench.ask(MEASURE[generation]).endswith(f"{2.0 - 1023 / 2 * 1e-3:+08.4f}")
    bench.set(f"SW,CA,{3 if generation == 'lkg3001' else 6}")
    assert bench.ask(MEASURE[generation]).endswith(f"{2.0 - 1023 / 2 * 200e-6:+08.4f}")


@pytest.mark.parametrize(("kind", "gain"), [(1, 0.5), (2, 0.5)])
def test_a_filter_passes_half_the_power_at_its_cut_off(kind: int, gain: float) -> None:
    def sine(times_s: FloatArray) -> FloatArray:
        return 10.0 * np.sin(2 * math.pi * 3.0 * times_s)

    bench = Bench("lkg5000", sine, mode_return_s=0.0)
    bench.set("SW,OK,01,1", "SW,CA,8", "SW,CF,0001000,00", f"SW,OC,01,{kind},4")
    bench.ask("AS")
    bench.clock.sleep_s(2.0)
    assert np.var(bench.stored("01")) / 50.0 == pytest.approx(gain, rel=0.15)


def test_a_window_that_leaves_the_range_both_ways_has_no_value() -> None:
    bench = Bench("lkg3001", lambda t: np.where(t < 0.999, -20.0, 20.0), mode_return_s=0.0)
    bench.set("SW,OC,1,0,1")
    bench.clock.sleep_s(1.0)
    assert bench.ask("M1") == "M1,XXXXXXXX"


# Storage


def armed(generation: str, *heads: Signal, count: int = 100, cycle: int = 10, **settings: float) -> Bench:
    """An LK-G5000 that stores all its heads."""
    bench = Bench(generation, *heads, **{"mode_return_s": 0.0, **settings})
    outputs = [f"{n + 1:0{len(OUTPUT[generation])}d}" for n in range(len(heads))]
    bench.set(f"SW,CF,{count:07d},{cycle:02d}", *(f"SW,OK,{output},1" for output in outputs))
    bench.converse(("AQ", "AQ"), ("AS", "AS"))
    return bench


def test_each_edge_of_the_timing_input_stores_each_heads_value() -> None:
    bench = armed("lkg5000", ramp, lambda t: -2 * t, latency_s=0.003)
    bench.line.begin(0.5, 0.02, 100)
    bench.clock.sleep_s(1.0)
    bench.converse(("AN", "AN,1,0000025,0000025"))
    bench.clock.sleep_s(2.0)
    bench.converse(("AN", "AN,0,0000100,0000100"))
    expected = 0.5 + 0.02 * np.arange(100) + 0.003
    assert bench.stored("01") == pytest.approx(expected, abs=0.6e-4)
    assert bench.stored("02") == pytest.approx(-2 * expected, abs=0.6e-4)


def test_edges_from_the_start_to_the_stop_count_both_included_and_once() -> None:
    bench = armed("lkg5000", ramp)
    bench.line.begin(0.0, 1.0, 100)
    bench.converse(("AN", "AN,1,0000001,0000000"), ("AP", "AP"), ("AS", "AS"))
    bench.clock.sleep_s(3.0)
    bench.converse(("AN", "AN,1,0000004,0000000"), ("AP", "AP"))
    bench.clock.sleep_s(3.0)
    bench.converse(("AN", "AN,0,0000004,0000000"), ("AS", "AS"))
    bench.clock.sleep_s(1.0)
    assert bench.stored("01") == [0.0, 1.0, 2.0, 3.0, 6.0, 7.0]


def test_a_storage_ends_when_full_and_begins_anew_only_when_cleared() -> None:
    bench = armed("lkg5000", ramp, count=3)
    bench.line.begin(1.0, 1.0, 100)
    bench.clock.sleep_s(10.0)
    bench.converse(("AN", "AN,0,0000003,0000000"), ("AS", "AS"), ("AN", "AN,0,0000003,0000000"))
    assert bench.stored("01") == [1.0, 2.0, 3.0]
    bench.converse(("AQ", "AQ"), ("AN", "AN,0,0000000,0000000"), (f"AO,{'01'}", "AO"), ("AS", "AS"))
    bench.clock.sleep_s(10.0)
    # The edge at 10 s is the one at the very instant of the start.
    assert bench.stored("01") == [10.0, 11.0, 12.0]


def test_clearing_a_storage_that_runs_lets_it_go_on() -> None:
    bench = armed("lkg5000", ramp, count=3)
    bench.line.begin(1.0, 1.0, 100)
    bench.clock.sleep_s(2.0)
    bench.converse(("AQ", "AQ"), ("AN", "AN,1,0000000,0000000"))
    bench.clock.sleep_s(5.0)
    assert bench.stored("01") == [3.0, 4.0, 5.0]


def test_leaving_the_measuring_mode_ends_a_storage() -> None:
    bench = armed("lkg5000", ramp)
    bench.line.begin(1.0, 1.0, 100)
    bench.clock.sleep_s(2.0)
    bench.set()
    bench.clock.sleep_s(2.0)
    bench.converse(("AN", "AN,0,0000002,0000000"))
    assert bench.stored("01") == [1.0, 2.0]


def test_values_stored_before_an_auto_zero_keep_their_zero() -> None:
    bench = armed("lkg5000", constant(2.0))
    bench.line.begin(1.0, 1.0, 100)
    bench.clock.sleep_s(2.0)
    bench.ask("VS,01")
    bench.clock.sleep_s(1.0)
    assert bench.stored("01") == [2.0, 2.0, 0.0]


def test_a_storage_by_cycles_takes_multiples_of_the_sampling_cycle() -> None:
    bench = armed("lkg5000", ramp, count=5, cycle=4, sampling_us=1000.0)
    start_s = bench.clock.now_s()
    bench.clock.sleep_s(0.0705)
    bench.converse(("AN", "AN,1,0000003,0000000"))
    bench.clock.sleep_s(1.0)
    expected = start_s + 0.02 * np.arange(1, 6)
    assert bench.stored("01") == pytest.approx(expected, abs=0.6e-4)


def test_the_second_generations_outputs_share_the_memory() -> None:
    bench = armed("lkg5000", ramp, ramp, ramp, count=100, storage_values=100)
    bench.line.begin(1.0, 0.01, 100)
    bench.clock.sleep_s(10.0)
    bench.converse(("AN", "AN,0,0000033,0000033,0000033"))


def test_only_outputs_chosen_for_storage_are_stored() -> None:
    bench = armed("lkg5000", ramp, ramp, count=2)
    bench.set(f"SW,OK,{'01'},0")
    bench.ask("AS")
    bench.line.begin(1.0, 0.01, 100)
    bench.clock.sleep_s(10.0)
    bench.converse(("AN", "AN,0,0000000,0000002"), (f"AO,{'01'}", "AO"))


def test_heads_are_sampled_before_the_world_forgets() -> None:
    oldest_s: list[float] = []

    def recent(times_s: FloatArray) -> FloatArray:
        oldest_s.append(bench.clock.now_s() - times_s.min())
        return times_s

    bench = Bench(
        "lkg5000",
        recent,
        mode_return_s=0.0,
    )
    bench.set("SW,CF,0001000,10", "SW,OK,01,1")
    bench.ask("AS")
    bench.line.begin(1.0, 1.0, 1000)
    bench.clock.sleep_s(500.0)
    bench.stored("01")
    assert len(oldest_s) > 10
    assert max(oldest_s) <= 60.0


@both_generations
def test_a_wrong_build_is_refused(generation: str) -> None:
    with pytest.raises(ValueError, match="sampling"):
        Bench(generation, sampling_us=3.0)
    with pytest.raises(ValueError, match="13 heads"):
        Bench(generation, *[ramp] * 13)


@both_generations
def test_the_kind_is_the_one_that_rig_files_name(generation: str) -> None:
    assert Bench(generation).controller.kind == f"keyence-{generation}"


# The first generation's storage


def set_up(*heads: Signal, setting: str, **settings: Any) -> Bench:
    bench = Bench("lkg3001", *heads, **settings)
    bench.set(setting)
    bench.converse(("AQ", "AQ"), ("AS", "AS"))
    return bench


def test_the_first_generation_stores_on_its_own_clock_whatever_the_timing_input_says() -> None:
    bench = set_up(ramp, lambda t: -2 * t, setting="SW,CI,2,000100,03", clock_ppm=1000.0)
    bench.line.begin(0.5, 0.3, 100)
    start_s = bench.clock.now_s()
    bench.clock.sleep_s(0.255)
    bench.converse(("AN,1", "AN,1,1,0000020"), ("AN,2", "AN,2,1,0000020"))
    bench.clock.sleep_s(2.0)
    bench.converse(("AN,2", "AN,2,0,0000100"))
    # 50 ms after the command, every tenth sampling cycle of a clock that is fast by a thousandth.
    expected = start_s + 0.05 + 0.01 / 1.001 * np.arange(1, 101)
    assert bench.ask("AO,1").split(",")[:2] == ["AO", "1"]
    assert bench.stored("1")[1:] == pytest.approx(expected, abs=0.6e-4)
    assert bench.stored("2")[1:] == pytest.approx(-2 * expected, abs=0.6e-4)


@pytest.mark.parametrize(
    ("setting", "fault"),
    [
        ("0000100,10", "count"),
        ("2,000100,10", "parameter"),
        ("2,000100,3", "parameter"),
        ("2,0000100,03", "parameter"),
        ("2,100,03", "parameter"),
        ("3,000100,03", "parameter"),
        ("2,065537,03", "parameter"),
        ("2,000000,03", "parameter"),
    ],
)
def test_the_first_generation_refuses_a_storage_by_timing_and_other_forms_than_its_own(
    setting: str, fault: str
) -> None:
    bench = Bench("lkg3001")
    bench.ask("Q0")
    assert bench.ask(f"SW,CI,{setting}") == f"ER,CI,{CODES['lkg3001'][fault]}"


@pytest.mark.parametrize(
    ("target", "number", "stored"),
    [
        ("none-out1-out2-both", 0, (0, 0)),
        ("none-out1-out2-both", 1, (3, 0)),
        ("none-out1-out2-both", 3, (3, 3)),
        ("both-out1-out2", 0, (3, 3)),
        ("both-out1-out2", 2, (0, 3)),
        ("out1-out2-both", 0, (3, 0)),
        ("out1-out2-both", 1, (0, 3)),
        ("out1-out2-both", 2, (3, 3)),
    ],
)
def test_which_outputs_a_target_stores_is_a_matter_of_the_dialect(
    target: str, number: int, stored: tuple[int, int]
) -> None:
    bench = set_up(ramp, ramp, setting=f"SW,CI,{number},000003,00", dialect={"target": target})
    bench.clock.sleep_s(1.0)
    assert [bench.ask(f"AN,{output}") for output in (1, 2)] == [
        f"AN,{output},0,{count:07d}" for output, count in enumerate(stored, 1)
    ]


def test_outputs_may_be_set_up_by_themselves() -> None:
    bench = set_up(ramp, ramp, setting="SW,CI,2,000003,00", dialect={"target": "by-output"})
    bench.clock.sleep_s(1.0)
    bench.converse(("AN,1", "AN,1,0,0000000"), ("AN,2", "AN,2,0,0000003"))
    bench.set("SW,CI,1,000003,00")
    bench.converse(("AQ", "AQ"), ("AS", "AS"))
    bench.clock.sleep_s(1.0)
    bench.converse(("AN,1", "AN,1,0,0000003"), ("AN,2", "AN,2,0,0000003"))
    bench.ask("Q0")
    bench.converse(("SW,CI,3,000003,00", f"ER,CI,{CODES['lkg3001']['parameter']}"))


@both_generations
def test_line_feeds_and_empty_lines_are_passed_over(generation: str) -> None:
    bench = Bench(generation)
    bench.send(b"PR\r\n\r\n\rPR\r\n")
    assert bytes(bench.received) == b"PR,0\rPR,0\r"


def test_forms_of_the_replies_are_a_matter_of_the_dialect() -> None:
    plain = {"status_repeats_output": False, "values_repeat_output": False, "count_digits": 0, "cycle_digits": 2}
    bench = set_up(ramp, setting="SW,CI,0,2,03", dialect=plain, count_digits=5)
    bench.clock.sleep_s(1.0)
    bench.converse(("AN,1", "AN,0,00002"), ("AO,1", "AO,+00.0600,+00.0700"))
    bench = set_up(ramp, setting="SW,CI,2,000002,03", dialect={"status_by_output": False})
    bench.clock.sleep_s(1.0)
    bench.converse(("AN", "AN,0,0000002,0000000"), ("AN,1", "ER,AN,21"))


@pytest.mark.parametrize(("pulse_s", "shortest_s", "stored"), [(2e-6, 2e-3, 0), (2e-3, 2e-3, 26), (2e-6, 0.0, 26)])
def test_the_timing_input_does_not_see_pulses_that_are_too_short(
    pulse_s: float, shortest_s: float, stored: int
) -> None:
    bench = armed("lkg5000", ramp, timing_pulse_min_s=shortest_s)
    bench.line.pulse_s = pulse_s
    bench.line.begin(0.5, 0.02, 100)
    bench.clock.sleep_s(1.0)
    bench.converse(("AN", f"AN,1,{stored:07d},0000000"))
