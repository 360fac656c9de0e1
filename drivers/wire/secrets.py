"""What must not stand in a log: passwords in commands, and wherever an instrument repeats them."""

from __future__ import annotations

import re
from collections.abc import Iterable

MASK = b"***"
SHORTEST = 4
"""Shorter ones are masked in their commands only: replaced wherever they stand, they would spoil everything else."""

_COMMANDS = re.compile(
    # Newport XPS, also without its end: Login(name, password)
    rb"Login\s*\([^,()\r\n]*,\s*(?:(?P<xps>[^\r\n]*)\)|(?P<cut>[^\r\n]*))"
    # Keysight: CALibration:SECure:CODE code, CALibration:SECure:STATe OFF,code
    rb"|CAL(?:IBRATION)?:SEC(?:URE)?:CODE\s+(?P<code>[^\r\n;]+)"
    rb"|CAL(?:IBRATION)?:SEC(?:URE)?:STAT(?:E)?\s+\w+\s*,\s*(?P<state>[^\r\n;]+)"
    # SCPI nodes of the kind SYSTem:PASSword
    rb"|:PASS(?:WORD)?(?::\w+)*\s+(?P<node>[^\r\n;]+)"
    # PI: CCL level password
    rb"|\bCCL\s+\d+\s+(?P<level>[^\r\n]+)"
    # Whatever is called a password
    rb"|passw(?:or)?d\w*['\"]?\s*[=:(,\s]\s*(?P<named>[^\s,;)]+)",
    re.IGNORECASE,
)


class Masking:
    """Masks the secrets of one log: what commands say they are, and `known` ones wherever they stand."""

    def __init__(self, known: Iterable[str] = ()) -> None:
        self._known = {secret.encode("utf-8") for secret in known if len(secret) >= SHORTEST}

    @property
    def aware(self) -> bool:
        """Whether there is anything that an instrument could repeat."""
        return bool(self._known)

    def command(self, data: bytes) -> bytes:
        """What was sent, masked; its secrets are masked from now on in what comes, too."""
        if (found := _COMMANDS.search(data)) is None:
            return self.plain(data)
        while found is not None:
            start, end = _place(found)
            secret = data[start:end].strip(b"\"' ")
            if len(secret) >= SHORTEST and secret != MASK:
                self._known.add(secret)
            data = data[:start] + MASK + data[end:]
            found = _COMMANDS.search(data, start + len(MASK))
        return self.plain(data)

    def plain(self, data: bytes) -> bytes:
        """Anything else, with the known secrets masked."""
        # The longest first: one may be the beginning of another.
        for secret in sorted(self._known, key=len, reverse=True):
            data = data.replace(secret, MASK)
        return data

    def text(self, text: str) -> str:
        """A message of ours that may quote the wire."""
        return self.plain(self.command(text.encode("utf-8"))).decode("utf-8", "replace")


def _place(found: re.Match[bytes]) -> tuple[int, int]:
    # Every alternative has one group, and exactly one alternative has matched.
    return found.span(found.lastgroup or 0)


def address_without_secret(address: str) -> str:
    """An address without the password that may stand before its host, or among its options."""
    address = re.sub(r"(//[^/@:]*):[^/@]*@", r"\1:***@", address)
    return re.sub(r"(?i)((?:passw\w*|token|secret)=)[^&]*", r"\1***", address)
