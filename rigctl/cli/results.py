"""Commands that show what a store amounts to: the result, the report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, StoreFile, print_json, say
from rigctl.errors import ConfigError

app = typer.Typer()


@app.command()
def result(store: StoreFile, as_json: Json = False) -> None:
    """The sensing axes, the angles between them and their uncertainty."""
    _show_result(store, as_json=as_json)


def _show_result(store: Path, *, as_json: bool) -> None:
    from rigctl import results

    found = results.of(store)
    if as_json:
        print_json(found)
    else:
        results.show(store, found)


@app.command()
def report(
    store: StoreFile,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per figure.")] = None,
    as_json: Json = False,
) -> None:
    """Write the figures of a campaign."""
    if figures is None:
        raise ConfigError("nothing to write: pass --figures DIR")
    from rigctl import results

    written = [str(path) for path in results.figures(store, figures)]
    if as_json:
        print_json({"written": written})
    else:
        say("\n".join(written))
