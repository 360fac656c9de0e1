"""Kinds of events that more than one part of the program knows."""

from __future__ import annotations

FAULT, LOST, BACK = "fault", "instrument-lost", "instruments-back"
RUN_REPEATED, STEP_REPEATED = "run-repeated", "step-repeated"
RUN_ENDED = "run-ended"
"""Keeps when a run was over."""
IMPORTED = "import"
"""Keeps what was found in the bundle that a store was made from."""
TEMPERATURE_MISSED = "temperature-missed"
"""A thermometer failed or had no valid value; no run is given up for it."""
