"""Faults: each does what it says, when it says, and again with the same seed."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.transport import InProcessTransport
from rigctl.errors import LinkLost, LinkTimeout
from simulators.clock import VirtualClock
from simulators.faults import FaultPlan, FaultyInstrument

WORDS = [b"alpha\n", b"beta\n", b"gamma\n", b"delta\n"]


class Parrot:
    """Says every line back."""

    kind = "parrot"

    def connect(self, send: Callable[[bytes], None]) -> "ParrotConnection":
        return ParrotConnection(send)


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

    def __init__(self, **faults: object) -> None:
        self.clock = VirtualClock()
        self.faulty = FaultyInstrument(Parrot(), FaultPlan.model_validate(faults), self.clock)
        self.connect()

    def connect(self) -> None:
        self.wire = InProcessTransport("sim:parrot", self.faulty, self.clock)

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


def test_probabilities_are_met_and_the_seed_decides_which_replies() -> None:
    def struck(seed: int) -> list[int]:
        plan = FaultPlan.model_validate({"seed": seed, "silent": {"probability": 0.1}})
        return [n for n in range(1, 2001) if not plan.copies(n, b"x")]

    assert struck(1) == struck(1)
    assert struck(1) != struck(2)
    assert 150 < len(struck(1)) < 250


def test_faults_of_one_seed_strike_independently() -> None:
    plan = FaultPlan.model_validate({"silent": {"probability": 0.5}, "late": {"probability": 0.5, "delay_s": 1.0}})
    both = sum(not plan.copies(n, b"x") and plan.delay_s(n) > 0.0 for n in range(1, 1001))
    assert 200 < both < 300


@given(reply=st.binary(min_size=1, max_size=50), flips=st.integers(1, 60), seed=st.integers(0, 5))
def test_garbling_changes_exactly_so_many_bytes_and_repeats_itself(reply: bytes, flips: int, seed: int) -> None:
    plan = FaultPlan.model_validate({"seed": seed, "garbled": {"nth": [1], "flipped_bytes": flips}})
    (garbled,) = plan.copies(1, reply)
    assert len(garbled) == len(reply)
    assert sum(a != b for a, b in zip(garbled, reply, strict=True)) == min(flips, len(reply))
    assert plan.copies(1, reply) == (garbled,)
    assert plan.copies(2, reply) == (reply,)


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
    ],
)
def test_a_plan_that_cannot_be_is_refused(faults: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        FaultPlan.model_validate(faults)
