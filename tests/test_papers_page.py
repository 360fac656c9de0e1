"""docs/papers.md says where each equation, table and figure of the papers is, and what makes it: both must exist."""

from __future__ import annotations

import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")
PACKAGES = ("rigctl", "simulators", "procedures", "drivers")
NAMES = sorted(n for n in set(re.findall(r"`(\w+(?:\.\w+)+)`", PAGE)) if n.split(".")[0] in PACKAGES)
FILES = sorted(set(re.findall(r"`(?:python )?((?:benchmarks|tests|campaigns)/[\w/.-]+)`", PAGE)))
PARTS = {
    "Sensing axes": ("sensing_axis", "analysis/plane.py"),
    "Bias rejection": ("rotating_platform",),
    "In-flight calibration": ("inflight", "worlds/satellite"),
}
"""Headings of the page, and what the paths of the code hold that follows each paper."""


def _resolved(name: str) -> Any:
    """The module of a dotted name, or what it has of that name."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part)
        return found
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("name", NAMES)
def test_what_the_page_names_exists(name: str) -> None:
    assert _resolved(name) is not None


@pytest.mark.parametrize("file", FILES)
def test_files_that_the_page_names_exist(file: str) -> None:
    assert (ROOT / file).exists()


def test_every_store_of_the_page_is_made_by_a_command_of_it() -> None:
    made = re.findall(r"rigctl run (campaigns/\S+) (?:--rig \S+ )?--store (\S+)", PAGE)
    assert made, "no command on the page makes a store"
    for campaign, _ in made:
        assert tomllib.loads((ROOT / campaign).read_text(encoding="utf-8"))["experiment"]
    assert set(re.findall(r"\w+\.rig\.sqlite", PAGE)) == {store for _, store in made}


def _numbers(text: str) -> set[int]:
    """The numbers of "1, 4 to 6, 11b"."""
    found = set()
    for first, last in re.findall(r"(\d+)[a-c]?(?: to (\d+))?", text):
        found |= set(range(int(first), int(last or first) + 1))
    return found


def _has_a_line(part: str, kind: str) -> set[int]:
    """Numbers of the equations, figures or tables that a part of the page has a line for, or says are not had."""
    text = PAGE.split(f"\n## {part}", 1)[1].split("\n## ", 1)[0]
    lines = _numbers(" ".join(re.findall(rf"\b{kind}s? ((?:\d+[a-c]?(?:, | to )?)+)", text, re.IGNORECASE)))
    column = re.findall(r"^\| ([\d, abto]+) \|", _section(text, kind), re.MULTILINE)
    return lines | _numbers(" ".join(column))


def _section(text: str, kind: str) -> str:
    """The sections of a part whose heading says that their tables are of this kind."""
    heading = {"eq.": "Equations", "figure": "Figures", "table": "Tables"}[kind]
    return "".join(re.findall(rf"^### {heading}\n(.*?)(?=^##|\Z)", text, re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("kind", ["eq.", "figure", "table"])
@pytest.mark.parametrize("part", PARTS)
def test_what_the_code_cites_of_a_paper_has_a_line(part: str, kind: str) -> None:
    pattern = rf"\b{kind.rstrip('.')}\.? ((?:\d+[a-c]?(?:, | and | to )?)+)"
    cited = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if any(place in path.as_posix() for place in PARTS[part]):
                cited |= _numbers(" ".join(re.findall(pattern, path.read_text(encoding="utf-8"), re.IGNORECASE)))
    assert cited or (kind == "figure" and part == "In-flight calibration")
    assert cited <= _has_a_line(part, kind)
