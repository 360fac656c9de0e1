"""The noise of the two chains: of noise records, of the recording's constants, else that of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.recording import Header, RunSource
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.noise_fit import NoiseFit, fit_noise
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, constant
from rigctl.experiments.rotating_platform.observe.spectrum import NoiseSpectrum, noise_spectrum
from rigctl.experiments.rotating_platform.observe.store_reduction import column_of, records_of
from rigctl.experiments.rotating_platform.result.alignment import Value

_LONGEST = 1 << 22


@dataclass(frozen=True)
class NoiseRecord:
    """The spectrum of a noise record in one channel, two-sided, [V2/Hz], and what is fitted to it."""

    run_id: str
    channel: str
    spectrum: NoiseSpectrum
    fit: NoiseFit

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        noise, sigmas = self.fit.noise, self.fit.sigmas
        names = ("white_v2_hz", "coefficient_v2_hz", "exponent", "pendulum_v2_hz")
        values = (noise.white, noise.coefficient, noise.exponent, self.fit.pendulum)
        fitted = {name: Value(*each).as_json() for name, *each in zip(names, values, sigmas, strict=True)}
        return {"run_id": self.run_id, "channel": self.channel, **fitted}


def noise_records(source: RunSource) -> tuple[list[NoiseRecord], dict[str, str]]:
    """The spectra of all noise records, and by run_id why one has none."""
    records, left_out = [], {}
    for record in records_of(source, "noise"):
        rate_hz = float(record.conditions["sample_rate_hz"])
        for channel in CHANNELS:
            # Days at 10 Hz: enough for any power law, and a transform that fits into memory.
            samples = column_of(source, record.run_id, READINGS[channel])[:_LONGEST]
            try:
                spectrum = noise_spectrum(samples, rate_hz)
                records.append(NoiseRecord(record.run_id, channel, spectrum, fit_noise(spectrum)))
            except DataError as error:
                left_out[record.run_id] = f"run {record.run_id}: {error}"
    return records, left_out


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


EQUATION_1 = "eq. 1, Q-Flex"
AS_PRINTED = ChainNoise(Q_FLEX_NOISE_V, EQUATION_1)
"""Of a chain of which nothing else is known."""


def chain_noise(header: Header, records: Sequence[NoiseRecord]) -> Mapping[str, ChainNoise]:
    """By channel: of the last noise record that shows white noise and power law, else of the constants, else eq. 1.

    Raises `DataError` where the constants name a noise in part.
    """
    return {channel: _of_channel(header, records, channel) for channel in CHANNELS}


def _of_channel(header: Header, records: Sequence[NoiseRecord], channel: str) -> ChainNoise:
    # The last one is nearest to the chain as it is now.
    for record in reversed(records):
        if record.channel == channel and np.isfinite(record.fit.sigmas[:3]).all():
            return ChainNoise(record.fit.noise, f"noise record {record.run_id}")
    column = READINGS[channel].removesuffix("_v")
    names = [f"noise_{part}_{column}" for part in ("white", "coefficient", "exponent")]
    values = [constant(header, name) for name in names]
    if all(value is None for value in values):
        return AS_PRINTED
    known = [value for value in values if value is not None and value > 0.0]
    if len(known) < len(names) or not known[2] < 3.0:
        raise DataError(
            f"[constants] of the recording: {', '.join(names)} go together, are positive and the exponent is below 3"
        )
    return ChainNoise(PowerLawNoise(*known), "constants")
