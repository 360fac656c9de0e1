"""The SCPI grammar and the shell around a simulated device."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.clock import VirtualClock
from simulators.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Number,
    Pending,
    Register,
    ScpiError,
    ScpiShell,
    Text,
    header_regex,
    parse,
    setting,
)

RANGE_HEADER = header_regex("[SENSe:]VOLTage[:DC]:RANGe:AUTO?")


class Device:
    """A shell with a value, a node with two leaves, and an operation that ends when `done`."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.value = 1.0
        self.done = True
        self.sent = bytearray()
        volts = Number(0.0, lambda: 10.0, 5.0, unit="V")
        self.shell = ScpiShell(
            self.clock,
            (
                *setting("SOURce<n>:LEVel", Number(0, 9, 1), lambda: 0.0, self.put_level),
                *setting("OUTPut:VOLTage", volts, lambda: self.value, self.put),
                Command("OUTPut:MARK?", lambda: "marked"),
                Command("SLOW?", lambda: Pending(lambda: self.done, lambda: "slow", lambda: math.inf)),
                Command("LATE?", lambda: self.ready_at(self.clock.now_s() + 2.0)),
                Command("FAIL", self.fail),
            ),
            busy=lambda: not self.done,
            idle_s=lambda: math.inf,
            questionable=Register(),
            operation=Register(),
        )
        self.session = self.shell.connect(self.sent.extend)

    def put(self, value: float) -> None:
        self.value = value

    def put_level(self, *levels: float) -> None:
        self.value = levels[-1]

    def fail(self) -> None:
        raise ScpiError(-221)

    def ready_at(self, at_s: float) -> Pending:
        return Pending(lambda: self.clock.now_s() >= at_s, lambda: "late", lambda: at_s)

    def ask(self, message: str) -> str:
        self.sent.clear()
        self.session.receive(message.encode("latin-1") + b"\n")
        return self.sent.decode()


@pytest.mark.parametrize(
    "header",
    ["VOLT:RANG:AUTO?", "VOLTAGE:DC:RANGE:AUTO?", "SENS:VOLT:RANGE:AUTO?", "SENSE:VOLTAGE:DC:RANG:AUTO?"],
)
def test_a_header_may_be_long_or_short_with_optional_nodes_left_out(header: str) -> None:
    assert RANGE_HEADER.fullmatch(header)


@pytest.mark.parametrize("header", ["VOLTA:RANG:AUTO?", "VOL:RANG:AUTO?", "VOLT:AC:RANG:AUTO?", "VOLT:RANG:AUTO"])
def test_nothing_between_short_and_long_is_a_mnemonic(header: str) -> None:
    assert not RANGE_HEADER.fullmatch(header)


@given(st.text("ABCDEFGH", min_size=1, max_size=5), st.text("abcdefgh", max_size=5), st.data())
def test_of_all_abbreviations_only_two_match(short: str, rest: str, data: st.DataObject) -> None:
    word = short + rest.upper()
    length = data.draw(st.integers(0, len(word)))
    accepted = header_regex(short + rest).fullmatch(word[:length]) is not None
    assert accepted == (length in (len(short), len(word)))


def test_a_numeric_suffix_is_one_unless_given() -> None:
    regex = header_regex("SOURce<n>:LEVel")
    suffixes = [regex.fullmatch(h) for h in ("SOUR:LEV", "SOURCE2:LEV", "SOUR12:LEVEL")]
    assert [m and m[1] for m in suffixes] == ["", "2", "12"]


@pytest.mark.parametrize(
    ("unit", "header", "parameters"),
    [
        ("*idn?", "*IDN?", ()),
        (" conf:volt:dc  10 , 0.001 ", "CONF:VOLT:DC", ("10", "0.001")),
        (":DISP:TEXT 'a, b; c'", ":DISP:TEXT", ("'a, b; c'",)),
        ("R?\t500", "R?", ("500",)),
    ],
)
def test_a_unit_is_a_header_and_parameters(unit: str, header: str, parameters: tuple[str, ...]) -> None:
    parsed = parse(unit)
    assert (parsed.header, parsed.parameters) == (header, parameters)


