"""The samples on the pages beside what the program prints now; `--write` puts what it prints on the page.

    python -m tests.doc_samples docs/workbench.md docs/table.md [--write]

Commands of a page's `console` blocks are carried out one after the other in a directory of their own. `...` on the
page stands for lines left out and is kept: the lines between two of them are found again by their first and last.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
LEFT_OUT = "..."
BLOCK = re.compile(r"(?<=```console\n).*?(?=```)", re.DOTALL)
LIKE = 0.5
"""Lines alike to this share, numbers apart, can be the same line."""


def printed(command: str, directory: Path) -> list[str]:
    """What a command prints to a terminal of 80 columns, progress left out."""
    done = subprocess.run(
        command,
        shell=True,
        cwd=directory,
        env={**os.environ, "COLUMNS": "80"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    out = done.stdout if done.returncode == 0 else done.stdout + done.stderr
    return [line.rstrip() for line in out.splitlines()]


def _alike(one: str, other: str) -> float:
    plain, others = (re.sub(r"[\d.]+", "0", line) for line in (one, other))
    return difflib.SequenceMatcher(None, plain, others, autojunk=False).ratio()


def _found(line: str, lines: list[str], start: int) -> int | None:
    """Where a line of the page stands in what is printed, from `start` on: the first of the most alike."""
    likeness = [_alike(line, each) for each in lines[start:]]
    best = max(likeness, default=0.0)
    return start + likeness.index(best) if best > LIKE else None


def renewed(sample: list[str], now: list[str]) -> list[str]:
    """A sample with the lines that are printed now, elided as it was; all of it where a line is not found again."""
    if LEFT_OUT not in sample:
        return now
    pieces: list[list[str]] = [[]]
    for line in sample:
        if line == LEFT_OUT:
            pieces.append([])
        else:
            pieces[-1].append(line)
    renewed_lines, after = list[str](), 0
    for number, piece in enumerate(pieces):
        if number:
            renewed_lines.append(LEFT_OUT)
        if not piece:
            continue
        first = after if number == 0 else _found(piece[0], now, after)
        last = first if first is None or len(piece) == 1 else _found(piece[-1], now, first)
        if first is None or last is None:
            return now
        renewed_lines += now[first : last + 1]
        after = last + 1
    return renewed_lines


def renewed_block(block: str, directory: Path) -> str:
    """A console block with what its commands print now."""
    commands: list[tuple[str, list[str]]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            commands.append((line[2:], []))
        else:
            commands[-1][1].append(line)
    lines: list[str] = []
    for command, sample in commands:
        now = printed(command, directory)
        lines += [f"$ {command}", *(renewed(sample, now) if sample else [])]
    return "\n".join(lines) + "\n"


def renewed_page(text: str) -> str:
    """A page with what its commands print now."""
    with tempfile.TemporaryDirectory() as place:
        for name in ("campaigns", "examples"):
            (Path(place) / name).symlink_to(ROOT / name)
        return BLOCK.sub(lambda match: renewed_block(match.group(), Path(place)), text)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--write", action="store_true", help="put what is printed now on the page")
    given = parser.parse_args()
    differ = False
    for page in given.pages:
        text = page.read_text(encoding="utf-8")
        now = renewed_page(text)
        differ = differ or now != text
        sys.stdout.writelines(
            difflib.unified_diff(text.splitlines(True), now.splitlines(True), str(page), f"{page}, printed now")
        )
        if given.write:
            page.write_text(now, encoding="utf-8")
    return int(differ and not given.write)


if __name__ == "__main__":
    sys.exit(main())
