"""Commands that run a campaign, steer it and judge its runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.io import CampaignToml, Json, Plugins, StoreFile, print_json, say, tell, tell_if_unchecked
from rigctl.core.errors import ConfigError, DataError, ProcedureError, RigError

if TYPE_CHECKING:
    from rigctl.files.config import CampaignFile

app = typer.Typer()


@app.command()
def run(
    campaign: CampaignToml,
    rig: Annotated[Path | None, typer.Option(metavar="RIG.toml", help="Use this rig instead.")] = None,
    store: Annotated[Path | None, typer.Option(help="Where to keep everything; default NAME.rig.sqlite.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of a simulated world.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    dry: Annotated[bool, typer.Option("--dry-run", help="Check and tell what would be done.")] = False,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Run a campaign from start to result."""
    from rigctl import runner
    from rigctl.files import config

    campaign_file = config.read_campaign(campaign)
    path = store or Path(campaign.stem + ".rig.sqlite")
    plugins = tuple(plugin or ())
    if path.exists() and not dry and campaign_file.goes_on:
        if rig is not None or seed is not None:
            raise ConfigError(
                f"{path} goes on with the rig and the seed it was made with; leave out --rig and --seed"
            )
        _extend(path, campaign_file, plugins, yes=yes)
        _show_outcome(path, plugins, as_json=as_json)
        return
    if rig is None and not campaign_file.rig:
        raise ConfigError(f"{campaign}: rig is missing; name the rig file or pass --rig")
    rig_file = config.read_rig(rig or campaign_file.rig_path)
    if dry:
        plan = runner.dry_run(campaign_file, rig_file, plugins)
        if as_json:
            print_json(plan)
        else:
            for key, value in plan.items():
                say(f"{key}: {', '.join(map(str, value)) if isinstance(value, list) else value}")
        return
    from rigctl.report.terminal import ProgressBar

    with ProgressBar() as bar:
        options = runner.Options(unattended=yes, seed=seed, display=bar, plugins=plugins)
        runner.start(campaign_file, rig_file, path, options)
    _show_outcome(path, plugins, as_json=as_json)


def _extend(store: Path, campaign: CampaignFile, plugins: tuple[Path, ...], *, yes: bool) -> None:
    """Run a campaign that goes on in the mounting of a store that is there."""
    from rigctl import runner
    from rigctl.report.terminal import ProgressBar

    with ProgressBar() as bar:
        runner.extend(store, campaign, runner.Options(unattended=yes, display=bar, plugins=plugins))


@app.command()
def resume(
    store: StoreFile,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Go on with a paused or an interrupted campaign."""
    from rigctl import runner
    from rigctl.campaign.session.locks import is_held, store_lock
    from rigctl.campaign.store.store import Store

    if is_held(store_lock(store)):
        _request(store, "resume", as_json=as_json)
        return
    with Store.open(store, readonly=True) as opened:
        unattended = yes or bool(opened.header.extra.get("unattended"))
    from rigctl.report.terminal import ProgressBar

    plugins = tuple(plugin or ())
    with ProgressBar() as bar:
        runner.resume(store, runner.Options(unattended=unattended, display=bar, plugins=plugins))
    _show_outcome(store, plugins, as_json=as_json)


@app.command()
def pause(store: StoreFile, as_json: Json = False) -> None:
    """Ask a running campaign to hold after the run it is in."""
    _request(store, "pause", as_json=as_json)


@app.command()
def abort(store: StoreFile, as_json: Json = False) -> None:
    """Stop a running campaign now; what is recorded stays and can be resumed."""
    _request(store, "abort", as_json=as_json)


@app.command()
def answer(
    store: StoreFile,
    text: Annotated[str, typer.Argument(metavar="TEXT", help="done or abort; yes or no.")],
    as_json: Json = False,
) -> None:
    """Answer what a running campaign asks the operator."""
    from rigctl.campaign.session.locks import is_held, store_lock
    from rigctl.campaign.session.questions import answer as answer_to
    from rigctl.campaign.session.questions import open_question
    from rigctl.campaign.store.store import Store

    with Store.open(store) as opened:
        question = open_question(opened) if is_held(store_lock(store)) else None
        if question is None:
            raise RigError(f"{store}: nothing is being asked; `rigctl status` tells how far it is")
        answer_to(opened, question.number, text)
    if as_json:
        print_json({"question": question.text, "answer": text})
    else:
        say(f"{question.text.strip()} {text}")


def _request(store: Path, kind: str, *, as_json: bool) -> None:
    from rigctl.campaign.session.locks import is_held, store_lock
    from rigctl.campaign.store.store import Store

    with Store.open(store) as opened:
        if not is_held(store_lock(store)):
            raise RigError(f"{store}: no campaign is running on it; `rigctl status` tells how it ended")
        opened.add_request(kind)
    if as_json:
        print_json({"requested": kind})
    else:
        say(f"asked the campaign to {kind}")


@app.command()
def status(store: StoreFile, as_json: Json = False) -> None:
    """How far a campaign is."""
    from rigctl.campaign.status import status_of

    tell_if_unchecked(store)
    found = status_of(store)
    if as_json:
        print_json(found)
    else:
        from rigctl.report.terminal import print_status

        print_status(found)


def _show_outcome(store: Path, plugins: tuple[Path, ...], *, as_json: bool) -> None:
    from rigctl import results
    from rigctl.campaign.status import status_of

    try:
        found = results.of(store, plugins)
    except (ProcedureError, DataError) as error:  # what was measured need not determine a model, or tell its noise
        tell(f"{store}: no result yet: {error}")
        if as_json:
            print_json({"store": str(store), "status": status_of(store), "result": None})
        return
    if as_json:
        print_json({"store": str(store), "status": status_of(store), "result": found})
        return
    results.show(store, {**found, "budget": {}})
    more = f"; `rigctl result {store}` shows the uncertainty budget, `rigctl report` the figures"
    say(f"store: {store}{more if found.get('axes') else ''}")


@app.command()
def mark(
    store: StoreFile,
    run_id: Annotated[str, typer.Argument(metavar="RUN")],
    reason: Annotated[str, typer.Argument(metavar="REASON")],
    valid: Annotated[bool, typer.Option("--valid/--invalid", help="Use the run, or leave it out.")],
    as_json: Json = False,
) -> None:
    """Declare a run valid or invalid, with the reason."""
    from rigctl.campaign.store.store import Store

    with Store.open(store) as opened:
        opened.mark(run_id, valid, reason)
    if as_json:
        print_json({"run_id": run_id, "valid": valid, "reason": reason})
    else:
        say(f"run {run_id} is {'valid' if valid else 'invalid'}: {reason}")
