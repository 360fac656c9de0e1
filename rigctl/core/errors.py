"""Every error a user can meet, and its text, which is one line.

    RigError
    ├── ConfigError            a file an operator wrote: names file, key and mend
    ├── DataError              a recording or a store: names file, line and mend
    │   └── StorageError       nothing is wrong with it, but the disk is full, for reading only, or fails
    ├── DamagedStore           what is stored is not what was written: names the part and the mend
    ├── LinkError              the wire
    │   ├── LinkTimeout        nothing (or not all) came back in time
    │   ├── LinkLost           the connection is gone
    │   └── OutOfStep          replies may belong to other questions: nothing read in this run is to be believed
    ├── InstrumentError        the instrument answered with an error: carries its code and text
    │   ├── WrongInstrument    it answers as another model
    │   ├── BadReply           it answers what its manual does not allow
    │   ├── EdgesMissing       fewer trigger edges came than were armed for: says how many, where that is known
    │   ├── ImplausibleSample  a reading that cannot be true: names channel and sample
    │   ├── SafetyStop         an emergency stop or a limit switch: goes on when a person says so
    │   └── MotionStopped      a motion ended before its target because somebody stopped it
    ├── LimitError             refused before a byte was sent
    ├── ProcedureError         the measurement cannot go on: says why
    │   └── NotRecovered       an instrument was not brought back, or a run failed too often
    ├── NotChecked             a rig of real instruments that `rigctl check` has not seen like this
    ├── PluginError            a file of effects does what none may: ends the program, never returns
    └── Aborted                the operator asked for it

A message is one line: what, where, and the next thing to try.
"""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.core.bounds import MESSAGE_CHARACTERS


class RigError(Exception):
    """Root of all errors that are meant for a person to read."""


class ConfigError(RigError):
    """A rig or campaign file is wrong; the message names file, key and mend."""


class DataError(RigError):
    """A recording or a store is wrong; the message names file, line and mend."""


class StorageError(DataError):
    """The disk does not take or give what is asked of it; the message names the file and the mend."""


class DamagedStore(RigError):
    """What a store holds is not what was written; the message names the run or the part, and the mend.

    No `DataError`: who leaves out a run whose data do not do must not leave out one that was damaged.
    """


class LinkError(RigError):
    """The wire failed; `instrument` is whose it is, empty where nobody knows."""

    instrument = ""


class LinkTimeout(LinkError):
    """Nothing, or not all, came back in time; `received` came, and stays for the next read."""

    received = b""


class LinkLost(LinkError):
    """The connection is gone."""


class OutOfStep(LinkError):
    """Replies may have been out of step with questions: nothing read in this run is to be believed.

    The link has been resynchronised: the next question gets its own reply.
    """


class InstrumentError(RigError):
    """An instrument refused or failed.

    `code` is the instrument's own error code as it sent it, `text` its own words; both may be empty.
    """

    def __init__(self, message: str, *, instrument: str = "", code: str = "", text: str = "") -> None:
        super().__init__(message)
        self.instrument = instrument
        self.code = code
        self.text = text


class WrongInstrument(InstrumentError):
    """Something else answers at this address."""


class BadReply(InstrumentError):
    """A reply the manual does not allow."""


class EdgesMissing(InstrumentError):
    """Fewer trigger edges came than were armed for; `came` is None where the instrument does not tell how many."""

    def __init__(self, message: str, *, instrument: str, came: int | None, armed: int) -> None:
        super().__init__(message, instrument=instrument)
        self.came = came
        self.armed = armed


class ImplausibleSample(InstrumentError):
    """A reading that cannot be true; `sample` counts from 0, None where it is no sample of a column."""

    def __init__(self, message: str, *, channel: str, sample: int | None = None, instrument: str = "") -> None:
        super().__init__(message, instrument=instrument)
        self.channel = channel
        self.sample = sample


class SafetyStop(InstrumentError):
    """An emergency stop or a limit switch has stopped the axis; only a person can say that it may move again."""


class MotionStopped(InstrumentError):
    """A motion was stopped before it reached its target."""


class LimitError(RigError):
    """A set-point outside the limits; nothing was sent."""


class ProcedureError(RigError):
    """The measurement cannot go on."""


class NotRecovered(ProcedureError):
    """After a fault an instrument was not brought back, or a run failed too often."""


class NotChecked(RigError):
    """Instruments that are no simulators, and no record of a check that they are as the rig file says."""


class PluginError(RigError):
    """A user's file of effects would end the program, keep it waiting or change it."""


class Aborted(RigError):
    """The operator aborted."""


UNFIT = (ConfigError, DataError, ProcedureError)
"""Raised where data and model do not go together: who tries several goes on to the next. Damage is not in it."""


def refuses_input(error: RigError) -> bool:
    """Whether it says that what was given is wrong, rather than that the work failed."""
    return isinstance(error, ConfigError | DataError | LimitError) and not isinstance(error, StorageError)


def one_line(text: str) -> str:
    """`text` with everything that would break a line or a terminal escaped, the middle left out where it is long."""
    # What and where stand at the beginning of a message, the mend at its end.
    if len(text) > MESSAGE_CHARACTERS:
        text = f"{text[: MESSAGE_CHARACTERS // 2]} ... {text[-MESSAGE_CHARACTERS // 2 :]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def either(choices: Iterable[str]) -> str:
    """The choices as one reads them: "a, b or c"."""
    *first, last = choices
    return f"{', '.join(first)} or {last}" if first else last
