"""Commands that read wire logs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from drivers.wire.reading import read_wire_log
from rigctl.cli.io import Json, print_json, say
from rigctl.files.rig_file import read_rig
from rigctl.replay import follow
from rigctl.wire_view import documents, text_lines

app = typer.Typer()

Log = Annotated[Path, typer.Argument(metavar="LOG", help="A wire log, as --wire-log writes it.")]


@app.command()
def wire(
    log: Log,
    full: Annotated[bool, typer.Option("--full", help="Show all bytes, and fold nothing.")] = False,
    as_json: Json = False,
) -> None:
    """What went over the wire of an instrument, readable."""
    read = read_wire_log(log)
    if as_json:
        print_json({"header": asdict(read.header), "masked": len(read.masked), "records": documents(read)})
        return
    for line in text_lines(read, full=full):
        say(line)


@app.command()
def replay(
    log: Log,
    rig: Annotated[Path, typer.Option(metavar="RIG.toml", help="The rig file with the instrument's settings.")],
    instrument: Annotated[
        str, typer.Option(metavar="NAME", help="The instrument of the rig file; default: the log's.")
    ] = "",
    as_json: Json = False,
) -> None:
    """Run a driver against a wire log: does it say what was said then, and understand the answers?"""
    outcome = follow(log, read_rig(rig), instrument)
    if as_json:
        print_json(asdict(outcome))
        return
    who = f", {outcome.identity.text}" if outcome.identity else ""
    moves = ", MOVES" if outcome.moving else ""
    of = f"{outcome.replayed} of {outcome.records} records"
    say(f"{outcome.instrument}: {outcome.driver} follows the log, {of}{who}{moves}")
