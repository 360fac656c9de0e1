"""A twin of the shipped rig for benchmarks: opened, in a scratch store, with a session to run procedures in."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from procedures.sensing_axis.bench import Bench
from procedures.sensing_axis.wiring import bench_of
from rigctl.campaign.recording import Header
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.store import Store
from rigctl.files.rig_file import RigFile, read_rig
from rigctl.rig import Rig

CAMPAIGNS = Path(__file__).parent.parent / "campaigns"


@dataclass
class Twin:
    """An open twin."""

    rig: Rig
    bench: Bench
    session: Session
    store: Store


@contextmanager
def twin(seed: int, file: RigFile | None = None) -> Iterator[Twin]:
    """The shipped rig, or another one, with another nature, homed and ready."""
    file = file or read_rig(CAMPAIGNS / "isa-rig.toml")
    with tempfile.TemporaryDirectory() as scratch, Rig(file, seed=seed) as rig:
        bench = bench_of(rig)
        with Store.create(Path(scratch) / "twin.rig.sqlite", Header("sensing-axis")) as store:
            control = Control(rig.stop, bench.rest)
            session = Session(store, rig.clock, Operator(rig.operator_link), control, Progress(store))
            bench.prepare()
            yield Twin(rig, bench, session, store)