@pytest.mark.parametrize(
    ("unit", "code"),
    [("?", -102), ("1VOLT", -102), ("CONF,1", -103), ("CONF 1,,2", -109), ("TEXT 'a", -151), ("A:B:", -103)],
)
def test_what_is_no_unit_has_its_error(unit: str, code: int) -> None:
    with pytest.raises(ScpiError) as caught:
        parse(unit)
    assert caught.value.code == code


@given(st.floats(-1e30, 1e30))
def test_a_number_survives_the_wire_to_nine_digits(value: float) -> None:
    number = Number(-1e31, 1e31, 0.0)
    assert number.parse(number.format(value)) == pytest.approx(value, rel=1e-8)


@pytest.mark.parametrize(
    ("text", "value"),
    [("20E-6", 20e-6), ("20 us", 20e-6), ("1.5MS", 1.5e-3), (".5S", 0.5), ("min", 1e-6), ("DEFAULT", 0.1)],
)
def test_a_number_takes_units_and_words(text: str, value: float) -> None:
    assert Number(1e-6, 2.0, 0.1, unit="S").parse(text) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "code"),
    [("3", -222), ("1 V", -131), ("1 X", -131), ("ABC", -148), ("'1'", -104), ("1..2", -104), ("M", -148)],
)
def test_a_bad_number_has_its_error(text: str, code: int) -> None:
    with pytest.raises(ScpiError) as caught:
        Number(0.0, 2.0, 0.0, unit="S").parse(text)
    assert caught.value.code == code


def test_other_parameters_have_their_errors() -> None:
    cases = [(Choice(("IMMediate", "TIMer")), "IMMED", -224), (Choice(("A",)), "1", -104), (Boolean(), "MAYBE", -224)]
    for kind, text, code in [*cases, (Text(), "bare", -104)]:
        with pytest.raises(ScpiError) as caught:
            kind.parse(text)
        assert caught.value.code == code


def test_choices_booleans_texts_and_counts_are_read() -> None:
    assert Choice(("IMMediate", "TIMer")).parse("timer") == "TIM"
    assert [Boolean().parse(t) for t in ("on", "OFF", "1", "0", "1E999")] == [True, False, True, False, True]
    assert Text().parse('"say ""so"""') == 'say "so"'
    assert Text().format('say "so"') == '"say ""so"""'
    assert Integer(1, 10, 1, infinity=True).parse("INF") == math.inf
    assert Integer(1, 10, 1).parse("2.6") == 3


def test_a_header_after_a_semicolon_goes_on_where_the_last_one_was() -> None:
    device = Device()
    assert device.ask("OUTP:VOLT 3;VOLT?;*WAI;MARK?;:OUTPUT:VOLT?") == "+3.00000000E+00;marked;+3.00000000E+00\n"
    assert device.ask("OUTP:VOLT 4;OUTP:VOLT?") == ""
    assert device.ask("SYST:ERR?") == '-113,"Undefined header"\n'


def test_limits_can_be_asked_for() -> None:
    device = Device()
    replies = device.ask("OUTP:VOLT? MIN;VOLT? MAX;VOLT? DEF;VOLT?")
    assert replies == "+0.00000000E+00;+1.00000000E+01;+5.00000000E+00;+1.00000000E+00\n"


def test_too_many_or_too_few_parameters_are_errors() -> None:
    device = Device()
    device.ask("OUTP:VOLT")
    device.ask("OUTP:VOLT 1,2")
    device.ask("*CLS 1")
    codes = [device.ask("SYST:ERR?").split(",")[0] for _ in range(4)]
    assert codes == ["-109", "-108", "-108", "+0"]


def test_a_command_error_ends_the_message_and_an_execution_error_does_not() -> None:
    device = Device()
    assert device.ask("OUTP:MARK?;NONSENSE;MARK?") == "marked\n"
    assert device.ask("OUTP:MARK?;:FAIL;:OUTP:MARK?") == "marked;marked\n"


