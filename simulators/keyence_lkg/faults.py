"""Why a command is refused."""

from __future__ import annotations

from enum import Enum, auto


class Fault(Enum):
    """The kinds of refusal; each generation has its own code for each."""

    COMMAND = auto()
    STATUS = auto()
    LENGTH = auto()
    COUNT = auto()
    PARAMETER = auto()


class Refused(Exception):
    """The command at hand cannot be done."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.name)
        self.fault = fault
