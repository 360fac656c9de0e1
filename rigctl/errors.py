"""Every error a user can meet.

    RigError
    ├── ConfigError            a file an operator wrote: names file, key and mend
    ├── DataError              a recording or a store: names file, line and mend
    ├── LinkError              the wire
    │   ├── LinkTimeout        nothing (or not all) came back in time
    │   └── LinkLost           the connection is gone
    ├── InstrumentError        the instrument answered with an error: carries its code and text
    │   ├── WrongInstrument    it answers as another model
    │   ├── BadReply           it answers what its manual does not allow
    │   └── MotionStopped      a motion ended before its target because somebody stopped it
    ├── LimitError             refused before a byte was sent
    ├── ProcedureError         the measurement cannot go on: says why
    └── Aborted                the operator asked for it

A message is one line: what, where, and the next thing to try.
"""

from __future__ import annotations


class RigError(Exception):
    """Root of all errors that are meant for a person to read."""


class ConfigError(RigError):
    """A rig or campaign file is wrong; the message names file, key and mend."""


class DataError(RigError):
    """A recording or a store is wrong; the message names file, line and mend."""


class LinkError(RigError):
    """The wire failed."""


class LinkTimeout(LinkError):
    """Nothing, or not all, came back in time."""


class LinkLost(LinkError):
    """The connection is gone."""


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


class MotionStopped(InstrumentError):
    """A motion was stopped before it reached its target."""


class LimitError(RigError):
    """A set-point outside the limits; nothing was sent."""


class ProcedureError(RigError):
    """The measurement cannot go on."""


class Aborted(RigError):
    """The operator aborted."""
