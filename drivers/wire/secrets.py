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
        self._known: dict[bytes, re.Pattern[bytes]] = {}
        for secret in known:
            self._learn(secret.encode("utf-8"))

    @property
    def aware(self) -> bool:
        """Whether there is anything that an instrument could repeat."""
        return bool(self._known)

    def command(self, data: bytes) -> bytes:
        """What was sent, masked; its secrets are masked from now on in what comes, too."""
        masked, secrets = _without_secrets(data)
        for secret in secrets:
            self._learn(secret.strip(b"\"' "))
        return self._without_known(masked)

    def quoted(self, data: bytes) -> bytes:
        """What may repeat a command or a part of it, masked."""
        return self._without_known(_without_secrets(data)[0])

    def _learn(self, secret: bytes) -> None:
        if len(secret) < SHORTEST or MASK in secret:
            return
        # A code of digits must not be taken out of the middle of a reading.
        form = rb"(?<![\w.])%b(?!\w)" if secret.isdigit() else rb"%b"
        self._known[secret] = re.compile(form % re.escape(secret))
        # The longest first: one may be the beginning of another.
        self._known = dict(sorted(self._known.items(), key=lambda item: -len(item[0])))

    def _without_known(self, data: bytes) -> bytes:
        for pattern in self._known.values():
            data = pattern.sub(MASK, data)
        return data


def _without_secrets(data: bytes) -> tuple[bytes, list[bytes]]:
    lower = data.lower()
    # One of these is in every command with a secret; to look for them takes a tenth of the search.
    if not (b"login" in lower or b"pass" in lower or b":sec" in lower or b"ccl" in lower):
        return data, []
    secrets: list[bytes] = []
    found = _COMMANDS.search(data)
    while found is not None:
        start, end = _place(found)
        secrets.append(data[start:end])
        data = data[:start] + MASK + data[end:]
        found = _COMMANDS.search(data, start + len(MASK))
    return data, secrets


def _place(found: re.Match[bytes]) -> tuple[int, int]:
    # Every alternative has one group, and exactly one alternative has matched.
    return found.span(found.lastgroup or 0)


def address_without_secret(address: str) -> str:
    """An address without the password that may stand before its host, or among its options."""
    address = re.sub(r"(//[^/@:]*):[^/@]*@", r"\1:***@", address)
    return re.sub(r"(?i)((?:passw\w*|token|secret)=)[^&]*", r"\1***", address)
