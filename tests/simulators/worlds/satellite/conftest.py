"""Runs that several tests look at."""

from __future__ import annotations

import pytest

from tests.simulators.worlds.satellite.flights import Flown, fly, quiet


@pytest.fixture(scope="session")
def at_rest() -> Flown:
    """Ten orbits without a stimulus, sixteen draws."""
    return fly(quiet(), draws=tuple(range(16)))
