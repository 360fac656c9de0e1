"""After a fault: everything to rest, the instruments brought back, and a person asked where that is not enough.

A motion is never repeated blindly: first everything is at rest, then each instrument is connected anew and says
where it is, then what has lost its reference is homed. See docs/decisions/025.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Protocol

from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.store.entries import BACK, FAULT, LOST
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError, LinkError, MotionStopped, NotRecovered, RigError, SafetyStop
from rigctl.core.interfaces import Instrument, Stage

ATTEMPTS = 4
"""How often a run is measured before a person is asked."""
INTERVALS_S = (1.0, 5.0, 20.0, 60.0, 300.0)
"""Between two attempts to bring an instrument back [rig s]; the last one from then on."""
GIVE_UP_S = 4.0 * 3600.0
"""How long an instrument may be lost before a person is asked [rig s]: the power of a building comes back in less."""

Faults = (LinkError, InstrumentError)
"""What may be repeated; everything else that is raised ends a campaign."""


@dataclass(frozen=True)
class Apparatus:
    """What a run is measured with: the instruments whose readings or set-points enter it.

    `forget` is called once all are connected anew and at rest: what is believed of them need not be so any more.
    """

    stages: tuple[Stage, ...] = ()
    others: tuple[Instrument, ...] = ()
    forget: Callable[[], None] = lambda: None
    confirms_itself: bool = False
    """The run does so as it goes: one of days is not given up for a doubt at its end."""

    alone: bool = False
    """Nothing else of the rig is brought to rest for its sake."""

    @property
    def instruments(self) -> tuple[Instrument, ...]:
        """All of them."""
        return (*self.stages, *self.others)

    def confirm(self) -> None:
        """All stages have known throughout where they are, and no reply is outstanding or surplus.

        Raises `InstrumentError` or `LinkError` otherwise.
        """
        if self.confirms_itself:
            return
        for stage in self.stages:
            require_homed(stage)
        for instrument in self.instruments:
            instrument.confirm_in_step()


def require_homed(stage: Stage) -> None:
    """`SafetyStop` or `InstrumentError` for a stage that has lost its reference; one question where it has not.

    A reference that is lost does not come back by itself: what the stage said before, since it was homed, was true.
    """
    if stage.is_homed():
        return
    if device := stage.safety_stop():
        raise SafetyStop(f"{stage.name}: stopped by a safety device ({device})", instrument=stage.name)
    raise InstrumentError(
        f"{stage.name}: it is homed no more, so that its positions mean nothing; was its power off, or did it meet "
        "an obstacle (following error)?",
        instrument=stage.name,
    )


class Surroundings(Protocol):
    """What recovering needs of a session."""

    @property
    def clock(self) -> Clock:
        """Rig time."""

    @property
    def operator(self) -> Operator:
        """Who is asked."""

    def event(self, kind: str, **data: object) -> None:
        """Note something that happened."""

    def tell(self, what: str = "") -> None:
        """Say it to whoever watches; nothing more is to be said when left out."""

    def wait_s(self, duration_s: float) -> None:
        """Let rig time pass; `Aborted` promptly."""


class Recovery:
    """Brings instruments back; `NotRecovered` when that takes a person, and none agrees."""

    def __init__(self, session: Surroundings, control: Control, progress: Progress) -> None:
        self._session = session
        self._control = control
        self._progress = progress

    def after(self, fault: RigError, what: str, attempt: int, apparatus: Apparatus) -> None:
        """Make ready for another attempt at `what`, whose attempt number `attempt` ended in `fault`.

        Raises the fault itself when it is the echo of an abort.
        """
        if self._control.aborted:
            raise fault
        self._session.event(FAULT, during=what, **fault_data(fault, apparatus))
        # The turning platform is brought back by itself, while its meters go on recording.
        if not apparatus.alone:
            self._control.bring_to_rest()
        # Asked before anything is connected anew: after a safety stop nothing moves without a person.
        agreed = self._agreed(fault)
        if not agreed and attempt % ATTEMPTS == 0:
            self._ask(fault, f"{what} failed {attempt} times, the last time so: {fault}. Try again?")
        self._bring_back(what, apparatus, agreed=agreed)

    def borne(self, what: str, action: Callable[[], None]) -> None:
        """Do what no run depends on: a fault of it is told, and everything is brought to rest."""
        try:
            action()
        except Faults as fault:
            self._control.raise_if_aborted()
            self._session.event(FAULT, during=what, **fault_data(fault, Apparatus()))
            self._control.bring_to_rest()

    def _bring_back(self, what: str, apparatus: Apparatus, *, agreed: bool) -> None:
        since_s, told, tries = self._session.clock.now_s(), "", 0
        for interval_s in itertools.chain(INTERVALS_S, itertools.repeat(INTERVALS_S[-1])):
            try:
                self._reconnect(apparatus, agreed=agreed)
            except Faults as fault:
                # An abort disconnects instruments; the link errors that follow are no fault to recover from.
                if self._control.aborted:
                    raise
                tries += 1
                # What stays lost in the same way is told once, however often it is tried.
                if str(fault) != told:
                    told = str(fault)
                    self._pause(fault, what, apparatus)
                # An instrument that comes back may tell of a safety stop that was not known before.
                agreed = self._agreed(fault)
                if not agreed and self._session.clock.now_s() + interval_s > since_s + GIVE_UP_S:
                    self._ask(fault, f"{_advice(fault)} Try again?")
                    # The person has seen it: another `GIVE_UP_S` before the next question.
                    since_s = self._session.clock.now_s()
                self._session.wait_s(interval_s)
            else:
                break
        if tries:
            self._session.event(BACK, during=what, after_s=self._session.clock.now_s() - since_s, tries=tries)
            self._session.tell()
            self._progress.state("running")

    def _reconnect(self, apparatus: Apparatus, *, agreed: bool) -> None:
        """All instruments connected anew, at rest, in step and ready; the first that is not raises."""
        for instrument in apparatus.instruments:
            # Closing a connection that is lost may fail; it is made anew all the same.
            with suppress(RigError):
                instrument.close()
            with _named(instrument):
                instrument.open()
                # Before any question that could take time: a motion begun before the fault may still run.
                instrument.stop()
                instrument.confirm_in_step()
        # Homing below is a motion: an abort that came meanwhile must keep it back.
        self._control.raise_if_aborted()
        apparatus.forget()
        for stage in apparatus.stages:
            # The device stays tripped until homing acknowledges it; who has agreed is not asked a second time.
            if not agreed and (device := stage.safety_stop()):
                raise SafetyStop(f"{stage.name}: stopped by a safety device ({device})", instrument=stage.name)
            if not stage.is_homed():
                stage.home()

    def _pause(self, fault: RigError, what: str, apparatus: Apparatus) -> None:
        self._session.event(LOST, during=what, **fault_data(fault, apparatus))
        self._session.tell(_advice(fault))
        self._progress.state("paused")

    def _agreed(self, fault: RigError) -> bool:
        """Whether a person was needed, and has agreed; False where none was needed."""
        if not isinstance(fault, SafetyStop | MotionStopped):
            return False
        self._ask(fault, f"{fault}. Remove the cause. May the instruments be moved again?")
        return True

    def _ask(self, fault: RigError, question: str) -> None:
        if not self._session.operator.accept(question):
            raise NotRecovered(f"{fault}; mend that, then `rigctl resume`") from fault


def fault_data(fault: RigError, apparatus: Apparatus) -> dict[str, str]:
    """A fault as an event keeps it: which instrument, which kind of error, its words."""
    text = str(fault)
    # Errors of a wire carry the name of the instrument in their words only.
    named = [each.name for each in apparatus.instruments if text.startswith((f"{each.name}:", f"{each.name} "))]
    instrument = getattr(fault, "instrument", "") or next(iter(named), "")
    return {"instrument": instrument, "error": type(fault).__name__, "text": text}


@contextmanager
def _named(instrument: Instrument) -> Iterator[None]:
    """Errors of a wire say whose it is."""
    try:
        yield
    except LinkError as error:
        if str(error).startswith(instrument.name):
            raise
        raise type(error)(f"{instrument.name}: {error}") from error


def _advice(fault: RigError) -> str:
    return f"waiting for an instrument: {fault}; the campaign goes on by itself once it answers."