def test_the_error_queue_is_first_in_first_out_and_overflows_at_its_end() -> None:
    device = Device()
    device.ask("FAIL")
    for _ in range(30):
        device.ask("NONSENSE")
    codes = [device.ask("SYST:ERR?").split(",")[0] for _ in range(21)]
    assert codes == ["-221", *["-113"] * 18, "-350", "+0"]


def test_registers_latch_until_read() -> None:
    device = Device()
    assert device.ask("*ESR?") == "+128\n"
    device.ask("FAIL;*ESE 16;*SRE 32")
    device.ask("NONSENSE")
    assert device.ask("*STB?") == f"{4 + 32 + 64:+d}\n"
    assert device.ask("*ESR?;*ESR?") == "+48;+0\n"
    device.shell.questionable.event |= 1 << 14
    assert device.ask("*CLS;*STB?;:STAT:QUES?") == "+0;+0\n"
    device.shell.questionable.event |= 1 << 14
    assert device.ask("STAT:QUES:ENAB 16384;*STB?") == "+8\n"
    assert device.ask("STAT:QUES?;QUES:EVEN?;*STB?") == "+16384;+0;+0\n"


def test_a_slow_query_blocks_its_client_only() -> None:
    device = Device()
    device.done = False
    other = bytearray()
    neighbour = device.shell.connect(other.extend)
    assert device.ask("SLOW?;:OUTP:MARK?") == ""
    neighbour.receive(b"OUTP:MARK?\n")
    assert other == b"marked\n"
    device.done = True
    neighbour.receive(b"*CLS\n")
    assert device.sent == b"slow;marked\n"


def test_a_reply_that_comes_with_time_needs_nobody_to_ask_again() -> None:
    device = Device()
    device.ask("LATE?")
    device.clock.sleep_s(1.9)
    assert device.sent == b""
    device.clock.sleep_s(0.2)
    assert device.sent == b"late\n"


def test_a_message_while_a_query_waits_interrupts_it() -> None:
    device = Device()
    device.done = False
    assert device.ask("SLOW?") == ""
    assert device.ask("OUTP:MARK?") == "marked\n"
    assert device.ask("SYST:ERR?") == '-410,"Query INTERRUPTED"\n'
    device.done = True
    device.shell.resume()
    assert b"slow" not in device.sent


def test_wai_holds_later_messages_back() -> None:
    device = Device()
    device.done = False
    assert device.ask("*WAI") == ""
    assert device.ask("OUTP:MARK?") == ""
    device.done = True
    device.shell.resume()
    assert device.sent == b"marked\n"
    assert device.ask("SYST:ERR?") == '+0,"No error"\n'


def test_opc_sets_its_bit_when_the_operation_is_over() -> None:
    device = Device()
    device.done = False
    assert device.ask("*CLS;*OPC;*ESR?") == "+0\n"
    device.done = True
    assert device.ask("*ESR?;*OPC?") == "+1;1\n"


def test_a_client_that_left_gets_nothing() -> None:
    device = Device()
    device.done = False
    device.ask("SLOW?")
    device.session.close()
    device.session.close()
    device.done = True
    device.shell.resume()
    assert device.sent == b""


def test_messages_may_come_in_pieces_and_together() -> None:
    device = Device()
    for piece in (b"OUTP:MA", b"RK?\r", b"\nOUTP:MARK?\nOUTP:VOLT?"):
        device.session.receive(piece)
    assert device.sent == b"marked\nmarked\n"
    device.session.receive(b"\n")
    assert device.sent.endswith(b"+1.00000000E+00\n")


@given(st.lists(st.binary(max_size=40) | st.text("OUTPVL:;,*?'\" 19.E+-\n", max_size=40).map(str.encode), max_size=8))
def test_no_bytes_crash_the_shell(pieces: list[bytes]) -> None:
    device = Device()
    for piece in pieces:
        device.session.receive(piece)
    device.session.receive(b"\n")
    assert device.ask("*CLS;:OUTP:MARK?") == "marked\n"
