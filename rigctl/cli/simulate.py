"""The command that serves simulated instruments."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, RigToml, print_json, say
from rigctl.files.rig_file import read_rig
from rigctl.serving import Served

app = typer.Typer(add_completion=False)


@app.command()
def simulate(
    rig: RigToml,
    write_rig: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a rig file that points at the served instruments.")
    ] = None,
    measured: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Append what the instruments really measure, for trials.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve a rig file's simulated instruments on loopback ports and pseudo-terminals until interrupted."""
    with Served(read_rig(rig), measured=measured) as served:
        if write_rig is not None:
            # Whole or not at all: somebody may be waiting for it to appear.
            partial = write_rig.with_name(f".{write_rig.name}.{os.getpid()}")
            partial.write_text(served.rig_text(), encoding="utf-8")
            partial.rename(write_rig)
        if as_json:
            print_json({"instruments": served.addresses})
        else:
            for address in served.addresses:
                say(" ".join(f"{key}={value}" for key, value in address.items()))
        # Somebody may be waiting for the addresses at the end of a pipe.
        sys.stdout.flush()
        served.serve()
