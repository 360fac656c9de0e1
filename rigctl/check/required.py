"""What `run` asks for before it moves real instruments: a record of a check of just these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.campaign.session.served import is_served
from rigctl.check.record import CheckRecord, Who, kept_record, with_learned
from rigctl.core.errors import NotChecked
from rigctl.core.interfaces import Identity
from rigctl.files.rig_file import RigFile

KEPT = "check"
"""Where the header of a store has it."""


@dataclass(frozen=True)
class Clearance:
    """Whether a rig may be moved: its record, if there is one, or that somebody has answered for it (`unchecked`).

    `real` are its instruments that are no simulators.
    """

    file: RigFile
    record: CheckRecord | None
    real: tuple[str, ...]
    unchecked: bool

    def require(self) -> None:
        """`NotChecked` for real instruments without a record, or with one in which something differs."""
        if self.unchecked or not self.real:
            return
        mend = f"run `rigctl check {self.file.path}` first, or run with --unchecked"
        real = ", ".join(self.real)
        if self.record is None:
            raise NotChecked(
                f"{self.file.path}: {real}: not simulated, and not checked as [instruments] is now; {mend}"
            )
        if differing := self.record.differing:
            first, more = differing[0], f" and {len(differing) - 1} more" if len(differing) > 1 else ""
            raise NotChecked(
                f"{self.file.path}: at the check of {self.record.checked} {first.instrument or 'the rig'} differed "
                f"({first.step}, {first.item}: {first.found}){more}; mend it, then {mend}"
            )

    def require_same(self, identities: Mapping[str, Identity]) -> None:
        """`NotChecked` when other instruments answer than at the check."""
        if self.record is None or self.unchecked:
            return
        for name in self.real:
            now, then = Who.of(identities[name]), self.record.identities.get(name)
            if now != then:
                raise NotChecked(
                    f"{self.file.path}: {name} is {now}, at the check it was {then or 'not there'}; "
                    f"run `rigctl check {self.file.path}` again, or run with --unchecked"
                )

    def kept(self) -> dict[str, Any]:
        """What the store keeps of it."""
        unchecked = {"unchecked": True} if self.unchecked and self.real else {}
        record = {"record": self.record.model_dump(mode="json")} if self.record else {}
        return {KEPT: {**unchecked, **record}} if unchecked or record else {}

    def informed(self) -> RigFile:
        """The rig file with what the check has learned by moving."""
        return with_learned(self.file, self.record.learned) if self.record else self.file


def clearance_of(file: RigFile, *, unchecked: bool) -> Clearance:
    """What is known of these instruments; nothing is connected. `DataError` when the record is damaged."""
    return Clearance(file, kept_record(file), real_instruments(file), unchecked)


def real_instruments(file: RigFile) -> tuple[str, ...]:
    """Those that live neither in this process nor in a simulator on this machine."""
    return tuple(
        name for name, table in file.instruments.items() if not (table.simulated or is_served(table.address))
    )


def informed(file: RigFile, kept: Mapping[str, Any]) -> RigFile:
    """The rig file of a store with what the check has learned that the store's header has `kept`."""
    return with_learned(file, kept.get(KEPT, {}).get("record", {}).get("learned", {}))
