"""What every command takes and how it answers."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.core.errors import ConfigError
from rigctl.core.numbers import decimal

if TYPE_CHECKING:
    from rigctl.core.workers import Workers

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
StoreFile = Annotated[Path, typer.Argument(metavar="STORE", help="A campaign file, by convention *.rig.sqlite.")]
RigToml = Annotated[Path, typer.Argument(metavar="RIG.toml", help="A rig file.")]
CampaignToml = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="A campaign file.")]
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help="A file with effects of your own.")
]
Unchecked = Annotated[
    bool, typer.Option("--unchecked", help="Move real instruments that `rigctl check` has not passed.")
]
WireLog = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Log every byte of every instrument to a file in DIR.")
]

Processes = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=0, max=1024, help="So many processes of this machine; 0: one for each core."
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="The workers of a dask scheduler instead.")
]


def workers_of(processes: int | None, scheduler: str | None) -> Workers | None:
    """Who is to do the work of a command; None where nothing is said. `ConfigError` where both are given."""
    if processes is not None and scheduler:
        raise ConfigError("--workers counts processes of this machine, --scheduler names another's: leave one out")
    from rigctl.core.workers import Workers  # multiprocessing, which the help of all commands does not need

    return None if processes is None and not scheduler else Workers(processes or 0, scheduler or "")


def number(text: str | float) -> float:
    """A number of a command line, in plain decimal digits; a usage error otherwise. Defaults are numbers already."""
    try:
        return decimal(str(text).strip())
    except ValueError as expected:
        raise typer.BadParameter(f"{text!r}; write {expected}") from None


def words(text: str) -> str:
    """Text of a command line that a store can have; a usage error where the terminal writes in another encoding."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise typer.BadParameter(f"{text!r} is no UTF-8; set the terminal to it, or write plain letters") from None
    return text


def print_json(document: object) -> None:
    """One document on stdout; JSON has no NaN, so what is not finite is null."""
    # Paths and dates go as text.
    print(json.dumps(_plain(document), allow_nan=False, default=str))  # noqa: T201


def print_outcome(document: object, text: str, *, as_json: bool) -> None:
    """What came of a command, as a document or in words."""
    if as_json:
        print_json(document)
    else:
        say(text)


def say(text: str) -> None:
    """A line on stdout."""
    print(text)  # noqa: T201


def tell(text: str) -> None:
    """Progress, for whoever watches; a terminal that went away is no reason to stop."""
    try:
        print(text, file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        return


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if hasattr(value, "tolist"):  # numpy's, which a command that needs none does not import
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
