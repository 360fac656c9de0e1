"""The first day's guide: who answers, what is set otherwise than the rig file says, and what nobody could tell."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Annotated

import typer

from rigctl.check.guide import Checked, Wanted
from rigctl.check.guide import check as guide
from rigctl.check.record import Line
from rigctl.cli.io import Json, RigToml, WireLog, print_json, say, tell
from rigctl.core.errors import RigError
from rigctl.files.rig_file import read_rig

app = typer.Typer(add_completion=False)

MENDS = {"ok": "", "differs": "mend", "unknown": "look up"}
"""What a line's second half is."""


@app.command()
def check(
    rig: RigToml,
    trigger: Annotated[bool, typer.Option("--trigger", help="Count ten trigger edges at every recorder.")] = False,
    interlocks: Annotated[bool, typer.Option("--interlocks", help="See the emergency stop pressed by hand.")] = False,
    move: Annotated[bool, typer.Option("--move", help="MOVES: homes, then a millimetre and a degree.")] = False,
    wire_log: WireLog = None,
    as_json: Json = False,
) -> None:
    """Go through every instrument: ok, differs, or unknown; moves nothing but with --move."""
    told = _Told()
    file = read_rig(rig).with_wire_log(wire_log)
    checked = guide(file, Wanted(trigger, interlocks, move), told.silently if as_json else told, tell)
    differing = checked.record.differing
    if as_json:
        print_json(_document(checked))
    else:
        say(_summary(checked.record.lines))
        say(f"record: {checked.path}")
    if differing:
        raise RigError(f"{rig}: {'; '.join(map(_in_one_line, differing))}")


class _Told:
    """Prints every line when it is found, under the name of its instrument."""

    def __init__(self) -> None:
        self.lines: list[Line] = []

    def __call__(self, line: Line) -> None:
        if not self.lines or self.lines[-1].instrument != line.instrument:
            say(f"{line.instrument or 'rig'}:")
        say(f"  {line.outcome:<8} {line.step}, {line.item}: {line.found}")
        if line.mend:
            say(f"           {MENDS[line.outcome]}: {line.mend}")
        self.silently(line)

    def silently(self, line: Line) -> None:
        """Keep it only."""
        self.lines.append(line)


def _document(checked: Checked) -> dict[str, object]:
    record = checked.record
    return {
        "instruments": {name: asdict(identity) for name, identity in checked.identities.items()},
        "moving": checked.moving,
        "findings": [line.model_dump(mode="json") for line in record.lines],
        "learned": record.learned,
        "instruments_sha256": record.instruments_sha256,
        "record": str(checked.path),
        "wire_logs": {name: str(path) for name, path in checked.wire_logs.items()},
    }


def _summary(lines: list[Line]) -> str:
    count = Counter(line.outcome for line in lines)
    return f"{count['ok']} ok, {count['differs']} differ, {count['unknown']} unknown"


def _in_one_line(line: Line) -> str:
    where = f"{line.instrument}: " if line.instrument else ""
    return f"{where}{line.step}, {line.item}: {line.found}; {line.mend}"
