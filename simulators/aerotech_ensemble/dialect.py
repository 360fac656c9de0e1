"""The readings of the manual: what a real controller may do one way or the other.

Each key is one thing that the sources leave open. The defaults are the readings that make life hardest for a client;
`GENTLE` has the others.
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class StageDialect(BaseModel):
    """How a controller that speaks this language reads the manual."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    always_send_eos: bool = False
    """CommandSetup "Always Send EOS": a line feed after a bare acknowledge too."""
    limit_reply: Literal["refuse", "fault"] = "fault"
    """A set-point outside a limit: answered `#`, or `%` followed by the fault. The axis fault is set in both."""
    abort_disabled: Literal["refuse", "accept"] = "refuse"
    """ABORT on an axis that is disabled: answered `#` or `%`."""
    homing_needed: bool = True
    """Does an axis that is not homed refuse to move? In the manual's example it moves."""
    home_async: Literal["none", "program", "keyword"] = "none"
    """What homes without blocking the interpreter: the maker's HomeAsync.bcx, the word HOMEASYNC, or nothing."""

    oscillate_distance: Literal["peak-to-peak", "amplitude"] = "amplitude"
    """What OSCILLATE takes its distance for."""
    oscillate_waits: Literal["always", "as moves do", "never"] = "always"
    """Is OSCILLATE over when the motion is, whatever the wait mode?"""
    oscillate_shows: bool = False
    """Has AXISSTATUS its bit "move active" while the axis oscillates?"""
    oscillate_over_ascii: bool = False
    """Is OSCILLATE understood by the ASCII interface, or in programs alone?"""
    oscillate_frequencies: Literal["required", "optional", "unknown"] = "required"
    """The fourth number of OSCILLATE: the maker's library has it, the one program seen has not."""

    capture_over_ascii: bool = False
    """Is DATAACQ understood by the ASCII interface, or in programs alone?"""
    capture_read: Literal["continues", "restarts"] = "restarts"
    """Does a second READ go on where the first ended, or begin with the first point again?"""
    capture_short_read: Literal["refuse", "partial"] = "partial"
    """A READ of more points than recorded: a fault, or done with the rest of the registers untouched."""

    program_start_s: float = Field(default=0.05, ge=0)
    """From the acknowledge of PROGRAM RUN to the program's first line."""


class EnsembleDialect(StageDialect):
    """How an Ensemble reads the manual."""

    bare_speed_word: bool = False
    """Is the speed of a single axis' move understood as `F20` too, or as `XF20` alone?"""


GENTLE = EnsembleDialect(
    always_send_eos=True,
    limit_reply="refuse",
    abort_disabled="accept",
    bare_speed_word=True,
    homing_needed=False,
    home_async="program",
    oscillate_distance="peak-to-peak",
    oscillate_waits="as moves do",
    oscillate_shows=True,
    oscillate_over_ascii=True,
    oscillate_frequencies="optional",
    capture_over_ascii=True,
    capture_read="continues",
    capture_short_read="refuse",
    program_start_s=0.0,
)
"""The other reading of each."""
