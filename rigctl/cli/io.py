"""What every command takes and how it answers."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rigctl.workbench.workbench import Workbench

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
StoreFile = Annotated[Path, typer.Argument(metavar="STORE", help="A campaign file, by convention *.rig.sqlite.")]
RigToml = Annotated[Path, typer.Argument(metavar="RIG.toml", help="A rig file.")]
CampaignToml = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="A campaign file.")]
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help="A file with effects of your own.")
]


def number(text: str | float) -> float:
    """A number of a command line, in plain decimal digits; a usage error otherwise. Defaults are numbers already."""
    from rigctl.core.numbers import decimal

    try:
        return decimal(str(text).strip())
    except ValueError as expected:
        raise typer.BadParameter(f"{text!r}; write {expected}") from None


def print_json(document: object) -> None:
    """One document on stdout; JSON has no NaN, so what is not finite is null."""
    print(json.dumps(_plain(document), allow_nan=False, default=str))  # noqa: T201


def say(text: str) -> None:
    """A line on stdout."""
    print(text)  # noqa: T201


@contextmanager
def workbench(store: Path, plugins: Sequence[Path] | None) -> Iterator[Workbench]:
    """A store on the workbench, closed at the end."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        yield workbench_of(opened, plugins or ())


def tell_if_unchecked(store: Path) -> None:
    """A line on stderr when a store has no checksums yet, so that damage in it cannot be seen."""
    from rigctl.campaign.store.store import Store

    with Store.open(store, readonly=True) as opened:
        if not opened.has_checksums:
            tell(f"{store}: made before checksums were kept; it gets them when it is next opened for writing")


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
