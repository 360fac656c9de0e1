"""Scans over the angle and flips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import PowerLawNoise, covariances
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, COMMANDS, READINGS, Chains
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED
from rigctl.experiments.rotating_platform.observe.store_reduction import column_of, records_of
from rigctl.experiments.rotating_platform.result.alignment import Axes, Fitted, angle_scan, axes, flip
from rigctl.experiments.rotating_platform.result.chain_noise import EQUATION_1, ChainNoise

_FEWEST = 8
_STRETCHES = 8
# A scan of more samples is worked out in means of some.
_MOST_SAMPLES = 1 << 14
# Of one over the record: what is slower is a level to it (as `run_noise`).
_BEYOND_RECORD = 0.2


@dataclass(frozen=True)
class Scan:
    """A scan: angles at which the platform rested [rad], mean readings by channel [m/s2], fits, and the two axes.

    `commanded_m_s2` is the tilt along Z that was commanded meanwhile.
    """

    run_id: str
    commanded_m_s2: float
    theta_rad: FloatArray
    readings_m_s2: dict[str, FloatArray]
    fits: dict[str, Fitted]
    axes: Axes

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        axes = {name: value.as_json() for name, value in vars(self.axes).items()}
        fits = {channel: fit.as_json() for channel, fit in self.fits.items()}
        return {"run_id": self.run_id, "commanded_z_m_s2": self.commanded_m_s2, **fits, **axes}


def scans(source: RunSource, chains: Chains, noises: Mapping[str, ChainNoise]) -> tuple[list[Scan], dict[str, str]]:
    """All scans of a recording, with the `noises` of the chains, and by run_id why one tells nothing."""
    scans_read, left_out = [], {}
    for record in records_of(source, "scan"):
        try:
            scans_read.append(_scan(source, record, chains, noises))
        except DataError as error:
            left_out[record.run_id] = f"run {record.run_id}: {error}"
    return scans_read, left_out


@dataclass(frozen=True)
class Flipped:
    """What turning a sensor over tells: of itself, and with the `amplifier` (None: not known) of its chain.

    Scale factors in V s2/m and electrical biases in V.
    """

    sensor: Fitted
    amplifier: float | None

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        chain = None if self.amplifier is None else self.sensor.as_json(self.amplifier)
        return {"sensor": self.sensor.as_json(), "chain": chain}


def flips(source: RunSource, chains: Chains) -> dict[str, Flipped]:
    """Scale factor and electrical bias of each sensor from flips, by channel; none without both directions."""
    records = records_of(source, "flip")
    signs = [float(record.conditions["g_sign"]) for record in records]
    if len(set(signs)) < 2:
        return {}
    flipped = {}
    for channel in CHANNELS:
        try:
            read = [_read(source, record.run_id, READINGS[channel]) for record in records]
            flipped[channel] = Flipped(_flip(signs, read, chains.g_m_s2), chains.amplifier.get(channel))
        except DataError:
            continue
    return flipped


def _flip(signs: Sequence[float], read: Sequence[FloatArray], g_m_s2: float) -> Fitted:
    """By the scatter within the readings, or by that between them where it is larger.

    Between three there is one degree of freedom, which by chance is next to nothing; between two there is none.
    """
    readings = np.array([samples.mean() for samples in read])
    within_v = np.sqrt(np.mean([_scatter(samples) ** 2 for samples in read]))
    # Readings that a resolution holds at one value have no scatter of their own.
    if len(read) > 2 and not within_v > 0.0:
        return flip(signs, readings, g_m_s2)
    by_readings = flip(signs, readings, g_m_s2, np.full(len(read), within_v))
    if len(read) == 2:
        return by_readings
    return max(by_readings, flip(signs, readings, g_m_s2), key=lambda fitted: fitted.sigma("bias_v"))


def _scan(source: RunSource, record: RunRecord, chains: Chains, noises: Mapping[str, ChainNoise]) -> Scan:
    samples = source.samples(record.run_id)
    if "theta_deg" not in samples:
        raise DataError("a scan needs the column theta_deg; add it")
    theta_rad = np.deg2rad(samples["theta_deg"])
    # A bundle may lack the flag: then the angle's steps tell.
    moving = samples.get("moving", np.concatenate([[0.0], np.abs(np.diff(theta_rad)) > 1e-6]))
    rests = (moving == 0.0) & np.isfinite(theta_rad)
    edges = np.flatnonzero(np.concatenate([[True], rests[1:] != rests[:-1]]))
    stops = np.append(edges[1:], theta_rad.size)
    read = np.all([np.isfinite(samples[READINGS[channel]]) for channel in CHANNELS], axis=0)
    at_rest = [slice(int(a), int(b)) for a, b in zip(edges, stops, strict=True) if rests[a]]
    dwells = [each for each in at_rest if np.count_nonzero(read[each]) >= _FEWEST]
    angles = np.array([float(theta_rad[each].mean()) for each in dwells])
    readings, fits = {}, {}
    densities = [noises[channel].noise.in_units_of(chains.gain_v_per_m_s2[channel]) for channel in CHANNELS]
    finite = [np.isfinite(samples[READINGS[channel]]) for channel in CHANNELS]
    noise = _covariances(finite, dwells, float(record.conditions["sample_rate_hz"]), densities)
    for channel, own in zip(CHANNELS, noise, strict=True):
        volts = samples[READINGS[channel]]
        readings[channel] = np.array([float(np.nanmean(volts[each])) for each in dwells])
        readings[channel] /= chains.gain_v_per_m_s2[channel]
        level_known = noises[channel].source != EQUATION_1
        fits[channel] = angle_scan(angles, readings[channel], own, level_known=level_known)
    return Scan(
        record.run_id, _commanded(samples, rests, record, chains), angles, readings, fits, axes(fits["y"], fits["z"])
    )


def _covariances(
    read: Sequence[BoolArray], dwells: Sequence[slice], rate_hz: float, densities: Sequence[PowerLawNoise]
) -> list[FloatArray]:
    """Covariances of the means of readings over `dwells` where there are samples, shape (dwells, dwells) each."""
    if all(np.array_equal(each, read[0]) for each in read):
        return _covariances_alike(read[0], dwells, rate_hz, densities)
    each_alone = (_covariances_alike(one, dwells, rate_hz, [own]) for one, own in zip(read, densities, strict=True))
    return [own for (own,) in each_alone]


def _covariances_alike(
    read: BoolArray, dwells: Sequence[slice], rate_hz: float, densities: Sequence[PowerLawNoise]
) -> list[FloatArray]:
    step = -(-read.size // _MOST_SAMPLES)
    weights = np.zeros((len(dwells), -(-read.size // step) * step))
    for row, each in zip(weights, dwells, strict=True):
        row[each] = read[each] / np.count_nonzero(read[each])
    coarse = weights.reshape(len(dwells), -1, step).sum(axis=2)
    from_hz = _BEYOND_RECORD * rate_hz / weights.shape[1]
    found = covariances(coarse, rate_hz / step, densities, sided=SIDED, from_hz=from_hz)
    return list(found[:, 0])


def _commanded(samples: Mapping[str, FloatArray], rests: BoolArray, record: RunRecord, chains: Chains) -> float:
    """The tilt along Z [m/s2] while the platform rested; the run's condition where no column has it."""
    command_v = samples.get(COMMANDS["z"])
    if command_v is None or not np.isfinite(command_v[rests]).any():
        level_v = float(record.conditions.get("v_z_v") or 0.0)
    else:
        level_v = float(np.nanmean(command_v[rests]))
    return level_v / chains.command_v_per_m_s2["z"]


def _read(source: RunSource, run_id: str, name: str) -> FloatArray:
    """The samples that there are; `DataError` when they are too few for a mean with its scatter."""
    column = column_of(source, run_id, name)
    samples = column[np.isfinite(column)]
    if len(samples) < _FEWEST * _STRETCHES:
        raise DataError(f"run {run_id} has {len(samples)} samples of {name}, too few; measure it again")
    return samples


def _scatter(samples: FloatArray) -> float:
    """Standard uncertainty of a mean from those of its stretches: what changes more slowly is not in it."""
    stretches = np.array_split(samples, _STRETCHES)
    return float(np.std([each.mean() for each in stretches], ddof=1)) / math.sqrt(_STRETCHES)
