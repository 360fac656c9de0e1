"""The walks of docs/walks.md: files that are there, each named once, each joined to the next by an import."""

from __future__ import annotations

import ast
import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STEP = re.compile(r"^(\d+)\. `([^`]+)`: ", re.MULTILINE)


def walks() -> list[list[str]]:
    found: list[list[str]] = []
    for number, file in STEP.findall((ROOT / "docs/walks.md").read_text(encoding="utf-8")):
        if number == "1":
            found.append([])
        found[-1].append(file)
    return found


def imported_by(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {module.replace(".", "/") + ".py" for module in modules}


@pytest.mark.parametrize("walk", walks(), ids=lambda walk: walk[0])
def test_a_walk_comes_to_every_file_once_and_goes_on_by_an_import(walk: list[str]) -> None:
    assert len(set(walk)) == len(walk) > 2
    knows = {file: imported_by(file) for file in walk}
    apart = [(a, b) for a, b in itertools.pairwise(walk) if b not in knows[a] and a not in knows[b]]
    assert apart == []


def test_all_walks_are_held() -> None:
    assert len(walks()) == 6
