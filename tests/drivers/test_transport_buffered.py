"""Reading from a buffer that fills in pieces, whatever the pieces."""

import itertools
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.buffered import REPLY_BYTES_MAX, BufferedTransport
from rigctl.core.clock import RealClock
from rigctl.core.errors import LinkError, LinkTimeout


class Pieces(BufferedTransport):
    """Delivers the given pieces, one for each look at the wire, then nothing more."""

    def __init__(self, pieces: list[bytes]) -> None:
        super().__init__("test:", RealClock(), floor_s=0.0)
        self.pieces = pieces
        self.looks = 0

    def write(self, data: bytes) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError

    def _receive(self, wait_s: float) -> bytes:
        self.looks += 1
        return self.pieces.pop(0) if self.pieces else b""


def cut(stream: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted({place % (len(stream) + 1) for place in places}), len(stream)]
    return [stream[a:b] for a, b in itertools.pairwise(edges) if a < b]


@given(
    lines=st.lists(st.binary(max_size=12), min_size=1, max_size=6),
    terminator=st.sampled_from([b"\n", b"\r\n", b",EndOfAPI", b"aab"]),
    places=st.lists(st.integers(0, 200), max_size=20),
)
def test_lines_do_not_depend_on_how_they_were_cut(lines: list[bytes], terminator: bytes, places: list[int]) -> None:
    stream = b"".join(line + terminator for line in lines)
    wire = Pieces(cut(stream, places))
    expected = [part + terminator for part in stream.split(terminator)[:-1]]
    assert [wire.read_until(terminator, 0.0) for _ in expected] == expected
    with pytest.raises(LinkTimeout):
        wire.read_until(terminator, 0.0)


@given(stream=st.binary(min_size=1, max_size=50), places=st.lists(st.integers(0, 50)), count=st.integers(0, 60))
def test_exact_reads_do_not_depend_on_how_the_bytes_were_cut(stream: bytes, places: list[int], count: int) -> None:
    wire = Pieces(cut(stream, places))
    if count > len(stream):
        with pytest.raises(LinkTimeout, match=f"{count} bytes"):
            wire.read_exactly(count, 0.0)
        count = len(stream)
    assert wire.read_exactly(count, 0.0) == stream[:count]


def test_what_is_there_already_needs_no_look_at_the_wire() -> None:
    wire = Pieces([b"one\ntwo\nthree"])
    assert wire.read_until(b"\n", 0.0) == b"one\n"
    assert wire.read_until(b"\n", 0.0) == b"two\n"
    assert wire.read_exactly(5, 0.0) == b"three"
    assert wire.looks == 1


def test_discarding_forgets_what_was_read_and_what_waits_on_the_wire() -> None:
    wire = Pieces([b"one\ntwo", b"thr", b"ee\n"])
    wire.read_until(b"\n", 0.0)
    wire.unread()
    wire.pieces.append(b"four\n")
    assert wire.read_until(b"\n", 0.0) == b"four\n"


def test_a_time_out_shows_and_keeps_what_came() -> None:
    wire = Pieces([b"half a rep"])
    with pytest.raises(LinkTimeout, match=r"test:: waited 0 s for b'\\n', only b'half a rep' came"):
        wire.read_until(b"\n", 0.0)
    wire.pieces = [b"ly\n"]
    assert wire.read_until(b"\n", 0.0) == b"half a reply\n"


class Torrent(Pieces):
    """Sends without end, for a test up to twice what is borne."""

    def __init__(self) -> None:
        super().__init__([bytes(1 << 20)] * (2 * REPLY_BYTES_MAX >> 20))


@pytest.mark.parametrize(
    "look",
    [
        lambda wire: wire.unread(),
        lambda wire: wire.read_until(b"\n", 0.0),
        lambda wire: wire.read_exactly(1 << 25, 0.0),
    ],
)
def test_what_sends_without_end_is_given_up(look: Callable[[BufferedTransport], bytes]) -> None:
    wire = Torrent()
    with pytest.raises(LinkError, match=r"^test:: 16777216 bytes came and no .*; is it another instrument\?$"):
        look(wire)
    assert wire.looks == (REPLY_BYTES_MAX >> 20) + 1
    # None of it is anybody's reply, and none is kept.
    wire.pieces = [b"reply\n"]
    assert wire.read_until(b"\n", 0.0) == b"reply\n"
