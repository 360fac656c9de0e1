"""Commands that say what to measure next, and measure it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl import planning, runner
from rigctl.campaign.session.consent import consent
from rigctl.cli.io import CampaignToml, Json, Plugins, StoreFile, Unchecked, print_json, say, tell
from rigctl.composition import opened_workbench
from rigctl.core.making_safe import ended_by_signals
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.investigate import Settings
from rigctl.investigate import investigate as carry_out
from rigctl.report.progress_bar import ProgressBar
from rigctl.report.terminal_workbench import print_outcome, print_recommendation

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
    with opened_workbench(store, plugin or ()) as workbench:
        recommendation = workbench.recommend(tell) if write is None else planning.write_next(workbench, write, tell)
    if as_json:
        print_json({**recommendation.as_json(), "written": None if write is None else str(write)})
        return
    print_recommendation(recommendation.as_json())
    if write is not None:
        plugin_options = "".join(f" --plugin {path}" for path in plugin or ())
        into = store if read_campaign(write).goes_on else write.with_suffix(".rig.sqlite")
        say(f"written: {write}; measure it with `rigctl run {write} --store {into}{plugin_options}`")


@app.command()
def investigate(
    campaign: CampaignToml,
    store: Annotated[
        Path, typer.Option(metavar="STORE", help="Where to keep everything; goes on with one that is there.")
    ],
    max_runs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="At most so many runs; default: those of a full scan.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Add what is found; the simulated operator answers.")] = False,
    unchecked: Unchecked = False,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Measure, diagnose, ask, add, measure again, until the model is adequate or it is said what remains."""
    campaign_file = read_campaign(campaign)
    # A store that is there has its rig file in it.
    rig_file = read_rig(campaign_file.rig_path) if campaign_file.rig and not store.exists() else None
    with ProgressBar() as bar:
        options = runner.Options(unattended=yes, display=bar, plugins=tuple(plugin or ()), unchecked=unchecked)
        agree = (lambda *_: True) if yes else consent
        settings = Settings(options, agree, tell, max_runs=max_runs)
        # Between its campaigns nothing moves: a signal may interrupt a computation at once. Campaigns take over
        # while they run.
        with ended_by_signals(lambda _: None, campaign_file.on_terminal_lost, leave_s=0.0):
            outcome = carry_out(campaign_file, rig_file, store, settings).as_json()
    if as_json:
        print_json({"store": str(store), **outcome})
    else:
        print_outcome(outcome, str(store))
