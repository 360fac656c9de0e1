"""What widgets tell the application: the operator's wishes, and what threads have found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from textual.message import Message

if TYPE_CHECKING:
    from rigctl.console.feed import StoreView
    from rigctl.console.log_lines import LogLine, Search
    from rigctl.core.making_safe import Rest

Severity = Literal["information", "warning", "error"]
Request = Literal["pause", "resume", "abort"]


class MoveAsked(Message):
    """Move a stage to `value`, in the unit of its panel."""

    def __init__(self, name: str, value: float) -> None:
        super().__init__()
        self.name = name
        self.value = value


class JogAsked(Message):
    """Move a stage by `step` from where it is, in the unit of its panel."""

    def __init__(self, name: str, step: float) -> None:
        super().__init__()
        self.name = name
        self.step = step


class HomeAsked(Message):
    """Home a stage."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name


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


class StartAsked(Message):
    """Start a campaign in a process of its own."""

    def __init__(self, launch: Launch) -> None:
        super().__init__()
        self.launch = launch


class DryRunAsked(Message):
    """Tell what a campaign would do."""

    def __init__(self, campaign: Path) -> None:
        super().__init__()
        self.campaign = campaign


class RequestAsked(Message):
    """Pause, resume or abort the campaign that is watched."""

    def __init__(self, kind: Request) -> None:
        super().__init__()
        self.kind: Request = kind


class OpenAsked(Message):
    """Open a rig file, a campaign file or a store."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path


class AnalysisAsked(Message):
    """Have something worked out from the store that is open: a name of `rigctl.console.analysis`."""

    def __init__(self, what: str, *arguments: Any) -> None:
        super().__init__()
        self.what = what
        self.arguments = arguments


class SearchAsked(Message):
    """Search the events of the store that are not kept on the screen."""

    def __init__(self, search: Search) -> None:
        super().__init__()
        self.search = search


class EarlierFound(Message):
    """What a search has found there."""

    def __init__(self, search: Search, lines: Sequence[LogLine]) -> None:
        super().__init__()
        self.search = search
        self.lines = lines


class Noted(Message):
    """Something to tell the operator; errors are alarms."""

    def __init__(self, text: str, severity: Severity = "information") -> None:
        super().__init__()
        self.text = text
        self.severity: Severity = severity


class BenchTaken(Message):
    """The rig that was to be opened is open, or was refused."""


class StoreSeen(Message):
    """The store as it is now."""

    def __init__(self, view: StoreView) -> None:
        super().__init__()
        self.view = view


class CampaignEnded(Message):
    """A campaign this console started has ended, with what it last said on stderr."""

    def __init__(self, store: Path, status: int, said: str) -> None:
        super().__init__()
        self.store = store
        self.status = status
        self.said = said


class Stopped(Message):
    """What came of a STOP, instrument by instrument."""

    def __init__(self, rests: tuple[Rest, ...]) -> None:
        super().__init__()
        self.rests = rests


class Signalled(Message):
    """A signal ends this console; everything it holds has been stopped."""

    def __init__(self, reason: str) -> None:
        super().__init__()
        self.reason = reason
