"""What widgets and threads tell the application: the operator's requests, and what threads have found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from textual.message import Message

from rigctl.console.log_lines import LogLine, Search
from rigctl.console.store_view import StoreView
from rigctl.core.making_safe import Rest

Severity = Literal["information", "warning", "error"]
Request = Literal["pause", "resume", "abort"]


@dataclass
class MotionAsked(Message):
    """Move a stage: `move` to a position, `jog` by a step, in the unit of its panel, or `home` it."""

    stage: str
    motion: Literal["move", "jog", "home"]
    values: tuple[float, ...] = ()


class ReconnectAsked(Message):
    """Try the instruments that do not answer again."""


@dataclass(frozen=True)
class Launch:
    """A campaign to start: the options of `rigctl run`."""

    campaign: Path
    store: Path
    rig: Path | None = None
    unattended: bool = False
    seed: int | None = None
    investigate: bool = False
    """Whether it goes on by itself: as `rigctl investigate`."""
    max_runs: int | None = None
    """Of an investigation; None for those of a full scan."""


@dataclass
class StartAsked(Message):
    """Start a campaign in a process of its own."""

    launch: Launch


@dataclass
class DryRunAsked(Message):
    """Tell what a campaign would do."""

    campaign: Path


@dataclass
class RequestAsked(Message):
    """Pause, resume or abort the campaign that is watched."""

    kind: Request


@dataclass
class AnalysisAsked(Message):
    """Have something computed from the store that is open: a function of `rigctl.console.analysis`."""

    what: str
    arguments: tuple[Any, ...] = ()


@dataclass
class RunAsked(Message):
    """Show a run of the store that is open: what it recorded, and how far it is off."""

    run_id: str


@dataclass
class WriteAsked(Message):
    """Write what is known of the store that is open to a file: one of `rigctl.console.writing.KINDS`."""

    kind: str


@dataclass
class FileWritten(Message):
    """It is there."""

    kind: str
    path: Path


@dataclass
class SearchAsked(Message):
    """Search the events of the store that are not kept on the screen."""

    search: Search


@dataclass
class EarlierFound(Message):
    """What a search has found there."""

    search: Search
    lines: Sequence[LogLine]


@dataclass
class Noted(Message):
    """Something to tell the operator; errors are alarms."""

    text: str
    severity: Severity = "information"


class BenchTaken(Message):
    """The rig that was to be opened is open, or was refused."""


@dataclass
class StoreSeen(Message):
    """The store as it is now."""

    view: StoreView


@dataclass
class CampaignEnded(Message):
    """A campaign or an investigation that this console started has ended, with the last line of its log."""

    store: Path
    status: int
    last_line: str


@dataclass
class Stopped(Message):
    """What came of a STOP, instrument by instrument."""

    rests: tuple[Rest, ...]


@dataclass
class Signalled(Message):
    """A signal ends this console; everything it holds has been stopped."""

    reason: str
