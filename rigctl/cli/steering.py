"""Commands that say how a campaign stands, steer it and judge its runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.cli.io import Json, StoreFile, print_outcome, tell, words
from rigctl.core.errors import ConfigError
from rigctl.report.quantities import duration
from rigctl.report.status_lines import status_lines

if TYPE_CHECKING:
    from rigctl.campaign.session.requests import Request

app = typer.Typer()


@app.command()
def pause(store: StoreFile, as_json: Json = False) -> None:
    """Ask a running campaign to hold after the run it is in."""
    ask(store, "pause", as_json=as_json)


@app.command()
def abort(store: StoreFile, as_json: Json = False) -> None:
    """Stop a running campaign now; what is recorded stays and can be resumed."""
    ask(store, "abort", as_json=as_json)


@app.command()
def answer(
    store: StoreFile,
    text: Annotated[str, typer.Argument(metavar="TEXT", parser=words, help="done or abort; yes or no.")],
    as_json: Json = False,
) -> None:
    """Answer what a running campaign asks the operator."""
    from rigctl.campaign.session import requests  # sockets and locks, which how far a campaign is does not need

    question = requests.answer(store, text).text
    print_outcome({"question": question, "answer": text}, f"{question.strip()} {text}", as_json=as_json)


def ask(store: Path, kind: Request, *, as_json: bool) -> None:
    """Have a running campaign pause, go on or end."""
    from rigctl.campaign.session import requests
    from rigctl.campaign.session.heartbeat import STALLED_S, beat_age_s

    requests.request(store, kind)
    age_s = beat_age_s(store)
    if age_s is not None and age_s > STALLED_S:
        tell(
            f"{store}: its process has given no sign of life for {duration(age_s)}, and obeys once it goes on; "
            "`rigctl stop RIG` stops the rig now"
        )
    print_outcome({"requested": kind}, f"asked the campaign to {kind}", as_json=as_json)


@app.command()
def status(store: StoreFile, as_json: Json = False) -> None:
    """How far a campaign is."""
    tell_if_unchecked(store)
    found = status_of(store)
    print_outcome(found, "\n".join(status_lines(found)), as_json=as_json)


def tell_if_unchecked(store: Path) -> None:
    """A line on stderr when a store has no checksums yet, so that damage in it cannot be seen."""
    with Store.open(store, readonly=True) as opened:
        if not opened.has_checksums:
            tell(f"{store}: made before checksums were kept; it gets them when it is next opened for writing")


@app.command()
def mark(
    store: StoreFile,
    run_id: Annotated[str, typer.Argument(metavar="RUN", parser=words)],
    reason: Annotated[str, typer.Argument(metavar="REASON", parser=words)],
    valid: Annotated[bool, typer.Option("--valid", help="Use the run.")] = False,
    invalid: Annotated[bool, typer.Option("--invalid", help="Leave the run out.")] = False,
    as_json: Json = False,
) -> None:
    """Declare a run valid or invalid, with the reason."""
    if valid == invalid:
        raise ConfigError("mark: give --valid or --invalid, one of the two")
    if not reason.strip():
        raise ConfigError("mark: REASON is empty; say why, for whoever reads the result")
    with Store.open(store) as opened:
        opened.mark(run_id, valid, reason)
    text = f"run {run_id} is {'valid' if valid else 'invalid'}: {reason}"
    print_outcome({"run_id": run_id, "valid": valid, "reason": reason}, text, as_json=as_json)
