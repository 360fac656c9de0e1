"""Commands that say what to measure next, and measure it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import CampaignToml, Json, Plugins, StoreFile, print_json, say, tell, workbench
from rigctl.errors import DataError

app = typer.Typer()


@app.command("next")
def next_(
    store: StoreFile,
    write: Annotated[
        Path | None, typer.Option(metavar="CAMPAIGN.toml", help="Write it as a campaign that `rigctl run` executes.")
    ] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """The measurement that best separates what is ambiguous, or most tightens the result."""
    from rigctl import planning
    from rigctl.report.terminal_planning import print_recommendation

    with workbench(store, plugin) as bench:
        if write is not None:
            planning.require_rig(bench.store)
        found = bench.recommend(planning.allowed_by(bench.store), tell)
        if write is not None:
            if not found.runs:
                raise DataError(f"{store}: there is nothing to write: {found.words}")
            effects = bench.current.effects
            text = planning.campaign_text(bench.store, found.runs, f"Next: {found.purpose}", write, effects)
            write.write_text(text, encoding="utf-8")
    if as_json:
        print_json({**found.as_json(), "written": None if write is None else str(write)})
        return
    print_recommendation(found.as_json())
    if write is not None:
        say(f"written: {write}; measure it with `rigctl run {write} --store {store}`")
