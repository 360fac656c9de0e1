"""All stores below a directory, read one by one; results that no store keeps are worked out, by several workers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rigctl.core.errors import ConfigError, DataError, either
from rigctl.core.workers import HERE, Workers, in_order, outcomes_of
from rigctl.history.calibration import UNREADABLE, Calibration, NotListed, read_calibration, reason_of
from rigctl.history.kept_result import worked_out
from rigctl.report.quantities import counted
from rigctl.report.time_left import Pace

SUFFIX = ".rig.sqlite"

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Catalogue:
    """Finished calibrations below a directory, each with its result, and the stores that are none; by path."""

    directory: Path
    stores: int
    calibrations: tuple[Calibration, ...]
    not_listed: tuple[NotListed, ...]


def catalogue_of(
    directory: Path,
    serial: str | None = None,
    plugins: Sequence[Path] = (),
    tell: Tell = lambda _: None,
    workers: Workers = HERE,
) -> Catalogue:
    """Every store below `directory`, or those of one item; what `workers` have to fit is told as it goes.

    `ConfigError` where that is no directory, `DataError` where no calibration is in it.
    """
    if not directory.is_dir():
        raise ConfigError(f"{directory}: no such directory; name one with stores (*{SUFFIX})")
    found = list(_stores(directory))
    paths = [each for each in found if isinstance(each, Path)]
    if not paths:
        raise DataError(f"{directory}: no stores (*{SUFFIX}) in it or below; name another directory")
    serials: set[str] = set()

    def wanted(of_item: str) -> bool:
        serials.add(of_item)
        return serial in (None, of_item)

    read = [*(each for each in found if isinstance(each, NotListed)), *(read_calibration(p, wanted) for p in paths)]
    listed = [each for each in read if isinstance(each, Calibration)]
    if serial is not None and not listed:
        known = f"there are {either(sorted(serials))}" if serials else "no store there says one"
        raise DataError(f"{directory}: no finished calibration of serial number {serial!r}; {known}")
    done = list(_with_results(listed, plugins, tell, workers))
    distinct = list(_distinct(each for each in done if isinstance(each, Calibration)))
    not_listed = [each for each in (*read, *done, *distinct) if isinstance(each, NotListed)]
    return Catalogue(
        directory,
        len(paths),
        tuple(each for each in distinct if isinstance(each, Calibration)),
        tuple(sorted(not_listed, key=lambda each: each.store)),
    )


def _stores(directory: Path) -> Iterator[Path | NotListed]:
    """The stores below a directory in order, and directories that cannot be read; links to directories are left."""
    failed: list[OSError] = []
    for place, directories, files in os.walk(directory, onerror=failed.append):
        directories.sort()
        yield from (Path(place) / name for name in sorted(files) if name.endswith(SUFFIX))
    yield from (NotListed(Path(each.filename), each.strerror or str(each)) for each in failed)


def _with_results(
    listed: Sequence[Calibration], plugins: Sequence[Path], tell: Tell, workers: Workers
) -> Iterator[Calibration | NotListed]:
    missing = [each for each in listed if each.result is None]
    if missing:
        tell(
            f"{counted(len(missing), 'result')} of {len(listed)} to be worked out, each as long as `rigctl result` "
            "takes; they are kept in their stores"
        )
    pace = Pace("worked out", tell)
    with outcomes_of(partial(_fitted, plugins=tuple(plugins)), missing, workers) as outcomes:
        fitted = enumerate(in_order(outcomes), 1)
        for each in listed:
            if each.result is not None:
                yield each
                continue
            done, worked_out = next(fitted)
            yield worked_out
            pace.reached(done, len(missing))


def _fitted(calibration: Calibration, plugins: Sequence[Path]) -> Calibration | NotListed:
    try:
        return replace(calibration, result=worked_out(calibration.store, plugins))
    except UNREADABLE as error:
        return NotListed(calibration.store, f"no result: {reason_of(error, calibration.store)}")


def _distinct(calibrations: Iterable[Calibration]) -> Iterator[Calibration | NotListed]:
    """A copy of a store is no second calibration, and would agree with the first all too well."""
    known: dict[object, Path] = {}
    for each in calibrations:
        assert each.result is not None
        values = tuple(quantity.value for quantity in each.result.quantities)
        first = known.setdefault((each.kind, each.started, values), each.store)
        yield each if first == each.store else NotListed(each.store, f"the same calibration as {first}")
