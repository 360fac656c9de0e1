"""Faults: each does what it says, when it says, and again with the same seed."""

import contextlib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.transport import InProcessTransport
from rigctl.core.errors import LinkLost, LinkTimeout
from simulators.clock import VirtualClock
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.faults.when import Event, Occasion, Spell
from simulators.faults.wire import Exchange
from simulators.measured import Measured

WORDS = [b"alpha\n", b"beta\n", b"gamma\n", b"delta\n"]


class Parrot:
    """Says every line back."""

    kind = "parrot"

    def connect(self, send: Callable[[bytes], None]) -> "ParrotConnection":
        return ParrotConnection(send)

    def befall(self, event: Event) -> None:
        pass

    def relieve(self, event: Event) -> None:
        pass


class ParrotConnection:
    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.send = send
        self.hung_up = False

    def receive(self, data: bytes) -> None:
        if data == b"bye\n":
            self.hung_up = True
        self.send(data)

    def close(self) -> None:
        pass


class Line:
    """A client of a faulty parrot on a virtual clock."""

    def __init__(self, start_s: float = 0.0, **faults: object) -> None:
        self.clock = VirtualClock(start_s)
        self.faulty = FaultyInstrument(Parrot(), FaultPlan.model_validate(faults), self.clock)
        self.connect()

    def connect(self) -> None:
        self.wire = InProcessTransport("sim:parrot", self.faulty, self.clock)

    def received(self) -> bytes:
        """What has come so far, and forget it."""
        came = bytearray()
        with contextlib.suppress(LinkTimeout, LinkLost):
            while True:
                came += self.wire.read_exactly(1, 0.0)
        return bytes(came)

    def ask(self, text: bytes, timeout_s: float = 1.0) -> bytes:
        self.wire.write(text)
        return self.wire.read_until(b"\n", timeout_s)


def test_without_faults_every_reply_comes_as_it_is_and_at_once() -> None:
    line = Line()
    assert [line.ask(word) for word in WORDS] == WORDS
    assert line.clock.now_s() == 0.0
    assert line.faulty.kind == "parrot"


def test_a_late_reply_comes_after_its_delay_of_rig_time() -> None:
    line = Line(late={"nth": [2], "delay_s": 2.5})
    assert line.ask(b"alpha\n") == b"alpha\n"
    assert line.clock.now_s() == 0.0
    with pytest.raises(LinkTimeout):
        line.ask(b"beta\n", timeout_s=2.4)
    assert line.wire.read_until(b"\n", 0.2) == b"beta\n"
    assert line.clock.now_s() == 2.5


def test_replies_behind_a_late_one_keep_their_order() -> None:
    line = Line(late={"nth": [1], "delay_s": 2.0})
    for word in WORDS:
        line.wire.write(word)
    assert [line.wire.read_until(b"\n", 3.0) for _ in WORDS] == WORDS
    assert line.clock.now_s() == 2.0


def test_a_silent_reply_does_not_come_but_the_next_does() -> None:
    line = Line(silent={"nth": [1]})
    with pytest.raises(LinkTimeout, match="nothing came"):
        line.ask(b"alpha\n")
    assert line.ask(b"beta\n") == b"beta\n"


def test_a_dead_instrument_says_nothing_after_a_reply() -> None:
    line = Line(silent={"after": 2})
    assert [line.ask(word) for word in WORDS[:2]] == WORDS[:2]
    for word in WORDS:
        with pytest.raises(LinkTimeout):
            line.ask(word)


def test_a_truncated_reply_lacks_its_end() -> None:
    line = Line(truncated={"nth": [1], "keep_bytes": 3})
    with pytest.raises(LinkTimeout, match="only b'alp' came"):
        line.ask(b"alpha\n")


def test_a_duplicated_reply_comes_twice() -> None:
    line = Line(duplicated={"nth": [1]})
    assert line.ask(b"alpha\n") == b"alpha\n"
    assert line.ask(b"beta\n") == b"alpha\n"


def test_another_model_answers() -> None:
    line = Line(wrong_identity={"text": "LK-G3001", "instead": "LK-G5001"})
    assert line.ask(b"VE,LK-G3001\n") == b"VE,LK-G5001\n"
    assert line.ask(b"M1\n") == b"M1\n"


