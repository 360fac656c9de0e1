"""What an LK-G controller is asked before a record: its heads, its line, its storage, its TIMING input."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from drivers.keyence_settings import KeyenceSettings
from rigctl.core.findings import Finding, ok, unknown
from rigctl.core.interfaces import Reading

MANUAL_3001, MANUAL_5000 = "LK-G series user's manual, chapter 5", "LK-G5000 series user's manual"
VM_COMP_S = 2e-6
"""A multimeter's pulse, which the TIMING input does not see."""


def heads_and_line(
    settings: KeyenceSettings, values: Callable[[], Sequence[Reading]], *, guarded: bool
) -> Iterator[Finding]:
    """What every controller is asked."""
    yield unknown(
        "identity",
        "firmware",
        "no command tells serial number and firmware",
        "the controller's display or LK-Navigator",
    )
    if guarded:
        yield ok("capability", "line", "a turned bit is noticed")
    else:
        yield ok(
            "capability",
            "line",
            "without parity stored values are read twice, others thrice; parity=E halves the time",
        )
    for (name, output), reading in zip(settings.heads.items(), values(), strict=True):
        yield _head(name, output, reading)


def _head(name: str, output: int, reading: Reading) -> Finding:
    item = f"head {name}"
    if math.isnan(reading.value):
        return unknown(
            "capability",
            item,
            f"OUT{output} has no valid value now",
            "is the target in front of it, within its range, and tilted so that the light comes back?",
        )
    return ok("capability", item, f"OUT{output}: {reading.value:+.4f} mm now")


def own_clock(storage: str, samples_max: int, longest_s: float, start_u_s: float) -> Iterator[Finding]:
    """Of an LK-G3001: the storage that it has accepted."""
    yield ok(
        "capability", "storage", f"{storage} is accepted; {samples_max} values an output, {longest_s:g} s at 100 Hz"
    )
    yield ok(
        "capability",
        "clock",
        f"its own, no trigger wire; its start is known to {1e3 * start_u_s:g} ms at least (start_u_s)",
    )


def timing_input(settings: KeyenceSettings) -> Iterator[Finding]:
    """Of an LK-G5000: the storage by its TIMING input."""
    yield ok("capability", "storage", f"{settings.samples_max} values a head, one for each edge at TIMING")
    pulse_s = VM_COMP_S if settings.timing_pulse_s is None else settings.timing_pulse_s
    said = "straight from VM COMP" if settings.timing_pulse_s is None else "timing_pulse_s"
    yield unknown(
        "trigger",
        "pulse",
        f"pulses of {1e3 * pulse_s:g} ms at TIMING ({said}): no question tells whether it sees them",
        f"{MANUAL_5000}, TIMING input, shortest ON time; or `rigctl check --trigger`",
    )
