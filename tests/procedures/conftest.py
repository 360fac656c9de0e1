"""A twin of the shipped rig, open, with a session in a scratch store."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from procedures.sensing_axis.bench import Bench
from procedures.sensing_axis.wiring import bench_of
from rigctl.campaign.recording import Header
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.store import Store
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig

RIG = Path(__file__).parents[2] / "campaigns" / "isa-rig.toml"


@dataclass
class Twin:
    rig: Rig
    bench: Bench
    session: Session
    store: Store

    @property
    def theta0_deg(self) -> float:
        """Nature's null of what is mounted."""
        assert self.rig.simulation is not None
        mounted: Any = self.rig.simulation.world.truth()["mountings"]
        return float(mounted[-1]["theta0_deg"])


@pytest.fixture
def make_twin(tmp_path: Path) -> Iterator[Callable[..., Twin]]:
    numbers = itertools.count(1)
    with ExitStack() as stack:

        def make(
            seed: int = 1,
            effects: dict[str, dict[str, float]] | None = None,
            faults: Mapping[str, dict[str, Any]] = MappingProxyType({}),
            **world: Any,
        ) -> Twin:
            file = read_rig(RIG)
            instruments = {
                name: table.model_copy(update={"faults": faults.get(name, {})})
                for name, table in file.instruments.items()
            }
            assert file.world is not None
            nature = {**file.world, **world}
            if effects is not None:
                nature["effects"] = effects
            rig = stack.enter_context(
                Rig(file.model_copy(update={"world": nature, "instruments": instruments}), seed=seed)
            )
            bench = bench_of(rig)
            store = stack.enter_context(
                Store.create(tmp_path / f"{next(numbers)}.rig.sqlite", Header("sensing-axis"))
            )
            session = Session(
                store, rig.clock, Operator(rig.operator_link), Control(rig.stop, bench.rest), Progress(store)
            )
            bench.prepare()
            return Twin(rig, bench, session, store)

        yield make