def test_a_disconnect_comes_after_the_reply_and_only_once() -> None:
    line = Line(disconnect={"nth": [2]})
    assert [line.ask(word) for word in WORDS[:2]] == WORDS[:2]
    with pytest.raises(LinkLost, match="ended the connection"):
        line.wire.write(b"gamma\n")
    with pytest.raises(LinkLost):
        line.wire.read_until(b"\n", 1.0)
    line.wire.close()
    line.connect()
    assert [line.ask(word) for word in WORDS] == WORDS


def test_a_waiting_client_of_a_late_disconnect_is_not_left_to_time_out() -> None:
    line = Line(late={"nth": [1], "delay_s": 5.0}, disconnect={"nth": [1]}, silent={"nth": [1]})
    line.wire.write(b"alpha\n")
    with pytest.raises(LinkLost):
        line.wire.read_until(b"\n", 60.0)
    assert line.clock.now_s() == 5.0


def test_an_instrument_that_hangs_up_does_so_after_its_late_reply() -> None:
    line = Line(late={"nth": [1], "delay_s": 1.0})
    assert line.ask(b"bye\n", timeout_s=2.0) == b"bye\n"
    with pytest.raises(LinkLost):
        line.wire.write(b"alpha\n")


def test_a_client_that_left_gets_no_late_reply() -> None:
    line = Line(late={"nth": [1], "delay_s": 1.0})
    sent: list[bytes] = []
    connection = line.faulty.connect(sent.append)
    connection.receive(b"alpha\n")
    connection.close()
    line.clock.sleep_s(5.0)
    assert sent == []


def struck(seed: int, **tables: object) -> list[int]:
    plan = FaultPlan.model_validate({"seed": seed, **tables})
    return [n for n in range(1, 2001) if "silent" in plan.struck(Occasion(n))]


def test_probabilities_are_met_and_the_seed_decides_which_replies() -> None:
    silent = {"probability": 0.1}
    assert struck(1, silent=silent) == struck(1, silent=silent)
    assert struck(1, silent=silent) != struck(2, silent=silent)
    assert 150 < len(struck(1, silent=silent)) < 250


def test_faults_of_one_seed_strike_independently() -> None:
    plan = FaultPlan.model_validate({"silent": {"probability": 0.5}, "late": {"probability": 0.5, "delay_s": 1.0}})
    occasions = [Occasion(n) for n in range(1, 1001)]
    both = sum(plan.struck(each) == {"silent", "late"} for each in occasions)
    assert 200 < both < 300


def test_a_time_strikes_the_first_reply_at_or_after_it() -> None:
    line = Line(silent={"at_s": [2.0, 3.5]})
    heard = []
    for at_s in (1.0, 2.0, 2.5, 5.0, 6.0):
        line.clock.sleep_s(at_s - line.clock.now_s())
        line.wire.write(b"alpha\n")
        heard.append(bool(line.received()))
    assert heard == [True, False, True, False, True]


def test_a_time_before_the_instrument_was_there_has_passed() -> None:
    line = Line(start_s=100.0, silent={"at_s": 50.0})
    assert line.ask(b"alpha\n") == b"alpha\n"


