"""What can be written of a store from the console, under which name it is proposed, and how it is looked at."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Written:
    """One kind of file, or of directory: what is in it, and how its name goes on after the store's."""

    explanation: str
    suffix: str
    then: Literal["", "look", "open"] = ""
    """`look` at it in a browser, where there is one; `open` it in the console."""


KINDS = {
    "report": Written("everything in one HTML file", ".html", "look"),
    "figures": Written("a directory with an SVG and a CSV of each figure", "-figures"),
    "certificate": Written("a calibration certificate, HTML, PDF or XML", "-certificate.html", "look"),
    "bundle": Written("a directory of plain files, for others to import", "-bundle"),
    "campaign": Written("what to measure next, ready to be started", "-next.toml", "open"),
    "draft": Written("a plug-in of what no known effect describes", "_effect.py", "open"),
}
OF_RESULTS = ("report", "figures", "certificate", "bundle")
OF_THE_WORKBENCH = ("campaign", "draft", "report")


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


def look_at(path: Path) -> subprocess.Popen[bytes] | None:
    """Show a file in the browser of a desktop; None on a terminal alone, where there is none."""
    if sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        return None
    # By a process of its own: what a browser says must not land on this screen, nor wait for it.
    return subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "webbrowser", path.absolute().as_uri()],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
