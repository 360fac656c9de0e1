"""A look through a run's samples as bytes, for the store."""

from __future__ import annotations

import io
import json
from dataclasses import asdict

import numpy as np

from rigctl.experiments.inflight.observe.samples import Peak, Pulses, RunScan


def scan_to_bytes(found: RunScan) -> bytes:
    """Everything."""
    head = {
        "run_id": found.run_id,
        "trials": found.pulses.trials,
        "peak": None if found.peak is None else asdict(found.peak),
    }
    made = io.BytesIO()
    np.savez(
        made,
        head=np.frombuffer(json.dumps(head).encode(), dtype=np.uint8),
        at_s=found.pulses.at_s,
        amplitude=found.pulses.amplitude,
        sigma=found.pulses.sigma,
        levels=found.levels,
        level_at_s=found.level_at_s,
    )
    return made.getvalue()


def scan_from_bytes(data: bytes) -> RunScan:
    """What `scan_to_bytes` was given."""
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        head = json.loads(bytes(arrays["head"]))
        pulses = Pulses(arrays["at_s"], arrays["amplitude"], arrays["sigma"], head["trials"])
        peak = None if head["peak"] is None else Peak(**head["peak"])
        return RunScan(head["run_id"], pulses, peak, arrays["levels"], arrays["level_at_s"])
