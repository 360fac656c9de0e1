"""What a 34465A is asked before a record: firmware and options, errors, memory, how fast it goes, one reading.

Firmware and options: Truevolt Series Operating and Service Guide, *IDN? and *OPT?; that digitising is an option
below firmware 3.0: QCoDeS' driver.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from drivers.examining import asked
from drivers.keysight_settings import VoltmeterSettings
from drivers.scpi import ScpiLink
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.interfaces import Identity, Reading

GUIDE = "Truevolt Series Operating and Service Guide"
DIGITISES_SINCE = 3, 0
UNDIGITISED_APERTURE_S = 0.3e-3
MEMORY, MEMORY_WITH_OPTION = 50_000, 2_000_000
USUAL_PERIOD_S = 0.01


def who(identity: Identity, link: ScpiLink, queued: Sequence[tuple[str, str]]) -> Iterator[Finding]:
    """Firmware and errors; `queued` are those of other clients, from before."""
    yield _firmware(identity.firmware)
    texts = "; ".join(f'{code},"{text}"' for code, text in queued)
    yield ok("capability", "error queue", f"emptied of old errors: {texts}" if queued else "empty")
    yield asked("capability", "mains", lambda: ok("capability", "mains", f"{link.query('SYST:LFR?')} Hz"), GUIDE)


def as_voltmeter(
    identity: Identity, settings: VoltmeterSettings, link: ScpiLink, fastest_s: Callable[[], float]
) -> Iterator[Finding]:
    """What a record needs; `fastest_s` sets the meter up as for one and asks for its shortest interval."""
    options = [option.strip() for option in link.query("*OPT?").split(",")]
    yield ok("capability", "options", ", ".join(option for option in options if option != "0") or "none")
    yield _aperture(identity.firmware, settings, "DIG" in options)
    yield _memory(settings, "MEM" in options)
    yield asked("capability", "pace", partial(_pace, settings, fastest_s), GUIDE)


def reads(item: str, read: Callable[[], Reading]) -> Finding:
    """One reading now."""
    reading = read()
    if math.isnan(reading.value):
        return differs("capability", item, "overloaded, or nothing connected", "look at cable and terminals")
    return ok("capability", item, f"{reading.value:.6g} {reading.unit} now")


def _version(firmware: str) -> tuple[int, int] | None:
    # A letter for the hardware, then the main firmware: A.03.01-...
    match = re.match(r"[A-Z]\.(\d+)\.(\d+)", firmware)
    return (int(match[1]), int(match[2])) if match else None


def _firmware(firmware: str) -> Finding:
    version = _version(firmware)
    if version is None:
        return unknown("identity", "firmware", f"{firmware!r} does not begin as A.03.01", f"{GUIDE}, *IDN?")
    if version < DIGITISES_SINCE:
        return differs(
            "identity",
            "firmware",
            f"{firmware}: older than {DIGITISES_SINCE[0]}.{DIGITISES_SINCE[1]:02d}, which the driver was written for",
            "update it (Keysight's support page of the 34465A, by its web page or a USB stick)",
        )
    return ok("identity", "firmware", firmware)


def _aperture(firmware: str, settings: VoltmeterSettings, digitises: bool) -> Finding:
    version = _version(firmware)
    able = digitises or (version is not None and version >= DIGITISES_SINCE)
    found = f"aperture_s = {settings.aperture_s:g}"
    if able or settings.aperture_s >= UNDIGITISED_APERTURE_S:
        return ok("capability", "aperture", found)
    return differs(
        "capability",
        "aperture",
        f"{found} needs option DIG, or firmware 3.0 which has it",
        f"write aperture_s = {UNDIGITISED_APERTURE_S:g}, or update it",
        {"aperture_s": UNDIGITISED_APERTURE_S},
    )


def _memory(settings: VoltmeterSettings, extended: bool) -> Finding:
    there = MEMORY_WITH_OPTION if extended else MEMORY
    found = f"memory_readings = {settings.memory_readings} in the rig file, the meter has {there}"
    if settings.memory_readings <= there:
        return ok("capability", "memory", found)
    mend = f"write memory_readings = {there}"
    return differs("capability", "memory", found, mend, {"memory_readings": there})


def _pace(settings: VoltmeterSettings, fastest_s: Callable[[], float]) -> Finding:
    shortest_s = fastest_s()
    found = f"a reading every {shortest_s:g} s at the most, with aperture_s = {settings.aperture_s:g}"
    if shortest_s <= USUAL_PERIOD_S:
        return ok("capability", "pace", found)
    return differs("capability", "pace", f"{found}: too slow for 100 Hz", "shorten aperture_s, or sample slower")
