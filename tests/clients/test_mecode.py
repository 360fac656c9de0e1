"""The LK-G class of mecode (github.com/jminardi/mecode, `mecode/devices/keyence_profilometer.py`) on an LK-G3001.

It stores by `SW,CI` and ends its lines with CR LF, some of them twice. It was written for Python 2, whose strings
were bytes: its serial port is one that takes text here. RIGCTL_MECODE names a checkout.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import serial

from simulators.keyence_lkg import Lkg3001Settings, SimulatedLkg3001
from simulators.wiring import TriggerLine
from tests.clients.conftest import BAUD, Serve

CHECKOUT = os.environ.get("RIGCTL_MECODE")
pytestmark = pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_MECODE names no checkout of mecode")

WRITTEN_FOR = {
    "target": "by-output",
    "count_digits": 5,
    "cycle_digits": 1,
    "status_by_output": False,
    "values_repeat_output": False,
}
"""The reading of the manual that its class has."""


class TextSerial(serial.Serial):  # type: ignore[misc]
    """A port of Python 2."""

    def write(self, text: str) -> int:
        return int(super().write(text.encode("ascii")))

    def read(self, size: int = 1) -> str:
        return bytes(super().read(size)).decode("ascii") if size else ""


@pytest.fixture
def laser(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    heads = [lambda t: np.full_like(t, 1.25), lambda t: np.full_like(t, 20.0)]
    settings = Lkg3001Settings.model_validate({"dialect": WRITTEN_FOR})
    address = serve(lambda clock: SimulatedLkg3001(clock, heads, TriggerLine(), settings), "serial")
    # The package itself draws and controls printers.
    package = ModuleType("mecode")
    package.__path__ = [f"{CHECKOUT}/mecode"]
    monkeypatch.setitem(sys.modules, "mecode", package)
    base = importlib.import_module("mecode.devices.base_serial_device")
    monkeypatch.setattr(base, "serial", SimpleNamespace(Serial=TextSerial))
    made = importlib.import_module("mecode.devices.keyence_profilometer").KeyenceProfilometer(address.device, BAUD)
    yield made
    made.disconnect()


def test_it_measures(laser: Any) -> None:
    assert laser.read() == 1.25


def test_it_stores_and_reads_what_was_stored(laser: Any) -> None:
    assert laser.set_sampling_rate(5) == "SW,CA"
    assert laser.set_num_points(200) == "SW,CI"
    assert laser.init() == "AQ"
    assert laser.start() == "AS"
    until_s = time.monotonic() + 20.0
    while not laser.accumulation_status().startswith("AN,0"):
        assert time.monotonic() < until_s
    assert laser.accumulation_status() == "AN,0,0000200,0000000"
    assert laser.collect_data() == ",".join(["AO", *["+01.2500"] * 200])
    assert laser.stop() == "AP"
