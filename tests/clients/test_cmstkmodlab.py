"""The LK-G class of the CMS tracker's module laboratory (github.com/DESY-FH-ELab/cmstkmodlab) on an LK-G3001.

C++ on a serial line, made here with g++ and a few lines that call it. RIGCTL_CMSTKMODLAB names a checkout.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from simulators.clock import ScaledClock
from simulators.keyence_lkg import SimulatedLkg3001
from simulators.wiring import TriggerLine
from tests.clients.conftest import Serve

CHECKOUT = os.environ.get("RIGCTL_CMSTKMODLAB")
pytestmark = [
    pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_CMSTKMODLAB names no checkout of cmstkmodlab"),
    pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++"),
]

# What it has of its mode is not set before its first `R0` succeeds, which a controller that measures refuses: zeroed
# memory stands for the luck that it has on their bench.
CALLS = """
#include <cstdio>
#include <new>
#include "Keyence.h"

alignas(Keyence) static unsigned char zeroed[sizeof(Keyence)];

int main(int, char **arguments)
{
    Keyence &laser = *new (zeroed) Keyence(arguments[1]);
    double before = 0, out_of_range = 0, after = 0;
    int program = -1;
    laser.MeasurementValueOutput(1, before);
    laser.MeasurementValueOutput(2, out_of_range);
    laser.SetSamplingRate(4);
    laser.SetAveraging(1, 2);
    laser.SetABLE(true, 2);
    laser.SetMaterialMode(1, 3);
    laser.SetDiffuseMode(1, 1);
    laser.PanelLock(1);
    laser.PanelLock(0);
    laser.Reset(1);
    laser.ProgramChange(3);
    laser.ProgramCheck(program);
    laser.MeasurementValueOutput(1, after);
    std::printf("%.4f %.0f %d %.4f\\n", before, out_of_range, program, after);
    return 0;
}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert CHECKOUT is not None
    directory = tmp_path_factory.mktemp("cmstkmodlab")
    (directory / "calls.cc").write_text(CALLS)
    theirs = Path(CHECKOUT) / "devices/Keyence"
    sources = [theirs / f"{name}.cpp" for name in ("Keyence", "VKeyence", "KeyenceComHandler")]
    made = directory / "calls"
    subprocess.run(["g++", "-w", f"-I{theirs}", "-o", made, directory / "calls.cc", *sources], check=True)
    return made


def test_it_measures_and_sets_up(serve: Serve, program: Path) -> None:
    # Beyond its range, output 2 says `+FFFFFFF`, for which their class has 9999.
    heads = [lambda t: np.full_like(t, 1.25), lambda t: np.full_like(t, 20.0)]
    served: list[SimulatedLkg3001] = []

    def build(clock: ScaledClock) -> SimulatedLkg3001:
        served.append(SimulatedLkg3001(clock, heads, TriggerLine()))
        return served[0]

    address = serve(build, "serial")
    done = subprocess.run([program, address.device], capture_output=True, text=True, timeout=60, check=True)
    *complaints, result = done.stdout.splitlines()
    # Its first R0 finds a controller that measures already.
    assert [line.rpartition(": ")[2] for line in complaints] == ["ER,R0,01"]
    assert result == "1.2500 9999 3 1.2500"
    registers = served[0].registers
    registers.program = 0
    assert registers.value("CA") == ("4",)
    assert [registers.value(*name, output=1) for name in (("OC",), ("HB",), ("HE",))] == [("0", "2"), ("3",), ("1",)]
    assert registers.value("HA", "M", output=2) == ("1",)
