"""The guide through a rig's instruments: what is asked, tried and moved, in this order, and the record of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.charge import in_charge, rig_of_ones_own
from rigctl.check.asking import Asking, Tell
from rigctl.check.hands import Hands
from rigctl.check.interlocks import try_interlocks
from rigctl.check.mended import mended
from rigctl.check.motions import Motions
from rigctl.check.moving_edges import MovingEdges
from rigctl.check.record import CheckRecord, Line, Who, instruments_sha256, keep, kept_record, utc_now
from rigctl.check.trigger import try_trigger
from rigctl.core.errors import Aborted, RigError
from rigctl.core.findings import Finding, Step, differs, unknown
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


@dataclass(frozen=True)
class Wanted:
    """What is done beyond asking."""

    trigger: bool = False
    interlocks: bool = False
    move: bool = False

    @property
    def steps(self) -> set[Step]:
        """What instruments are started for, or somebody is asked."""
        asked: dict[Step, bool] = {"trigger": self.trigger, "interlock": self.interlocks, "motion": self.move}
        return {step for step, wanted in asked.items() if wanted}


def check(
    file: RigFile,
    wanted: Wanted = Wanted(),
    tell: Callable[[Line], None] = lambda _: None,
    say: Callable[[str], None] = lambda _: None,
) -> Checked:
    """Go through the instruments of a rig file; every finding is told as soon as it is made; requests, and
    what is waited for, are said.

    Moves nothing but with `wanted.move`. Goes on as if what differs in the rig file were mended, and without the
    instruments that cannot be used. `RigError` when another program holds an instrument, or the record cannot be
    kept.
    """
    lines = _Lines(tell)
    with rig_of_ones_own(file):
        rig = Rig(file)
        rig.wire_logs.prepare("checked")
        asking = Asking(rig, lines.add, say)
        asking.ask_all()
        usable = _usable(file, asking, lines.add) if wanted.steps else file
    for warning in file.warnings:
        what, _, mend = warning.partition("; ")
        lines.add("", unknown("capability", "certificates", what, mend))
    only_asked = len(lines.lines)
    learned = _tried(usable, wanted, lines.add, say) if wanted.steps and usable.instruments else {}
    for line in _left_out(wanted):
        lines.add("", line)
    record = CheckRecord(
        rig=file.rig.name,
        instruments_sha256=instruments_sha256(file),
        checked=utc_now(),
        identities={name: Who.of(identity) for name, identity in asking.identities.items()},
        lines=_settled(lines.lines[:only_asked], lines.lines[only_asked:]),
        learned=learned,
    ).going_on(kept_record(file), wanted.steps)
    return Checked(record, keep(record), asking.identities, asking.moving, rig.wire_logs.files)


def _settled(asked: list[Line], tried: list[Line]) -> list[Line]:
    """Without what was unknown until it was tried."""
    answered = {(line.instrument, line.step) for line in tried}
    still = [line for line in asked if line.outcome != "unknown" or (line.instrument, line.step) not in answered]
    return still + tried


def _usable(file: RigFile, asking: Asking, tell: Tell) -> RigFile:
    """The rig as it would be once the rig file is mended, without what cannot be used then either."""
    there = mended(file, asking.mended, asking.unusable)
    rig = Rig(there) if there.instruments else None
    unusable = set(asking.unusable)
    for name, instrument in rig.instruments.items() if rig else ():
        try:
            instrument.open()
        except RigError as error:
            unusable.add(name)
            what, _, mend = str(error).rpartition("; ")
            tell(name, differs("capability", "as the rig file is mended", what or mend, mend))
        finally:
            instrument.close()
    return mended(file, asking.mended, unusable)


def _tried(file: RigFile, wanted: Wanted, tell: Tell, say: Callable[[str], None]) -> dict[str, dict[str, str]]:
    """Start and move things, everything at rest before and after; what was learned by it. `Aborted`."""
    rig = Rig(file)
    learned: dict[str, dict[str, str]] = {}
    try:
        with in_charge(rig) as control:
            hands = Hands(say, control.raise_if_aborted, rig.clock)
            if wanted.trigger:
                try_trigger(rig, tell)
            if wanted.move:
                learned = Motions(rig, hands, tell).try_all()
            if wanted.trigger and wanted.move:
                MovingEdges(rig, hands, tell).try_all()
            # Last: what it has stopped wants homing.
            if wanted.interlocks:
                try_interlocks(rig, hands, tell)
    except Aborted:
        raise
    # What was found by then is kept all the same.
    except RigError as error:
        words = "; ".join([str(error), *getattr(error, "__notes__", [])])
        tell("", differs("capability", "all at rest", words, "look whether everything stands still"))
    return learned


def _left_out(wanted: Wanted) -> Iterator[Finding]:
    if not wanted.trigger:
        yield unknown("trigger", "edges", "not tried", "`rigctl check --trigger`: ten edges")
    if not wanted.interlocks:
        yield unknown("interlock", "emergency stop", "not tried", "`rigctl check --interlocks`, with somebody there")
    if not wanted.move:
        yield unknown("motion", "sign and scale", "not tried", "`rigctl check --move`, a hand on the stop button")
