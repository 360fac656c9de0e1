"""Commands that speak to a rig's instruments, real or served."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.campaign.session.holders import stopped_from_outside
from rigctl.charge import in_charge
from rigctl.cli.io import Json, RigToml, WireLog, number, print_json, print_outcome, say, tell
from rigctl.core.errors import ConfigError
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig

app = typer.Typer()


@app.command()
def stop(rig: RigToml, as_json: Json = False) -> None:
    """Bring every instrument of a rig to rest; a program that uses one is told to leave."""
    file = read_rig(rig)
    # Not opened: a stop connects by itself, and must not wait until the others have answered.
    rests = stopped_from_outside(file, Rig(file).instruments)
    unsafe = [rest for rest in rests if not rest.confirmed]
    if as_json:
        stopped = sorted(rest.instrument for rest in rests if rest.confirmed)
        lost = [{"name": rest.instrument, "why": rest.why} for rest in unsafe]
        print_json({"stopped": stopped, "not_confirmed": lost})
    else:
        for rest in rests:
            say(str(rest))
    if unsafe:
        raise typer.Exit(1)


@app.command()
def home(
    rig: RigToml,
    name: Annotated[str | None, typer.Argument(metavar="NAME")] = None,
    wire_log: WireLog = None,
    as_json: Json = False,
) -> None:
    """Home a stage, or all of them."""
    with _stages(rig, wire_log) as stages:
        chosen = [_stage(stages, name, rig)] if name else list(stages.values())
        for stage in chosen:
            stage.home()
        homed = [stage.name for stage in chosen]
    print_outcome({"homed": homed}, f"homed: {', '.join(homed)}", as_json=as_json)


# A negative position looks like an option.
@app.command(context_settings={"ignore_unknown_options": True})
def move(
    rig: RigToml,
    name: Annotated[str, typer.Argument(metavar="NAME")],
    value: Annotated[
        float, typer.Argument(metavar="VALUE", parser=number, help="deg for a rotation stage, mm for a linear one")
    ],
    wire_log: WireLog = None,
    as_json: Json = False,
) -> None:
    """Move a stage to a position (homing it first if needed)."""
    with _stages(rig, wire_log) as stages:
        stage = _stage(stages, name, rig)
        # Does only what is still to be done; a stage that is homed does not move here.
        stage.home()
        stage.move_to(value)
        reading = stage.angle() if hasattr(stage, "angle") else stage.position()
    document = {"name": name, "value": reading.value, "unit": reading.unit}
    print_outcome(document, f"{name}: {reading.value:g} {reading.unit}", as_json=as_json)


@contextmanager
def _stages(path: Path, wire_log: Path | None) -> Iterator[dict[str, Any]]:
    """The stages of a rig, in our hands; what ends the command stops them."""
    rig = Rig(read_rig(path).with_wire_log(wire_log))
    with in_charge(rig):
        if rig.found_moving:
            tell(f"{', '.join(rig.found_moving)}: moved already, was stopped first")
        yield {stage.name: stage for stage in (*rig.by_role("rotation"), *rig.by_role("linear"))}


def _stage(stages: dict[str, Any], name: str, rig: Path) -> Any:
    if name not in stages:
        raise ConfigError(f"{rig}: no stage '{name}'; there are {', '.join(stages) or 'none'}")
    return stages[name]
