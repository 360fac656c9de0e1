"""Odemis' driver of the ESP301 (github.com/delmic/odemis, src/odemis/driver/npmc.py) on an ESP301.

It comes with a whole microscope and is in no package index: RIGCTL_ODEMIS names a checkout. What it asks of the rest
of Odemis, which needs that microscope, stands here.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from tests.clients.conftest import Serve

CHECKOUT = os.environ.get("RIGCTL_ODEMIS")
pytestmark = pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_ODEMIS names no checkout of Odemis")


class HwError(IOError):
    """The hardware says no."""


class Actuator:
    def __init__(self, name: str, role: str, axes: Any, **_: Any) -> None:
        self.name, self.role, self.axes, self._metadata = name, role, axes, dict[str, Any]()

    def _applyInversion(self, position: Any) -> Any:
        return dict(position)

    def terminate(self) -> None:
        pass


class VigilantAttribute:
    def __init__(self, value: Any, readonly: bool = False) -> None:
        self.value = self._value = value

    def _set_value(self, value: Any, force_write: bool = False) -> None:
        self.value = self._value = value

    def notify(self, value: Any) -> None:
        pass


class Executor(ThreadPoolExecutor):
    def submitf(self, future: Any, function: Any, *arguments: Any) -> Any:
        return self.submit(function, *arguments)

    def cancel(self) -> None:
        pass


class CancellableFuture(SimpleNamespace):
    pass


def module(name: str, **content: Any) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(content)
    return made


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    model = module(
        "odemis.model",
        HwError=HwError,
        Actuator=Actuator,
        VigilantAttribute=VigilantAttribute,
        Axis=lambda **described: SimpleNamespace(**described),
        CancellableFuture=CancellableFuture,
        CancellableThreadPoolExecutor=Executor,
        isasync=lambda function: function,
        MD_POS_COR="position correction",
        InstantaneousFuture=SimpleNamespace,
    )
    durations = module("odemis.util.driver", estimateMoveDuration=lambda *_: 1.0)
    util = module("odemis.util", driver=durations, to_str_escape=repr)
    for each in (module("odemis", model=model, util=util), model, util, durations):
        monkeypatch.setitem(sys.modules, each.__name__, each)
    assert CHECKOUT is not None
    spec = importlib.util.spec_from_file_location("npmc", Path(CHECKOUT) / "src/odemis/driver/npmc.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def stage(serve: Serve, driver: ModuleType) -> Iterator[Any]:
    address = serve(lambda clock: SimulatedEsp301(clock, [MotionAxis(), MotionAxis(), MotionAxis()]), "serial")
    axes = {"x": {"number": 1, "range": [-20.0, 20.0], "unit": "deg", "conv_factor": 1.0}}
    stage = driver.ESP("stage", "stage", address.device, axes)
    yield stage
    stage.terminate()


def await_rest(stage: Any, axis: int) -> None:
    asked = threading.Event()
    while not stage.GetMotionDone(axis):
        asked.wait(0.005)


def test_it_finds_the_controller_and_reads_its_axes(stage: Any) -> None:
    assert "ESP301" in stage._version.upper()
    assert stage.GetSpeed(1) > 0.0
    stage.checkError()


def test_it_moves_and_stops(stage: Any, driver: ModuleType) -> None:
    stage.HomeSearch(1, 1)
    await_rest(stage, 1)
    stage.MoveAbsPos(1, 2.5)
    await_rest(stage, 1)
    assert stage.GetPosition(1) == pytest.approx(2.5, abs=1e-3)
    stage.MoveAbsPos(1, 100.0)
    time.sleep(0.02)
    stage.StopMotion(1)
    await_rest(stage, 1)
    assert 2.5 < stage.GetPosition(1) < 100.0
    stage.checkError()
    stage.MoveAbsPos(1, 500.0)
    with pytest.raises(driver.ESPError):
        stage.checkError()
