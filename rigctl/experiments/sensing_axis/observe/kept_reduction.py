"""A reduced run as bytes: a JSON head with what has names, then its arrays, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.analysis.noise import Spectrum
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS
from rigctl.experiments.sensing_axis.observe.reduction import ReducedChannel, ReducedRun

_VALUES = HARMONICS + 1


def to_bytes(run: ReducedRun) -> bytes:
    """What cannot be read from runs.csv: everything but the conditions."""
    head = {
        "frequency_hz": run.frequency_hz,
        "duration_s": run.duration_s,
        "channels": [[name, each.noise.weight.size, each.lines.size] for name, each in run.channels.items()],
    }
    parts = [json.dumps(head).encode(), b"\n", run.motion_m.astype("<c16").tobytes()]
    for each in run.channels.values():
        parts += [array.astype("<c16").tobytes() for array in (each.value, each.lines)]
        parts += [array.astype("<f8").tobytes() for array in (each.variance_factor, each.floor)]
        noise = each.noise
        parts += [array.astype("<f4").tobytes() for array in (noise.frequency_hz, noise.psd, noise.weight)]
    return b"".join(parts)


def from_bytes(data: bytes, run_id: str, conditions: Mapping[str, Any]) -> ReducedRun:
    """The run that `to_bytes` was given, with the conditions it has now."""
    line, _, rest = data.partition(b"\n")
    head = json.loads(line)
    at = 0

    def take(kind: str, count: int) -> Any:
        nonlocal at
        array = np.frombuffer(rest, dtype=kind, count=count, offset=at)
        at += array.nbytes
        return array

    motion_m = take("<c16", HARMONICS).astype(np.complex128)
    channels = {}
    for name, bins, lines in head["channels"]:
        value, found = (take("<c16", count).astype(np.complex128) for count in (_VALUES, lines))
        factor, floor = (take("<f8", _VALUES).astype(np.float64) for _ in range(2))
        noise = Spectrum(*(take("<f4", bins).astype(np.float64) for _ in range(3)))
        channels[name] = ReducedChannel(value, noise, factor, floor, found)
    return ReducedRun(run_id, dict(conditions), head["frequency_hz"], head["duration_s"], motion_m, channels)
