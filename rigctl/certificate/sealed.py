"""Files that carry a hash over themselves: whatever is changed in them afterwards shows.

The hash is SHA-256 over the file with 64 zeros in the hash's place. It sees accidents and edits by hand; it is no
signature, for whoever changes a file can make the hash anew.
"""

from __future__ import annotations

import hashlib
import re

MARK = b"rigctl-sha256 "
_ZEROS = b"0" * 64
_SEAL = re.compile(re.escape(MARK) + rb"([0-9a-f]{64})")


def place() -> str:
    """What a file has to contain where its hash will be; only the last one counts, whatever texts before it say."""
    return (MARK + _ZEROS).decode()


def sealed(data: bytes) -> bytes:
    """A file with its hash in its place."""
    before, _, after = data.rpartition(MARK + _ZEROS)
    return before + MARK + _digest(data) + after


def intact(data: bytes) -> bool | None:
    """Whether a file is as it was sealed; None where there is no hash in it."""
    found = [*_SEAL.finditer(data)]
    if not found:
        return None
    start, end = found[-1].span(1)
    return _digest(data[:start] + _ZEROS + data[end:]) == data[start:end]


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).hexdigest().encode()
