"""Commands that speak to a rig's instruments, real or served."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.cli.io import Json, RigToml, number, print_json, say
from rigctl.errors import ConfigError

app = typer.Typer()


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
    from rigctl import config
    from rigctl.serving import Served

    with Served(config.read_rig(rig), measured=measured) as served:
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
        sys.stdout.flush()
        served.serve()


@app.command()
def check(rig: RigToml, as_json: Json = False) -> None:
    """Connect to every instrument and ask who it is; moves nothing."""
    from dataclasses import asdict

    from rigctl import config
    from rigctl.rig import Rig

    opened = Rig(config.read_rig(rig))
    opened.open()
    try:
        identities = {name: asdict(identity) for name, identity in opened.identities().items()}
    finally:
        opened.close()
    if as_json:
        print_json({"instruments": identities})
    else:
        for name, identity in identities.items():
            say(f"{name}: {identity['model']}, serial {identity['serial'] or '?'}, {identity['text']}")


@app.command()
def stop(rig: RigToml, as_json: Json = False) -> None:
    """Bring every instrument of a rig to rest, whoever is using it."""
    from rigctl import config
    from rigctl.rig import Rig

    opened = Rig(config.read_rig(rig))
    opened.open()
    try:
        opened.stop()
    finally:
        opened.close()
    if as_json:
        print_json({"stopped": sorted(opened.instruments)})
    else:
        say(f"at rest: {', '.join(opened.instruments)}")


@app.command()
def home(
    rig: RigToml,
    name: Annotated[str | None, typer.Argument(metavar="NAME")] = None,
    as_json: Json = False,
) -> None:
    """Home a stage, or all of them."""
    with _stages(rig) as stages:
        chosen = [_stage(stages, name, rig)] if name else list(stages.values())
        for stage in chosen:
            stage.home()
        homed = [stage.name for stage in chosen]
    if as_json:
        print_json({"homed": homed})
    else:
        say(f"homed: {', '.join(homed)}")


@app.command(context_settings={"ignore_unknown_options": True})
def move(
    rig: RigToml,
    name: Annotated[str, typer.Argument(metavar="NAME")],
    value: Annotated[
        float, typer.Argument(metavar="VALUE", parser=number, help="deg for a rotation stage, mm for a linear one")
    ],
    as_json: Json = False,
) -> None:
    """Move a stage to a position (homing it first if needed)."""
    with _stages(rig) as stages:
        stage = _stage(stages, name, rig)
        stage.home()
        stage.move_to(value)
        reading = stage.angle() if hasattr(stage, "angle") else stage.position()
    if as_json:
        print_json({"name": name, "value": reading.value, "unit": reading.unit})
    else:
        say(f"{name}: {reading.value:g} {reading.unit}")


def _stages(rig: Path) -> Any:
    from contextlib import contextmanager

    from rigctl import config
    from rigctl.rig import Rig
    from rigctl.runner import rig_of_ones_own

    @contextmanager
    def opened() -> Any:
        file = config.read_rig(rig)
        with rig_of_ones_own(file), Rig(file) as live:
            yield {s.name: s for s in (*live.by_role("rotation"), *live.by_role("linear"))}

    return opened()


def _stage(stages: dict[str, Any], name: str, rig: Path) -> Any:
    if name not in stages:
        raise ConfigError(f"{rig}: no stage '{name}'; there are {', '.join(stages) or 'none'}")
    return stages[name]
