"""What can be asked of instruments before anything moves: who is there, and is it set as the rig file says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum
from typing import Any

from drivers.wire.secrets import address_without_secret
from rigctl.check.elsewhere import found_elsewhere, tried_besides
from rigctl.core.errors import LinkError, RigError, WrongInstrument
from rigctl.core.findings import Finding, Step, differs, ok, unknown
from rigctl.core.interfaces import Examinable, Identity, Instrument, Stage
from rigctl.rig import Rig

Tell = Callable[[str, Finding], None]
"""Takes a finding with the name of its instrument, "" for the rig."""

LOOK_UP = "look the code up in the instrument's manual, and remove its cause"


class Asking:
    """Asks one instrument after the other; what differs or fails with one keeps nobody from the next."""

    def __init__(self, rig: Rig, tell: Tell, say: Callable[[str], None] = lambda _: None) -> None:
        self.identities: dict[str, Identity] = {}
        self.moving: list[str] = []
        self.mended: dict[str, dict[str, Any]] = {}
        """Keys of the rig file as they would have to be."""
        self.unusable: set[str] = set()
        """Instruments that nothing can be done with until somebody has mended what differs."""
        self._rig = rig
        self._tell = tell
        self._say = say

    def ask_all(self) -> None:
        """Ask every instrument of the rig."""
        for name, instrument in self._rig.instruments.items():
            self._ask(name, instrument)

    def _ask(self, name: str, instrument: Instrument, *, elsewhere: bool = False) -> None:
        try:
            self._examine(name, instrument)
        except RigError as error:
            # Before others try: a line has room for one.
            instrument.close()
            if name in self.identities or elsewhere or not self._found_elsewhere(name, error):
                self._fails(name, error)
        finally:
            instrument.close()

    def _found_elsewhere(self, name: str, error: RigError) -> bool:
        """True when it answers at another rate or port, where it is asked then."""
        said = self._rig.file.instruments[name].address
        # At a wrong rate bytes may come, but not these; in a network something else has answered.
        if not (isinstance(error, LinkError) or said.startswith("serial:")):
            return False
        elsewhere = found_elsewhere(self._rig, name, self._say)
        if elsewhere is None:
            return False
        mend = f'write address = "{elsewhere.address}", or set the instrument to what {said} says'
        found = f"nothing understandable comes at {said}, but it answers at {elsewhere.words}"
        self._note(name, differs("found", "address", found, mend, {"address": elsewhere.address}))
        self._ask(name, elsewhere.instrument, elsewhere=True)
        return True

    def _examine(self, name: str, instrument: Instrument) -> None:
        for shown in questions(instrument):
            if isinstance(shown, Identity):
                self.identities[name] = shown
                self._note(name, ok("found", "address", self._address(name)))
                serial = f", serial {shown.serial}" if shown.serial else ""
                self._note(name, ok("identity", "who answers", f"{shown.model}{serial}, {shown.text}"))
            elif isinstance(shown, Finding):
                self._note(name, shown)
            else:
                self.moving.append(name)
                self._note(name, differs("capability", "motion now", "it MOVES", "look who moves it"))

    def _address(self, name: str) -> str:
        elsewhere = self.mended.get(name, {}).get("address")
        return str(elsewhere or address_without_secret(self._rig.file.instruments[name].address))

    def _fails(self, name: str, error: RigError) -> None:
        self.unusable.add(name)
        # A message is what and where, then the mend.
        what, _, mend = str(error).rpartition("; ")
        if not what:
            # An instrument's own words end with no mend.
            what, mend = mend, LOOK_UP
        step, item = self._step_of(name, error)
        besides = tried_besides(self._rig, name) if step == "found" else ""
        self._note(name, differs(step, item, f"{what}{besides}", mend))

    def _step_of(self, name: str, error: RigError) -> tuple[Step, str]:
        if isinstance(error, LinkError):
            return ("capability", "link") if name in self.identities else ("found", "address")
        return ("identity", "model") if isinstance(error, WrongInstrument) else ("capability", "questions")

    def _note(self, name: str, finding: Finding) -> None:
        if finding.rig_file:
            self.mended.setdefault(name, {}).update(finding.rig_file)
        self._tell(name, finding)


class Moves(Enum):
    """That a stage moves."""

    NOW = "now"


def questions(instrument: Instrument) -> Iterator[Identity | Finding | Moves]:
    """What one instrument is asked, in this order: who it is, all that its driver looks at, whether it moves."""
    if isinstance(instrument, Examinable):
        met = False
        for finding in instrument.examine():
            # Before the first line: by then it is connected, and can be asked who it is.
            if not met:
                yield instrument.identify()
            met = True
            yield finding
    else:
        instrument.open()
        yield instrument.identify()
        yield unknown("capability", "questions", "its driver asks no more", "see the driver's page")
    if isinstance(instrument, Stage) and instrument.is_moving():
        yield Moves.NOW
