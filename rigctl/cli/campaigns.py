"""Commands that run a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl import results, runner
from rigctl.campaign.session import requests
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.cli.io import (
    CampaignToml,
    Json,
    Plugins,
    Processes,
    Scheduler,
    StoreFile,
    Unchecked,
    WireLog,
    print_json,
    say,
    tell,
    workers_of,
)
from rigctl.cli.steering import ask
from rigctl.core.errors import ConfigError, DataError, ProcedureError, RigError, StorageError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.report.progress_bar import ProgressBar

app = typer.Typer()


@app.command()
def run(
    campaign: CampaignToml,
    rig: Annotated[Path | None, typer.Option(metavar="RIG.toml", help="Use this rig instead.")] = None,
    store: Annotated[
        Path | None, typer.Option(metavar="STORE", help="Where to keep everything; default NAME.rig.sqlite.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Seed of a simulated world.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    dry: Annotated[bool, typer.Option("--dry-run", help="Check and tell what would be done.")] = False,
    unchecked: Unchecked = False,
    plugin: Plugins = None,
    wire_log: WireLog = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Run a campaign from start to result."""
    campaign_file, by = read_campaign(campaign), workers_of(workers, scheduler)
    path = store or Path(campaign.stem + ".rig.sqlite")
    plugins = tuple(plugin or ())
    # With `mounting = "same"` the store is meant to be there, and is gone on with.
    extended = path.exists() and not dry and campaign_file.goes_on
    if extended and (rig is not None or seed is not None):
        raise ConfigError(f"{path} goes on with the rig and the seed it was made with; leave out --rig and --seed")
    if not extended and rig is None and not campaign_file.rig:
        raise ConfigError(f"{campaign}: rig is missing; name the rig file or pass --rig")
    if dry:
        plan = runner.dry_run(campaign_file, read_rig(rig or campaign_file.rig_path), plugins, by)
        if as_json:
            print_json(plan)
        else:
            for key, value in plan.items():
                say(f"{key}: {', '.join(map(str, value)) if isinstance(value, list) else value}")
        return
    with ProgressBar() as bar:
        options = runner.Options(
            unattended=yes,
            seed=seed,
            display=bar,
            plugins=plugins,
            wire_log=wire_log,
            unchecked=unchecked,
            workers=by,
        )
        if extended:
            runner.extend(path, campaign_file, options)
        else:
            runner.start(campaign_file, read_rig(rig or campaign_file.rig_path), path, options)
    _show_outcome(path, plugins, as_json=as_json)


@app.command()
def resume(
    store: StoreFile,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    plugin: Plugins = None,
    wire_log: WireLog = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Go on with a paused or an interrupted campaign."""
    by = workers_of(workers, scheduler)
    if requests.is_running(store):
        if by is not None:
            raise ConfigError(f"{store} is running and keeps its workers; leave out --workers and --scheduler")
        try:
            ask(store, "resume", as_json=as_json)
        except RigError:
            if requests.is_running(store):  # otherwise it has ended just now, by a kill for instance
                raise
        else:
            return
    with Store.open(store, readonly=True) as opened:
        unattended = yes or bool(opened.header.extra.get("unattended"))
    plugins = tuple(plugin or ())
    with ProgressBar() as bar:
        options = runner.Options(unattended=unattended, display=bar, plugins=plugins, wire_log=wire_log, workers=by)
        runner.resume(store, options)
    _show_outcome(store, plugins, as_json=as_json)


def _show_outcome(store: Path, plugins: tuple[Path, ...], *, as_json: bool) -> None:
    try:
        document = results.of(store, plugins, keep=True)
    except StorageError:
        raise
    except (ProcedureError, DataError) as error:  # what was measured need not determine a model, or tell its noise
        tell(f"{store}: no result yet: {error}")
        if as_json:
            print_json({"store": str(store), "status": status_of(store), "result": None})
        return
    if as_json:
        print_json({"store": str(store), "status": status_of(store), "result": document})
        return
    # The budget is long, and `rigctl result` shows it.
    results.show(store, {**document, "budget": {}})
    more = f"; `rigctl result {store}` shows the uncertainty budget, `rigctl report` the figures"
    say(f"store: {store}{more if document.get('axes') else ''}")
