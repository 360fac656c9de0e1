"""Reports on many stores, each written on its own by whichever worker is free: `rigctl report STORE STORE ...`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.composition import opened_workbench
from rigctl.core.errors import ConfigError, RigError
from rigctl.core.workers import Workers, in_order, outcomes_of
from rigctl.report.document import write_report
from rigctl.report.time_left import Pace

SUFFIX = ".rig.sqlite"


@dataclass(frozen=True)
class Wanted:
    """The report on one store: where its page and its figures go, and files with effects of one's own."""

    store: Path
    page: Path | None
    figures: Path | None
    plugins: tuple[Path, ...]

    def __str__(self) -> str:
        return str(self.store)


@dataclass(frozen=True)
class Written:
    """What was written of a store, or why its report could not be made."""

    store: Path
    files: tuple[Path, ...] = ()
    failed: str = ""


def write_reports(
    stores: Sequence[Path],
    out: Path | None,
    figures: Path | None,
    plugins: Sequence[Path],
    workers: Workers,
    tell: Callable[[str], None],
) -> list[Written]:
    """A page `out/NAME.html` and figures in `figures/NAME` of each store in turn, NAME its file without suffix.

    One that cannot be reported keeps nobody from the others. `ConfigError` where two have one name.
    """
    wanted = [
        Wanted(
            store.resolve(),
            out.resolve() / f"{name}.html" if out else None,
            figures.resolve() / name if figures else None,
            tuple(path.resolve() for path in plugins),
        )
        for name, store in _named(stores).items()
    ]
    for directory in (out, figures):
        if directory:
            _made(directory)
    pace, written = Pace("reported", tell), []
    with outcomes_of(_written, wanted, workers) as outcomes:
        for each in in_order(outcomes):
            written.append(each)
            pace.reached(len(written), len(wanted))
    return written


def _named(stores: Sequence[Path]) -> Mapping[str, Path]:
    by_name: dict[str, Path] = {}
    for store in stores:
        name = store.name.removesuffix(SUFFIX)
        if name in by_name:
            raise ConfigError(
                f"{by_name[name]} and {store} would be one report, {name}; write them into two directories"
            )
        by_name[name] = store
    return by_name


def _made(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{directory}: no directory for reports can be made there: {error.strerror}") from None


def _written(wanted: Wanted) -> Written:
    try:
        with opened_workbench(wanted.store, wanted.plugins) as workbench:
            files = write_report(workbench, wanted.page, wanted.figures, lambda _: None)
    except RigError as error:
        return Written(wanted.store, failed=str(error))
    return Written(wanted.store, tuple(files))
