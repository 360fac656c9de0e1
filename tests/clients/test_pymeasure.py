"""PyMeasure's ESP300 on an ESP301."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from pymeasure.instruments.newport import ESP300

from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from tests.clients.conftest import Serve


@pytest.fixture
def controller(serve: Serve) -> Iterator[Any]:
    address = serve(lambda clock: SimulatedEsp301(clock, [MotionAxis(), MotionAxis(), MotionAxis()]), "serial")
    controller = ESP300(f"ASRL{address.device}::INSTR", visa_library="@py", baud_rate=19200)
    yield controller
    controller.adapter.close()


# It does not know whether the controller speaks SCPI, and says so to whoever looks on.
pytestmark = pytest.mark.filterwarnings("ignore:It is not known whether:FutureWarning")


def test_an_axis_is_enabled_homed_and_moved(controller: Any) -> None:
    controller.clear_errors()
    axis = controller.x
    assert not axis.enabled
    axis.enable()
    assert axis.enabled
    axis.home()
    axis.wait_for_stop(interval=0.01)
    axis.position = 2.5
    axis.wait_for_stop(interval=0.01)
    assert axis.position == pytest.approx(2.5, abs=1e-3)
    assert axis.units == "degree"
    assert axis.left_limit == pytest.approx(-170.0)
    assert controller.errors == []


def test_its_errors_are_those_of_the_list(controller: Any) -> None:
    controller.clear_errors()
    controller.x.position = 500.0
    errors = controller.errors
    assert errors
    controller.clear_errors()
    assert controller.errors == []
