"""Who moves a rig: nobody else at the same time, everything at rest first and last, and a signal stops it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rigctl.campaign.session import locks
from rigctl.campaign.session.control import Control
from rigctl.core.errors import Aborted, RigError
from rigctl.core.making_safe import OnTerminalLost, ended_by_signals
from rigctl.files.rig_file import RigFile
from rigctl.rig import Rig


@contextmanager
def in_charge(
    rig: Rig, on_terminal_lost: OnTerminalLost = "stop", at_pause: Callable[[], None] = lambda: None
) -> Iterator[Control]:
    """The rig open and ours alone, at rest before anything moves and when left.

    INT, TERM, and HUP unless it is to be survived, stop everything at once and take the instruments away from
    whatever goes on; `Aborted` when somebody aborted, `RigError` when another process holds an instrument.
    """
    control = Control(rig.stop, at_pause, rig.close)
    # In this order: nobody else first, then signals, then connections; left the other way round.
    with rig_of_ones_own(rig.file), ended_by_signals(control.abort, on_terminal_lost), _told_as_abort(control), rig:
        # A signal may have come while instruments were being connected.
        control.raise_if_aborted()
        yield control


@contextmanager
def rig_of_ones_own(rig_file: RigFile) -> Iterator[None]:
    """Hold the instruments of a rig file; `RigError` when a campaign of another process does."""
    refusal = (
        f"{rig_file.path}: another campaign holds these instruments, or a console; see `rigctl status` of its store"
    )
    with locks.instruments_held(rig_file, refusal):
        yield


@contextmanager
def _told_as_abort(control: Control) -> Iterator[None]:
    """What fails because everything was stopped is an abort; what could not be stopped is still told."""
    try:
        yield
    except RigError as error:
        if not control.aborted or isinstance(error, Aborted):
            raise
        aborted = Aborted(control.reason)
        for note in getattr(error, "__notes__", []):
            aborted.add_note(note)
        raise aborted from error
    # The work may have ended by itself in the moment in which somebody aborted.
    control.raise_if_aborted()
