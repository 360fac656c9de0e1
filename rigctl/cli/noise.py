"""The command that describes noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.analysis.stability.allan import TAUS
from rigctl.cli.io import Json, number, print_json, say, words
from rigctl.core.bounds import NoFile, open_regular
from rigctl.core.errors import ConfigError, DataError, either
from rigctl.report.figures.data import Plate, write_plates
from rigctl.report.figures.noise import noise_plates
from rigctl.report.tables.noise import noise_document, noise_tables
from rigctl.report.tables.result_table import print_tables
from rigctl.stability import Series, csv_series, noise_study, store_series

_SQLITE = b"SQLite format 3\0"

app = typer.Typer(add_completion=False)


@app.command()
def noise(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="A store, or a CSV file with a header.")],
    run: Annotated[
        list[str] | None,
        typer.Option(metavar="RUN", parser=words, help="A run of the store; default: the longest valid one."),
    ] = None,
    channel: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A channel or column; default: all that vary.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", parser=number, help="Sample rate of a CSV file.")
    ] = None,
    time: Annotated[
        str | None, typer.Option(metavar="NAME", help="Column of times in seconds of a CSV file; default: t_s.")
    ] = None,
    taus: Annotated[
        str, typer.Option(metavar="SPACING", help="Averaging times: octave or decade (1, 2, 5).")
    ] = "octave",
    confidence: Annotated[float, typer.Option(metavar="P", parser=number, help="Of the intervals.")] = 0.6827,
    above: Annotated[float, typer.Option(metavar="HZ", parser=number, help="Fit the density from here on.")] = 0.0,
    below: Annotated[
        float, typer.Option(metavar="HZ", parser=number, show_default="all", help="Fit the density up to here.")
    ] = 1e40,
    without_lines: Annotated[
        bool, typer.Option("--without-lines", help="Take steady sines out before the Allan family.")
    ] = False,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per figure.")] = None,
    as_json: Json = False,
) -> None:
    """Noise and stability of a channel: Allan family, spectral density, coefficients."""
    if taus not in TAUS:
        raise ConfigError(f"--taus {taus} is unknown; write {either(TAUS)}")
    if not 0.0 < confidence < 1.0:
        raise ConfigError(f"--confidence {confidence:g} is no probability; write one between 0 and 1")
    series = _series(source, run or (), channel or (), rate, time)
    documents: list[dict[str, Any]] = []
    plates: list[Plate[Any]] = []
    for each in series:
        study = noise_study(
            each, confidence=confidence, taus=taus, band_hz=(above, below), without_lines=without_lines
        )
        documents.append(noise_document(study))
        if not as_json:
            print_tables(noise_tables(study))
        if figures is not None:
            plates += noise_plates(study)
    written = _written(plates, figures)
    if as_json:
        print_json({"source": str(source), "series": documents, "written": written})
        return
    for path in written:
        say(path)


def _series(
    source: Path, runs: Sequence[str], channels: Sequence[str], rate: float | None, time: str | None
) -> Iterator[Series]:
    if _is_store(source):
        if rate is not None or time is not None:
            raise ConfigError("--rate and --time are for CSV files; a store knows its times")
        return store_series(source, runs, channels)
    if runs:
        raise ConfigError(f"--run is for stores, and {source} is none")
    return csv_series(source, channels, rate, time)


def _is_store(source: Path) -> bool:
    """By its first bytes, whatever its name."""
    try:
        with open_regular(source) as file:
            return file.read(len(_SQLITE)) == _SQLITE
    except NoFile as error:
        raise DataError(f"{source}: {error}") from error


def _written(plates: list[Plate[Any]], figures: Path | None) -> list[str]:
    return [] if figures is None else [str(path) for path in write_plates(plates, {}, figures)]
