"""PIPython, the maker's own, on a controller with GCS 2.0."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from pipython import GCSError, pitools
from pipython.pidevice.gcs2.gcs2commands import GCS2Commands
from pipython.pidevice.gcsmessages import GCSMessages
from pipython.pidevice.interfaces.piserial import PISerial

from simulators.motion import MotionAxis
from simulators.pi_gcs2 import SimulatedGcs2
from tests.clients.conftest import Serve

AXIS = "1"
OUT_OF_LIMITS = 7


@pytest.fixture
def controller(serve: Serve) -> Iterator[Any]:
    address = serve(lambda clock: SimulatedGcs2(clock, MotionAxis()), "serial")
    with PISerial(address.device, address.baud) as line:
        yield GCS2Commands(GCSMessages(line))


def test_a_stage_is_started_up_and_moved(controller: Any) -> None:
    assert controller.qIDN().startswith("(c)2021 Physik Instrumente")
    assert (controller.axes, controller.allaxes) == ([AXIS], [AXIS])
    assert controller.IsControllerReady()
    pitools.startup(controller, refmodes="FRF")
    assert controller.qFRF(AXIS)[AXIS]
    controller.VEL(AXIS, 20.0)
    controller.MOV(AXIS, 3.0)
    pitools.waitontarget(controller, AXIS, timeout=20.0)
    assert controller.qPOS(AXIS)[AXIS] == pytest.approx(3.0, abs=1e-3)
    controller.MVR(AXIS, -1.5)
    pitools.waitontarget(controller, AXIS, timeout=20.0)
    assert controller.qPOS(AXIS)[AXIS] == pytest.approx(1.5, abs=1e-3)


def test_its_errors_are_those_of_the_list_and_a_stop_ends_a_motion(controller: Any) -> None:
    pitools.startup(controller, refmodes="FRF")
    with pytest.raises(GCSError) as refused:
        controller.MOV(AXIS, 1000.0)
    assert refused.value.val == OUT_OF_LIMITS
    controller.MOV(AXIS, 170.0)
    assert controller.IsMoving(AXIS)[AXIS]
    pitools.stopall(controller)
    pitools.waitontarget(controller, AXIS, timeout=20.0)
    assert controller.qPOS(AXIS)[AXIS] < 170.0
