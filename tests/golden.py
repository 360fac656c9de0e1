"""Golden numbers: what the command line says of shipped campaigns and recordings, to hold a changed tree against.

    python -m tests.golden --tree BEFORE --out DIR                     # once, of the tree as it was
    python -m tests.golden --out NEW --against DIR                     # this tree; status 1 if anything differs
    python -m tests.golden --out NEW --against DIR --only one-axis 'table-*'     # some; --list names all

Every command runs in a process of its own. What is in --out of the same sources is not made again. Numbers are
compared bit for bit; paths, times of day and progress are not. Samples and long figures are a hash per column.
"""

from __future__ import annotations

import argparse
import csv
import difflib
import fnmatch
import hashlib
import html
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.golden_cases import CASES, FILES

LONG_BYTES = 20_000
SOURCES = ("rigctl", "drivers", "simulators", "procedures", "campaigns", "examples", "pyproject.toml")
ENVIRONMENT = {"COLUMNS": "120", "TERM": "dumb", "NO_COLOR": "1", "OPENBLAS_NUM_THREADS": "1"}
IGNORED_KEYS = {"store", "started", "time", "eta_s"}
PASSING_LINE = re.compile(r" left$|runs/s$")
TIME_OF_DAY = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d| UTC)?")
DRAWING = re.compile(r"<(svg|style)\b.*?</\1>", re.DOTALL)


def fingerprint(tree: Path) -> str:
    """A hash of everything in the tree that what is said can depend on."""
    roots = [tree / name for name in SOURCES]
    files = sorted(f for root in roots for f in (root, *root.rglob("*")) if f.suffix in {".py", ".toml", ".csv"})
    whole = hashlib.sha256(b"".join(str(f.relative_to(tree)).encode() + f.read_bytes() for f in files if f.is_file()))
    own = b"".join((Path(__file__).parent / name).read_bytes() for name in ("golden.py", "golden_cases.py"))
    return hashlib.sha256(whole.digest() + own).hexdigest()


def made(tree: Path, out: Path, name: str) -> None:
    """Run a case's commands and keep what each says, in a file for each."""
    work, kept = out / f".{name}.work", out / name
    for directory in (work, kept):
        shutil.rmtree(directory, ignore_errors=True)
        directory.mkdir(parents=True)
    for file, text in FILES.items():
        (work / file).write_text(text.format(tree=tree), encoding="utf-8")
    sources, known = fingerprint(tree), set(work.iterdir())
    environment = {**os.environ, **ENVIRONMENT, "PYTHONPATH": str(tree)}

    def masked(text: str) -> list[str]:
        plain = text.replace(str(work), "WORK").replace(str(tree), "TREE")
        return [line for line in TIME_OF_DAY.sub("TIME", plain).splitlines() if not PASSING_LINE.search(line)]

    for number, line in enumerate(CASES[name]):
        command = line.format(store=work / "golden.rig.sqlite", work=work)
        call = [sys.executable, "-m", "rigctl", *shlex.split(command)]
        done = subprocess.run(call, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        said: dict[str, Any] = {"command": masked(command), "status": done.returncode, "stderr": masked(done.stderr)}
        lines = masked(done.stdout)
        said["stdout"] = json.loads("\n".join(lines)) if "--json" in command and lines else lines
        fresh = [f for f in sorted(work.rglob("*")) if f.is_file() and ".rig.sqlite" not in f.name and f not in known]
        known.update(fresh)
        said["files"] = {str(f.relative_to(work)): contents(f, masked) for f in fresh}
        title = re.sub(r"\W+", "-", line.replace("{store}", "").replace("{work}/", "")).strip("-")[:60]
        (kept / f"{number:02}-{title}.json").write_text(json.dumps(said, indent=1), encoding="utf-8")
    shutil.rmtree(work)
    (kept / "fingerprint").write_text(sources)


def contents(file: Path, masked: Callable[[str], list[str]]) -> Any:
    """A table's columns, a drawing's or a page's words, a text's lines."""
    if file.suffix == ".npz":
        with np.load(file) as arrays:
            each = {key: arrays[key] for key in arrays}
        return {key: [str(array.dtype), *array.shape, digest(array.tobytes())] for key, array in each.items()}
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".csv":
        columns = {name: rest for name, *rest in zip(*csv.reader(text.splitlines()), strict=True)}
        if len(text) <= LONG_BYTES:
            return columns
        return {name: [len(rest), digest("\n".join(rest).encode())] for name, rest in columns.items()}
    if file.suffix == ".svg":
        return [html.unescape(words) for words in re.findall(r"<text[^>]*>([^<]*)</text>", text)]
    if file.suffix == ".html":
        words = re.sub(r"</t[dh]>\s*<t[dh][^>]*>", " | ", DRAWING.sub("", text))
        return [line.strip() for line in masked(html.unescape(re.sub(r"<[^>]+>", "\n", words))) if line.strip()]
    return masked(text)


def digest(data: bytes) -> str:
    """Short enough to read, long enough to tell."""
    return hashlib.sha256(data).hexdigest()[:16]


def differences(before: Any, after: Any, where: str) -> Iterator[str]:
    """Each difference in a line: where, before, after."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            if key not in IGNORED_KEYS:
                yield from differences(before.get(key, "(nothing)"), after.get(key, "(nothing)"), f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) == len(after):
            for place, (one, other) in enumerate(zip(before, after, strict=True)):
                yield from differences(one, other, f"{where}[{place}]")
        else:
            lines = difflib.unified_diff([*map(str, before)], [*map(str, after)], lineterm="", n=0)
            yield from (f"{where}: {line}" for line in lines if not line.startswith(("---", "+++")))
    elif repr(before) != repr(after):
        yield f"{where}: {before!r} -> {after!r}"


def compared(before: Path, after: Path) -> list[str]:
    """All differences between two directories of one case."""
    found: list[str] = []
    for name in sorted({f.name for directory in (before, after) for f in directory.glob("*.json")}):
        one, other = (json.loads(f.read_text()) if f.exists() else "(nothing)" for f in (before / name, after / name))
        found += differences(one, other, f"{after.name}/{name}")
    return found


def main() -> int:
    """Make what is missing, then compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[1], help="default: this one")
    parser.add_argument("--out", type=Path, help="where to keep what it says")
    parser.add_argument("--against", type=Path, help="what another tree said")
    parser.add_argument("--only", nargs="+", default=["*"], metavar="NAME", help="cases, or patterns of them")
    parser.add_argument("--list", action="store_true", help="name all cases")
    given = parser.parse_args()
    if given.against and not given.against.is_dir():
        parser.error(f"{given.against} is no directory")
    names = [name for name in CASES if any(fnmatch.fnmatch(name, pattern) for pattern in given.only)]
    if given.list or given.out is None or not names:
        sys.stdout.write("\n".join(CASES) + "\n")
        return 0 if given.list else 2
    tree, out, found = given.tree.resolve(), given.out.resolve(), 0
    for name in names:
        stamp, began = out / name / "fingerprint", time.monotonic()
        if not (stamp.exists() and stamp.read_text() == fingerprint(tree)):
            made(tree, out, name)
        lines = compared(given.against / name, out / name) if given.against else []
        sys.stdout.write("".join(f"{line[:400]}\n" for line in lines))
        verdict = f", {len(lines)} differences" if given.against else ""
        sys.stdout.write(f"{name}: {time.monotonic() - began:.1f} s{verdict}\n")
        sys.stdout.flush()
        found += len(lines)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
