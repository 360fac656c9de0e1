"""Messages of Zaber's ASCII protocol as the driver writes and reads them.

Sources: Zaber, "ASCII Protocol Manual" (zaber.com/wiki/Manuals/ASCII_Protocol_Manual) and "Zaber's ASCII Protocol"
(zaber.com/articles/ascii-protocol). A command is `/device axis id words:XX`, ended by LF; the reply has the same
numbers: `@01 1 07 OK IDLE -- 0:XX`, ended by CR LF. To confirm at a device: message numbers on every firmware; the
reply's own sum once `comm.checksum` is 1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

END = b"\r\n"
_REPLY = re.compile(
    r"@(\d\d) (\d) (\d\d) (OK|RJ) (BUSY|IDLE) (--|[A-Z][A-Z0-9]) ([ -9;-~]{1,120})(?::([0-9A-F]{2}))?", re.ASCII
)


@dataclass(frozen=True)
class Reply:
    """One reply: which question's, whether it was accepted, whether the axis moves, its worst flag, its data."""

    number: int
    accepted: bool
    busy: bool
    flag: str
    data: str


def checksum(text: str) -> str:
    """What makes the sum of all bytes behind the first character zero, modulo 256, as two hexadecimal digits."""
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def command(device: int, axis: int, number: int, words: str) -> bytes:
    """A command with its message number and its sum."""
    text = f"{device} {axis} {number:02d} {words}"
    return f"/{text}:{checksum(text)}\n".encode("ascii")


def parse_reply(line: bytes, device: int, axis: int, *, summed: bool) -> Reply:
    """A reply of this device and axis, its sum verified, and demanded if `summed`; `ValueError` for all else."""
    text = line.decode("latin-1").removesuffix("\r\n")
    match = _REPLY.fullmatch(text)
    if match is None:
        raise ValueError("no reply")
    sum_given = match[8]
    if sum_given is None and summed:
        raise ValueError("a reply without its checksum")
    if sum_given is not None and sum_given != checksum(text[1:-3]):
        raise ValueError("a reply with a wrong checksum")
    if (int(match[1]), int(match[2])) != (device, axis):
        raise ValueError(f"a reply of device {int(match[1])}, axis {match[2]}")
    return Reply(int(match[3]), match[4] == "OK", match[5] == "BUSY", match[6], match[7])