def test_a_stretch_of_time_strikes_all_within_and_confines_the_rest() -> None:
    line = Line(silent={"between_s": [1.0, 3.0]}, duplicated={"between_s": [4.0, 9.0], "nth": [2, 5]})
    heard = []
    for at_s in (0.5, 1.0, 2.9, 3.0, 4.5):
        line.clock.sleep_s(at_s - line.clock.now_s())
        line.wire.write(b"alpha\n")
        heard.append(len(line.received()) // 6)
    assert heard == [1, 0, 0, 1, 2]


SPOILT: list[tuple[str, dict[str, object], bytes, bytes]] = [
    ("duplicated", {}, b"beta\n", b"beta\nbeta\n"),
    ("truncated", {}, b"beta\n", b"be"),
    ("truncated", {"keep_bytes": 1}, b"beta\n", b"b"),
    ("silent", {}, b"beta\n", b""),
    ("previous", {}, b"beta\n", b"alpha\nbeta\n"),
    ("previous", {"instead": True}, b"beta\n", b"alpha\n"),
    ("echo", {}, b"beta\n", b"beta\nbeta\n"),
    ("wrong_terminator", {}, b"beta\n", b"beta\r"),
    ("wrong_terminator", {}, b"beta\r\n", b"beta\n\r"),
    ("wrong_terminator", {}, b"beta\r", b"beta\n"),
    ("wrong_terminator", {}, b"0,12,EndOfAPI", b"0,12,EndOfAP"),
]


@pytest.mark.parametrize(("key", "details", "said", "heard"), SPOILT)
def test_a_reply_is_spoilt_as_its_name_says(key: str, details: dict[str, object], said: bytes, heard: bytes) -> None:
    line = Line(**{key: {"nth": [2], **details}})
    assert line.ask(b"alpha\n") == b"alpha\n"
    line.wire.write(said)
    assert line.received() == heard
    line.wire.write(said)
    assert line.received() == said


def test_a_connection_may_end_before_the_reply() -> None:
    line = Line(disconnect={"nth": [2], "before": True})
    assert line.ask(b"alpha\n") == b"alpha\n"
    line.wire.write(b"beta\n")
    with pytest.raises(LinkLost):
        line.wire.read_until(b"\n", 1.0)
    assert line.received() == b""


def test_refused_attempts_are_counted_and_hung_up_on() -> None:
    line = Line(refused={"nth": [2, 3]})
    assert line.ask(b"alpha\n") == b"alpha\n"
    for _ in range(2):
        line.connect()
        with pytest.raises(LinkLost):
            line.wire.write(b"alpha\n")
    line.connect()
    assert line.ask(b"alpha\n") == b"alpha\n"


def test_nobody_listens_for_a_time() -> None:
    line = Line(refused={"between_s": [1.0, 2.0]})
    there = []
    for at_s in (0.9, 1.0, 1.9, 2.0):
        line.clock.sleep_s(at_s - line.clock.now_s())
        there.append(line.faulty.listening)
    assert there == [True, False, False, True]


def sent(plan: FaultPlan, number: int, reply: bytes) -> tuple[bytes, ...]:
    return plan.copies(plan.struck(Occasion(number)), Exchange(number, reply))


BINARY = b"#216" + bytes(range(16)) + b"\n"


@given(reply=st.sampled_from([b"+1.25000000E+00\n", b"0,12.5,EndOfAPI", BINARY]), seed=st.integers(0, 200))
def test_garbage_and_strays_can_be_told_from_a_reply_and_come_again(reply: bytes, seed: int) -> None:
    for key in ("garbage", "non_ascii"):
        plan = FaultPlan.model_validate({"seed": seed, key: {"nth": [1]}})
        (spoilt,) = sent(plan, 1, reply)
        assert sent(plan, 1, reply) == (spoilt,)
        assert sent(plan, 2, reply) == (reply,)
        if key == "garbage":
            assert len(spoilt) == len(reply)
            assert not set(spoilt.rstrip(b"\n").removesuffix(b",EndOfAPI")) & set(b"0123456789+-.,#EeinfINFnaNA")
        elif reply == BINARY:
            assert spoilt[1:] == reply
            assert spoilt[0] > 0x7F
        else:
            assert len(spoilt) == len(reply) + 1
            assert not spoilt.isascii()


@given(reply=st.binary(min_size=1, max_size=50), flips=st.integers(1, 60), seed=st.integers(0, 5))
def test_exactly_so_many_bits_are_turned(reply: bytes, flips: int, seed: int) -> None:
    plan = FaultPlan.model_validate({"seed": seed, "bits": {"nth": [1], "flips": flips}})
    (flipped,) = sent(plan, 1, reply)
    assert len(flipped) == len(reply)
    turned = sum((a ^ b).bit_count() for a, b in zip(flipped, reply, strict=True))
    assert turned == min(flips, 8 * len(reply))
    assert sent(plan, 1, reply) == (flipped,)


def test_a_command_that_is_lost_is_not_heard_and_those_after_it_are() -> None:
    line = Line(command_lost={"nth": [2]})
    for word in WORDS:
        line.wire.write(word)
    assert line.received() == b"".join((WORDS[0], *WORDS[2:]))


def test_a_command_with_turned_bits_is_heard_as_another_and_the_same_one_again() -> None:
    heard = []
    for _ in range(2):
        line = Line(seed=4, command_bits={"nth": [1, 3], "flips": 2})
        for word in WORDS:
            line.wire.write(word)
        heard.append(line.received())
    first, second = heard
    assert first == second
    assert len(first) == len(b"".join(WORDS))
    assert sum((a ^ b).bit_count() for a, b in zip(first, b"".join(WORDS), strict=True)) == 4


@pytest.mark.parametrize(
    ("faults", "complaint"),
    [
        ({"late": {"delay_s": 1.0}}, "say when"),
        ({"late": {"nth": [1]}}, "delay_s"),
        ({"late": {"nth": [1], "delay_s": 0.0}}, "greater than 0"),
        ({"silent": {"nth": [0]}}, "greater than or equal to 1"),
        ({"silent": {"probability": 1.5}}, "less than or equal to 1"),
        ({"noisy": {"nth": [1]}}, "noisy"),
        ({"silent": {"when": 3}}, "when"),
        ({"silent": {"between_s": [3.0, 3.0]}}, "begin and the end"),
        ({"power_cycle": {"lasting_s": 3.0}}, "say when"),
        ({"power_cycle": {"at_s": -1.0}}, "greater than or equal to 0"),
        ({"missing_edges": {"at_s": 1.0, "share": 0.0}}, "greater than 0"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(faults: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        FaultPlan.model_validate(faults)


@given(per_hour=st.floats(0.05, 20.0), seed=st.integers(0, 50), lasting_s=st.floats(0.1, 5000.0))
def test_random_events_are_the_same_however_they_are_asked_for(per_hour: float, seed: int, lasting_s: float) -> None:
    spell = Spell(per_hour=per_hour, lasting_s=lasting_s)
    whole = spell.within(seed, 10_000.0, 30_000.0)
    parts = [each for from_s in range(10_000, 30_000, 2_500) for each in spell.within(seed, from_s, from_s + 2_500)]
    assert {each.begin_s for each in whole} == {each.begin_s for each in parts}
    begun = [each for each in spell.within(seed, 0.0, 30_000.0) if each.end_s >= 10_000.0]
    assert whole == begun
    inside = [each.begin_s for each in whole if each.begin_s > 10_000.0]
    after_s, found = 10_000.0, []
    while (coming := spell.next(seed, after_s)) is not None and coming.begin_s <= 30_000.0:
        found.append(coming.begin_s)
        after_s = coming.begin_s
    assert found == inside


def test_random_events_come_as_often_as_said() -> None:
    counted = len(Event(per_hour=2.0).within(3, 0.0, 500 * 3600.0))
    assert abs(counted - 1000) < 4 * 1000**0.5
    assert Event(at_s=5.0).next(0, 5.0) is None


def test_an_instrument_without_power_is_silent_on_a_line_and_gone_from_a_network() -> None:
    plan = FaultPlan.model_validate({"power_cycle": {"at_s": [2.0], "lasting_s": 3.0}})
    for serial in (True, False):
        clock = VirtualClock()
        faulty = FaultyInstrument(Parrot(), plan, clock, serial=serial)
        wire = InProcessTransport("sim:parrot", faulty, clock)
        clock.sleep_s(2.5)
        assert faulty.listening is serial
        if serial:
            wire.write(b"alpha\n")
            with pytest.raises(LinkTimeout):
                wire.read_until(b"\n", 1.0)
        else:
            with pytest.raises(LinkLost):
                wire.write(b"alpha\n")
        clock.sleep_s(5.0)
        assert faulty.listening
        if not serial:
            wire = InProcessTransport("sim:parrot", faulty, clock)
        wire.write(b"beta\n")
        assert wire.read_until(b"\n", 1.0) == b"beta\n"


def test_what_lasts_is_still_on_for_an_instrument_made_in_its_midst() -> None:
    plan = FaultPlan.model_validate({"power_cycle": {"at_s": 2.0, "lasting_s": 30.0}})
    clock = VirtualClock(10.0)
    faulty = FaultyInstrument(Parrot(), plan, clock)
    assert not faulty.listening
    clock.sleep_s(22.5)
    assert faulty.listening


def test_who_listens_hears_which_faults_struck() -> None:
    clock = VirtualClock()
    measured = Measured()
    kept = measured.keep()
    plan = FaultPlan.model_validate(
        {
            "late": {"nth": [2], "delay_s": 0.5},
            "silent": {"at_s": 4.0},
            "refused": {"nth": [2]},
            "limit_hit": {"at_s": 6.0},
        }
    )
    faulty = FaultyInstrument(Parrot(), plan, clock, tap=measured.tap("parrot"))
    connection = faulty.connect(lambda _: None)
    for at_s in (1.0, 2.0, 3.0, 5.0, 7.0):
        clock.sleep_s(at_s - clock.now_s())
        connection.receive(b"alpha\n")
    faulty.connect(lambda _: None)
    told = [(each.channel, each.at_s[0], each.values[0]) for each in kept]
    assert told == [
        ("fault late", 2.0, 2),
        ("fault silent", 5.0, 4),
        ("fault limit_hit", 6.0, 0),
        ("fault refused", 7.0, 2),
    ]
