"""The noise of the chains that are there: theory is made of it, not of the paper's sensor where another hangs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.recording import Header
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.noise import Q_FLEX_NOISE_V, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, constant
from rigctl.experiments.rotating_platform.result.bench_runs import NoiseRecord

EQUATION_1 = "eq. 1, Q-Flex"


@dataclass(frozen=True)
class ChainNoise:
    """Two-sided density at a chain's output [V2/Hz], and its `source`: a noise record, the constants or the paper."""

    noise: PowerLawNoise
    source: str

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        noise = self.noise
        values = {"white_v2_hz": noise.white, "coefficient_v2_hz": noise.coefficient, "exponent": noise.exponent}
        return {"source": self.source, **values}


def chain_noise(header: Header, records: Sequence[NoiseRecord]) -> Mapping[str, ChainNoise]:
    """By channel: of the last noise record that shows white noise and power law, else of the constants, else eq. 1.

    Raises `DataError` where the constants name a noise in part.
    """
    return {channel: _of_channel(header, records, channel) for channel in CHANNELS}


def _of_channel(header: Header, records: Sequence[NoiseRecord], channel: str) -> ChainNoise:
    for record in reversed(records):
        if record.channel == channel and np.isfinite(record.fit.sigmas[:3]).all():
            return ChainNoise(record.fit.noise, f"noise record {record.run_id}")
    column = READINGS[channel].removesuffix("_v")
    names = [f"noise_{part}_{column}" for part in ("white", "coefficient", "exponent")]
    values = [constant(header, name) for name in names]
    if all(value is None for value in values):
        return ChainNoise(Q_FLEX_NOISE_V, EQUATION_1)
    known = [value for value in values if value is not None and value > 0.0]
    if len(known) < len(names) or not known[2] < 3.0:
        raise DataError(
            f"[constants] of the recording: {', '.join(names)} go together, are positive and the exponent is below 3"
        )
    return ChainNoise(PowerLawNoise(*known), "constants")
