"""What a 33500B is asked before it drives anything: errors, and what is on its outputs. Changes neither."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from drivers.examining import asked
from drivers.scpi import ScpiLink
from rigctl.core.findings import Finding, differs, ok

GUIDE = "33500 Series Operating and Service Guide"
OPEN_CIRCUIT = 1e9
"""OUTP:LOAD? answers 9.9E37 for an infinite load."""


def examined(
    firmware: str, outputs: Mapping[str, int], link: ScpiLink, queued: Sequence[tuple[str, str]]
) -> Iterator[Finding]:
    """One thing after the other; `queued` are errors of other clients, from before."""
    yield ok("identity", "firmware", firmware)
    texts = "; ".join(f'{code},"{text}"' for code, text in queued)
    yield ok("capability", "error queue", f"emptied of old errors: {texts}" if queued else "empty")
    for name, number in outputs.items():
        yield asked("capability", f"output {number}", partial(_output, name, number, link), GUIDE)


def _output(name: str, number: int, link: ScpiLink) -> Finding:
    on = link.query_whole(f"OUTP{number}?")
    load = link.query_number(f"OUTP{number}:LOAD?")
    reckoned = "an open circuit" if load > OPEN_CIRCUIT else f"{load:g} ohm"
    found = f"{name}: {'ON' if on else 'off'}, reckoned for {reckoned}"
    if on:
        return differs("capability", f"output {number}", found, "who drives it? `rigctl stop` switches it off")
    return ok("capability", f"output {number}", found)
