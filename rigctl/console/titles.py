"""What files are, in a few words: for a list from which one is opened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

MOST = 12
"""So many files that were opened are kept, the last first."""

_LARGEST_BYTES = 100_000
"""Larger files are not read only to be named."""

PATTERNS = ("*.rig.sqlite", "*.toml", "*.py", "campaigns/*.toml", "out/*.rig.sqlite")


def with_opened(recent: Mapping[str, str], path: Path, title: str) -> dict[str, str]:
    """The files that were opened, with this one first; the oldest beyond `MOST` is forgotten."""
    name = str(path.absolute())
    others = {other: said for other, said in recent.items() if other != name}
    return dict(list({name: title or recent.get(name, ""), **others}.items())[:MOST])


def openable(recent: Mapping[str, str], here: Path) -> list[tuple[str, str]]:
    """What was opened before and is still there, then what is near, each with what it is; paths are short."""
    from rigctl.campaign.origin import TRUTH_SUFFIX  # after the first paint

    told = {_short(Path(name), here): title for name, title in recent.items() if Path(name).is_file()}
    for pattern in PATTERNS:
        for path in sorted(here.glob(pattern)):
            # What a simulated world hides is not for who looks for it.
            if not path.name.endswith(TRUTH_SUFFIX):
                told.setdefault(_short(path, here), title_of(path))
    return list(told.items())


def title_of(path: Path) -> str:
    """The title that a campaign file or a rig file has; "" of what has none, or cannot be read."""
    if path.suffix != ".toml":
        return ""
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            return ""
        import tomllib  # after the first paint

        return titled(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):  # told when it is opened
        return ""


def titled(tables: Mapping[str, Any]) -> str:
    """A campaign's title, or a rig's name."""
    rig = tables.get("rig")
    named: Sequence[Any] = (tables.get("title"), rig.get("name") if isinstance(rig, dict) else None)
    return next((" ".join(each.split()) for each in named if isinstance(each, str)), "")


def _short(path: Path, here: Path) -> str:
    absolute = path.absolute()
    return str(absolute.relative_to(here.absolute()) if absolute.is_relative_to(here.absolute()) else absolute)
