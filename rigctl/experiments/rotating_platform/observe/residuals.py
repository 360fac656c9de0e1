"""What the kept samples of a run leave after every period's fit; zero where the platform moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.even_samples import COMMANDED, EvenSamples, filled
from rigctl.experiments.rotating_platform.observe.mask import usual_mask
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains

_SEGMENT = 1 << 18
_ROUNDING = 1e-24


@dataclass(frozen=True)
class ResidualBlock:
    """Whole periods of a run: `left` of the kept samples (samples,) by channel, their times, and the fits' basis."""

    left: Mapping[str, FloatArray]
    time_s: FloatArray
    kept: FloatArray
    basis: FloatArray
    whole: FloatArray

    def project(self, rows: FloatArray) -> FloatArray:
        """What the fits leave of further rows, shape (k, samples)."""
        periods = len(self.whole)
        table = rows.reshape(len(rows), periods, -1) * self.kept
        table = table - (table @ self.basis.T) @ self.basis
        return np.asarray((table * self.whole[:, None]).reshape(len(rows), -1))


def residual_blocks(chunks: Iterable[Columns], chains: Chains, cells: Cells) -> Iterator[ResidualBlock]:
    """What the fit of every period leaves, block by block; zero where the platform moves and in spoilt periods."""
    sampled = usual_mask(cells)
    sign, q = sampled.sign.astype(np.float64), cells.samples
    kept = np.abs(sign)
    line = np.stack([kept, kept * sampled.time_s, sign, sign * sampled.time_s])
    basis = np.linalg.qr(line.T)[0].T
    stream = EvenSamples(chains, cells.period_s, cells.sample_rate_hz)
    done = 0
    for last, chunk in _with_end(chunks):
        stream.take(chunk)
        periods = stream.length // q
        if not periods or (stream.length < _SEGMENT and not last):
            continue
        block = stream.block()[:, : periods * q]
        left: dict[str, FloatArray] = {}
        usable = np.ones((len(CHANNELS), periods))
        for number, channel in enumerate(CHANNELS):
            table = np.where(kept > 0.0, block[number].reshape(periods, q), 0.0)
            spoilt = np.any(cells.faults[done : done + periods, number], axis=1)
            spoilt |= ~np.isfinite(table).all(axis=1)
            usable[number] = ~spoilt
            table = np.where(spoilt[:, None], 0.0, table)
            left[channel] = (table - (table @ basis.T) @ basis).ravel()
            commanded = sign * filled(block[COMMANDED][number]).reshape(periods, q)
            commanded = np.where(spoilt[:, None], 0.0, commanded - (commanded @ basis.T) @ basis).ravel()
            size = float(commanded @ commanded)
            if size > _ROUNDING * periods * q:
                # What an external signal bends within a period is no noise.
                left[channel] = left[channel] - commanded * (float(commanded @ left[channel]) / size)
        whole = usable.min(axis=0)
        for channel in CHANNELS:
            left[channel] *= np.repeat(whole, q)
        index = np.arange(done * q, (done + periods) * q, dtype=np.float64)
        yield ResidualBlock(left, index / cells.sample_rate_hz, kept, basis, whole)
        stream.drop(periods * q)
        done += periods


def _with_end(chunks: Iterable[Columns]) -> Iterator[tuple[bool, Columns]]:
    """Chunks with word of which is the last."""
    before: Columns | None = None
    for chunk in chunks:
        if before is not None:
            yield False, before
        before = chunk
    if before is not None:
        yield True, before
