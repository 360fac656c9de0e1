"""What the trials found: a file of JSON lines for each kind, one line per seed, added to while they run."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Line = dict[str, Any]


@dataclass(frozen=True)
class Tally:
    """One kind's lines, counted."""

    seeds: int
    tried: int
    failures: int
    processor_s: float


class Records:
    """The lines in a directory, and in others that are only read; one that a kill has cut off is left out."""

    def __init__(self, directory: Path, *others: Path) -> None:
        self.directory = directory.resolve()
        self._others = others
        directory.mkdir(parents=True, exist_ok=True)

    def lines(self, kind: str) -> list[Line]:
        """All lines of a kind; of a seed that has several the last one counts, that of this directory last."""
        by_seed: dict[int, Line] = {}
        for directory in (*self._others, self.directory):
            by_seed |= _lines_of(directory / f"{kind}.jsonl")
        return list(by_seed.values())

    def add(self, kind: str, line: Line) -> None:
        """Append a line; one write, so that two runs may share the directory."""
        text = json.dumps(line, sort_keys=True) + "\n"
        path = self._path(kind)
        torn = path.exists() and not path.read_bytes().endswith(b"\n")
        with path.open("a", encoding="utf-8") as file:
            file.write("\n" + text if torn else text)

    def evidence(self, kind: str, seed: int) -> Path:
        """Where a trial works, and what is left of it when its promise was broken."""
        return self.directory / "evidence" / f"{kind}-{seed}"

    def _path(self, kind: str) -> Path:
        return self.directory / f"{kind}.jsonl"


def _lines_of(path: Path) -> dict[int, Line]:
    if not path.exists():
        return {}
    whole = [_parsed(text) for text in path.read_text(encoding="utf-8").splitlines()]
    return {line["seed"]: line for line in whole if line}


def tally(lines: Iterable[Line]) -> Tally:
    """Count lines of one kind."""
    counted = list(lines)
    return Tally(
        seeds=len(counted),
        tried=sum(line.get("tried", 1) for line in counted),
        failures=sum(line.get("failures", 1) for line in counted if line["failed"]),
        processor_s=sum(line.get("seconds", 0.0) for line in counted),
    )


def _parsed(text: str) -> Line:
    try:
        line = json.loads(text)
    except ValueError:
        return {}
    return line if isinstance(line, dict) and "seed" in line and "failed" in line else {}
