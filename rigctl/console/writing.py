"""What can be written of a store from the console, and under which name it is proposed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Written:
    """One kind of file, or of directory: what is in it, and how its name goes on after the store's."""

    explanation: str
    suffix: str


KINDS = {
    "report": Written("everything in one HTML file", ".html"),
    "figures": Written("a directory with an SVG and a CSV of each figure", "-figures"),
    "certificate": Written("a calibration certificate, HTML or PDF", "-certificate.html"),
    "bundle": Written("a directory of plain files, for others to import", "-bundle"),
}


def proposed(kind: str, store: Path) -> Path:
    """The name under which a kind is offered, beside the store."""
    return store.with_name(store.name.removesuffix(".sqlite").removesuffix(".rig") + KINDS[kind].suffix)


def refusal(name: str) -> str:
    """Why nothing is written under a name; empty when it is."""
    path = Path(name.strip())
    if not name.strip():
        return "it needs a name"
    if path.exists():
        return f"{path} exists; give another name"
    return "" if path.parent.is_dir() else f"there is no directory {path.parent}"
