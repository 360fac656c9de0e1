"""What goes wrong on the wire: replies and commands spoilt one by one, connections refused or ended.

What an instrument sends in one call counts as one reply, what comes from its client at once as one command; each are
counted from 1 over all connections, so that a driver that reconnects does not meet the same fault again.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from simulators.faults.when import Fault, Occasion, Table
from simulators.keyed_random import generator

# The longer before the shorter: what ends with CR LF ends with LF too.
TERMINATORS = {b",EndOfAPI": b",EndOfAP", b"\r\n": b"\n\r", b"\n": b"\r", b"\r": b"\n"}
"""How replies end, each with an end that is wrong."""
GIBBERISH = b"?~^|{}@`"
"""No digit, no letter, no comma: nothing that an instrument could have meant."""
STRAY = (0x80, 0x100)
"""Bytes that no ASCII reply contains."""


class Late(Fault):
    """The reply comes `delay_s` of rig time later; those behind it wait."""

    delay_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Bits(Fault):
    """Single bits of the reply are turned: a noisy serial line. TCP has a checksum of its own."""

    flips: Annotated[int, Field(ge=1)] = 1


class CommandBits(Bits):
    """Single bits of a command are turned on its way to the instrument, which does what it has understood."""


class CommandLost(Fault):
    """A command does not come to the instrument."""


class Truncated(Fault):
    """Only the first bytes of the reply come."""

    keep_bytes: Annotated[int, Field(ge=0)] | None = None
    """None: half of them."""


class Silent(Fault):
    """The reply does not come."""


class Duplicated(Fault):
    """The reply comes twice."""


class Previous(Fault):
    """The reply before is sent again, ahead of the reply or in its place."""

    instead: bool = False


class Garbage(Fault):
    """Gibberish comes instead, of the same length and with the same end."""


class NonAscii(Fault):
    """Stray bytes above 127 in the reply; ahead of a binary one, which may contain such bytes itself."""

    stray_bytes: Annotated[int, Field(ge=1)] = 1


class Echo(Fault):
    """What was sent last comes back ahead of the reply."""


class WrongTerminator(Fault):
    """The reply ends as those of another instrument do."""


class Disconnect(Fault):
    """The connection ends, after the reply or before it."""

    before: bool = False


class Refused(Fault):
    """Connections are not accepted; counts attempts to connect, not replies.

    With `between_s` alone nobody listens at the port meanwhile; else the connection is ended as soon as it is made.
    """

    @property
    def closes_the_port(self) -> bool:
        """True when nobody listens."""
        return not self.model_fields_set & {"nth", "after", "probability", "at_s"}


class WrongIdentity(Table):
    """Wherever `text` stands in a reply, `instead` is sent: another model answers."""

    text: Annotated[str, Field(min_length=1)]
    instead: str


@dataclass(frozen=True)
class Exchange:
    """A reply with what went before it on the same connection."""

    number: int
    reply: bytes
    command: bytes = b""
    previous: bytes = b""


class WireFaults(Table):
    """What goes wrong on the wire, and when; one table and one seed always give the same faults."""

    seed: int = 0
    late: Late | None = None
    bits: Bits | None = None
    command_bits: CommandBits | None = None
    command_lost: CommandLost | None = None
    truncated: Truncated | None = None
    silent: Silent | None = None
    duplicated: Duplicated | None = None
    previous: Previous | None = None
    garbage: Garbage | None = None
    non_ascii: NonAscii | None = None
    echo: Echo | None = None
    wrong_terminator: WrongTerminator | None = None
    disconnect: Disconnect | None = None
    refused: Refused | None = None
    wrong_identity: WrongIdentity | None = None

    def struck(self, occasion: Occasion) -> frozenset[str]:
        """Which faults strike a reply."""
        return frozenset(name for name in REPLY_FAULTS if self._strikes(getattr(self, name), occasion))

    def struck_command(self, occasion: Occasion) -> frozenset[str]:
        """Which faults strike a command."""
        return frozenset(name for name in COMMAND_FAULTS if self._strikes(getattr(self, name), occasion))

    def heard(self, struck: Container[str], number: int, command: bytes) -> bytes:
        """What the instrument hears of a command; empty where it is lost."""
        if "command_lost" in struck:
            return b""
        if "command_bits" in struck and self.command_bits is not None:
            return self._flipped("command flip", number, command, self.command_bits.flips)
        return command

    def refuses(self, attempt: Occasion) -> bool:
        """True when an attempt to connect is refused."""
        return self._strikes(self.refused, attempt)

    def listens(self, now_s: float) -> bool:
        """False while nobody listens at the port."""
        closed = self.refused is not None and self.refused.closes_the_port
        return not (closed and self.refuses(Occasion(0, now_s)))

    def delay_s(self, struck: Container[str]) -> float:
        """How much later a reply comes [rig s]."""
        return self.late.delay_s if self.late is not None and "late" in struck else 0.0

    def ends_before(self, struck: Container[str]) -> bool:
        """True when the connection ends before a reply."""
        return "disconnect" in struck and self.disconnect is not None and self.disconnect.before

    def ends_after(self, struck: Container[str]) -> bool:
        """True when the connection ends after a reply."""
        return "disconnect" in struck and not self.ends_before(struck)

    def copies(self, struck: Container[str], exchange: Exchange) -> tuple[bytes, ...]:
        """What is sent in place of a reply, piece by piece: nothing, itself, or spoilt, with more around it."""
        if "silent" in struck:
            return ()
        # In this order: what is spoilt, how often it comes, what goes before it.
        sent = [self._spoilt(struck, exchange.number, exchange.reply)]
        if "duplicated" in struck:
            sent *= 2
        if "previous" in struck and self.previous is not None and exchange.previous:
            sent = [exchange.previous] if self.previous.instead else [exchange.previous, *sent]
        if "echo" in struck and exchange.command:
            sent = [exchange.command, *sent]
        return tuple(sent)

    def _strikes(self, fault: Fault | None, occasion: Occasion) -> bool:
        return fault is not None and fault.strikes(self.seed, occasion)

    def _spoilt(self, struck: Container[str], number: int, reply: bytes) -> bytes:
        if self.wrong_identity is not None:
            # Before the reply is spoilt: the model answers so, the wire comes after.
            reply = reply.replace(self.wrong_identity.text.encode(), self.wrong_identity.instead.encode())
        if "garbage" in struck:
            reply = self._gibberish(number, reply)
        if "non_ascii" in struck and self.non_ascii is not None:
            reply = self._with_strays(number, reply, self.non_ascii.stray_bytes)
        if "bits" in struck and self.bits is not None:
            reply = self._flipped("flip", number, reply, self.bits.flips)
        if "wrong_terminator" in struck:
            body, end = parted(reply)
            reply = body + TERMINATORS.get(end, b"")
        if "truncated" in struck and self.truncated is not None:
            kept = self.truncated.keep_bytes
            reply = reply[: len(reply) // 2 if kept is None else kept]
        return reply

    def _gibberish(self, number: int, reply: bytes) -> bytes:
        body, end = parted(reply)
        chosen = generator(self.seed, "gibberish", number).integers(0, len(GIBBERISH), len(body))
        return bytes(GIBBERISH[each] for each in chosen) + end

    def _with_strays(self, number: int, reply: bytes, count: int) -> bytes:
        random = generator(self.seed, "stray", number)
        strays = bytes(int(each) for each in random.integers(*STRAY, count))
        body, _ = parted(reply)
        # A block is counted by its header: strays within would be part of its numbers.
        binary = reply.startswith(b"#") or not reply.isascii()
        place = 0 if binary else int(random.integers(0, len(body) + 1))
        return reply[:place] + strays + reply[place:]

    def _flipped(self, name: str, number: int, message: bytes, count: int) -> bytes:
        random = generator(self.seed, name, number)
        flipped = bytearray(message)
        for place in random.choice(8 * len(message), size=min(count, 8 * len(message)), replace=False):
            flipped[place // 8] ^= 1 << (place % 8)
        return bytes(flipped)


COMMAND_FAULTS = ("command_bits", "command_lost")
"""What strikes some commands and not others."""
REPLY_FAULTS = tuple(
    name for name in WireFaults.model_fields if name not in ("seed", "refused", "wrong_identity", *COMMAND_FAULTS)
)
"""What strikes some replies and not others."""


def parted(reply: bytes) -> tuple[bytes, bytes]:
    """A reply without its terminator, and that."""
    for end in TERMINATORS:
        if reply.endswith(end):
            return reply[: -len(end)], end
    return reply, b""
