"""The guide through a rig's instruments: what is asked, tried and moved, in this order, and the record of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.charge import rig_of_ones_own
from rigctl.check.asking import Asking
from rigctl.check.record import CheckRecord, Line, Who, instruments_sha256, keep, kept_record, utc_now
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Identity
from rigctl.files.rig_file import RigFile
from rigctl.rig import Rig


@dataclass(frozen=True)
class Checked:
    """What came of a check: its record and where that is, who answered, what moved, and the wires' logs."""

    record: CheckRecord
    path: Path
    identities: dict[str, Identity]
    moving: list[str]
    wire_logs: dict[str, Path]


@dataclass
class _Lines:
    """The findings so far, each told when it is made."""

    tell: Callable[[Line], None]
    lines: list[Line] = field(default_factory=list)

    def add(self, instrument: str, finding: Finding) -> None:
        """One more."""
        line = Line.of(instrument, finding)
        self.lines.append(line)
        self.tell(line)


def check(file: RigFile, tell: Callable[[Line], None] = lambda _: None) -> Checked:
    """Go through the instruments of a rig file; every finding is told as soon as it is made.

    `RigError` when another program holds an instrument, or the record cannot be kept.
    """
    lines = _Lines(tell)
    with rig_of_ones_own(file):
        rig = Rig(file)
        rig.wire_logs.prepare("asked")
        asking = Asking(rig, lines.add)
        asking.ask_all()
    record = CheckRecord(
        rig=file.rig.name,
        instruments_sha256=instruments_sha256(file),
        checked=utc_now(),
        identities={name: Who.of(identity) for name, identity in asking.identities.items()},
        lines=lines.lines,
    ).going_on(kept_record(file))
    return Checked(record, keep(record), asking.identities, asking.moving, rig.wire_logs.files)
