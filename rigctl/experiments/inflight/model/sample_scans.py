"""Every run's samples looked through once, and kept in the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rigctl.analysis.kept import Packed
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.residual_samples import Peak, Pulses, RunScan, scan
from rigctl.experiments.inflight.observe.pulses import without_pulses
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.store_reduction import kept_by


def run_scans(
    source: RunSource, runs: Sequence[ReducedRun], values: FloatArray, pulses_s: Mapping[str, FloatArray]
) -> tuple[RunScan, ...]:
    """What the baseline at `values` leaves of all runs' samples, without those that pulses cover, looked through.

    Kept for just these runs and pulses.
    """
    names = " ".join(sorted(run.run_id for run in runs))
    kept = kept_by(source, "samples", names.encode() + b"".join(pulses.tobytes() for pulses in pulses_s.values()))

    def scanned(run: ReducedRun) -> RunScan:
        def make() -> Packed:
            samples = without_pulses(source.samples(run.run_id), pulses_s.get(run.run_id))
            return packed_scan(scan(run, samples, values))

        return kept.once(run.run_id, make, unpacked_scan)

    return tuple(map(scanned, runs))


def packed_scan(scan: RunScan) -> Packed:
    """Everything."""
    pulses = scan.pulses
    head = {"run_id": scan.run_id, "trials": pulses.trials, "peak": None if scan.peak is None else asdict(scan.peak)}
    arrays = {"at_s": pulses.at_s, "amplitude": pulses.amplitude, "sigma": pulses.sigma}
    return Packed(head, {**arrays, "levels": scan.levels, "level_at_s": scan.level_at_s})


def unpacked_scan(kept: Packed) -> RunScan:
    """What `packed_scan` was given."""
    head, arrays = kept.head, kept.arrays
    pulses = Pulses(arrays["at_s"], arrays["amplitude"], arrays["sigma"], head["trials"])
    peak = None if head["peak"] is None else Peak(**head["peak"])
    return RunScan(head["run_id"], pulses, peak, arrays["levels"], arrays["level_at_s"])
