"""A store brought together with what its experiment declares: the workbench of every command, page and notebook."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from rigctl.campaign.store.place import can_be_written
from rigctl.campaign.store.store import Store
from rigctl.core.experiments import experiment_named
from rigctl.effects.plugins import Files, Plugin, paths_of
from rigctl.experiments.analysis import analysis_of
from rigctl.workbench.study import Allowed, Study
from rigctl.workbench.workbench import Workbench


def workbench_of(store: Store, plugins: Sequence[Path] = ()) -> Workbench:
    """A store with its study and the versions of its model; `plugins` are files with effects of one's own."""
    return Workbench(store, partial(study_of, store), plugins, partial(allowed_by_rig, store))


@contextmanager
def opened_workbench(store: Path | str, plugins: Files = (), *, readonly: bool | None = None) -> Iterator[Workbench]:
    """The workbench of the store at a path, which is closed at the end.

    By default it keeps what it works out where the store can be written; `readonly` False is for who changes it.
    """
    path = Path(store)
    with Store.open(path, readonly=not can_be_written(path) if readonly is None else readonly) as opened:
        yield workbench_of(opened, paths_of(plugins))


def study_of(store: Store, plugins: Sequence[Plugin] = ()) -> Study:
    """A store's runs as the workbench sees them, with what `plugins` add to the catalogue; `DataError`."""
    return analysis_of(store.header.experiment, store.path).study(store, plugins)


def allowed_by_rig(store: Store) -> Allowed | None:
    """Which proposals the rig that measured a store can carry out; None where nothing is known of that."""
    header = store.header
    if not experiment_named(header.experiment).campaign:
        return None
    # Procedures, drivers and simulators are a tenth of the time of `rigctl result`, which needs none.
    from procedures.campaigns import campaigns_of
    from rigctl.campaign.origin import rig_file_of
    from rigctl.rig import Rig

    measured_here = header.rig_toml is not None and header.campaign_toml is not None
    rig = Rig(rig_file_of(store), reachable=False) if measured_here else None
    return campaigns_of(header.experiment, store.path).allowed(store, rig)
