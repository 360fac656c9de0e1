"""Rig time of the null search against the Cramer-Rao bound, and what plain scans leave.

theta0 to 0.5 arcsec in one mounting: simulated seconds from the levelled package to the result, moves and settling
included, over the bound's acquisition time for the same noise and drive (roll, gain and resonance unknown to their
priors). Beside it the plain angle scan: minimum of |S| on the grid, and a line through the same grid.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

import numpy as np

from benchmarks.machine import machine
from benchmarks.twin import Twin, twin
from procedures.sensing_axis.bench import SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting
from procedures.sensing_axis.null_search import NullSearch, NullSearchSettings
from rigctl.analysis.plane import ARCSEC
from rigctl.campaign.recording import RunRecord
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run

TARGET_ARCSEC = 0.5
FREQUENCIES_HZ = (0.3, 0.5, 0.6)
AMPLITUDE_MM = 5.0
SAMPLE_RATE_HZ = 100.0
METER_V_RMS = 2e-5
SCAN_HALF_WIDTH_DEG = 0.05
SCAN_ANGLES = 11


def bound_s(twin: Twin, mounting: Mounting) -> float:
    """Least acquisition time for the target: Cramer-Rao, optimised over the shares of the frequencies.

    At the null the in-phase response is H(nu) (r g + w^2 (theta - theta0)): unknowns theta0, r (no prior), gain and
    resonance (priors of the package; they multiply a response that vanishes there, so they cost nothing). For two
    frequencies the least total time is (sqrt(n1) + sqrt(n2))^2 / (A (w1^2 - w2^2) sigma)^2, n the noise densities.
    """
    nature = twin.rig.simulation.nature
    sensor = nature.sensors[mounting.axis].response(mounting.configuration)

    def density(f: float) -> float:
        # The microseism's foot at these frequencies is left out: the bound is then a little too small, never too big.
        gain = sensor.gain_v_per_m_s2 / (1.0 - (f / sensor.frequency_hz) ** 2)
        return nature.ground.asd_m_s2_rthz**2 + METER_V_RMS**2 * 2.0 / SAMPLE_RATE_HZ / gain**2

    sigma = TARGET_ARCSEC * ARCSEC
    times = []
    for i, high in enumerate(FREQUENCIES_HZ):
        for low in FREQUENCIES_HZ[:i]:
            w2 = (2 * math.pi * high) ** 2 - (2 * math.pi * low) ** 2
            total = (math.sqrt(density(high)) + math.sqrt(density(low))) ** 2
            times.append(total / (1e-3 * AMPLITUDE_MM * w2 * sigma) ** 2)
    return min(times)


def true_theta0_rad(twin: Twin) -> float:
    """Nature's null angle of what is mounted now."""
    return math.radians(twin.rig.simulation.world.truth()["mountings"][-1]["theta0_deg"])


def search(seed: int, axis: str, configuration: str) -> dict[str, float]:
    """One null search: its time over the bound's, and its error."""
    with twin(seed) as t:
        mounting = Mounting(axis, configuration, 1)
        fixture = Fixture(t.session, t.bench)
        fixture.mount(mounting)
        effects = chosen("sensing-axis", ["roll-gravity", "resonance"])
        settings = NullSearchSettings(FREQUENCIES_HZ, AMPLITUDE_MM, SAMPLE_RATE_HZ, TARGET_ARCSEC)
        began_s = t.rig.clock.now_s()
        null = NullSearch(t.session, t.bench, fixture, mounting, settings, effects).find()
        used_s = t.rig.clock.now_s() - began_s
        acquired_s = sum(len(t.store.samples(run.run_id)["t_s"]) for run in t.store.runs()) / SAMPLE_RATE_HZ
        error = (null.theta0_rad - true_theta0_rad(t)) / ARCSEC
        return {
            "rig_s": used_s,
            "acquired_s": acquired_s,
            "ratio": used_s / bound_s(t, mounting),
            "bound_s": bound_s(t, mounting),
            "error_arcsec": error,
            "sigma_arcsec": null.theta0_sigma_rad / ARCSEC,
        }


def scan(seed: int, axis: str, configuration: str, dwell_s: float) -> dict[str, float]:
    """The plain scan about the (known) neighbourhood of the null, all frequencies."""
    with twin(seed) as t:
        mounting = Mounting(axis, configuration, 1)
        fixture = Fixture(t.session, t.bench)
        fixture.mount(mounting)
        truth = true_theta0_rad(t)
        # The operator knows the null to a grid step or so: the grid is not centred on it.
        offset = 0.3 * SCAN_HALF_WIDTH_DEG / (SCAN_ANGLES // 2)
        centre = round(math.degrees(truth) + offset, 4)
        angles = [round(centre + x, 4) for x in np.linspace(-SCAN_HALF_WIDTH_DEG, SCAN_HALF_WIDTH_DEG, SCAN_ANGLES)]

        def record(theta_deg: float) -> RunRecord:
            point = SetPoint(axis, configuration, 1, theta_deg, 0.6, AMPLITUDE_MM, dwell_s, SAMPLE_RATE_HZ)
            return t.bench.run(t.session, f"{theta_deg:g} deg", point, before=lambda: fixture.confirm(mounting))

        began_s = t.rig.clock.now_s()
        records = [record(theta_deg) for theta_deg in angles]
        used_s = t.rig.clock.now_s() - began_s
        runs = observables([reduce_run(r.run_id, r.conditions, t.store.samples(r.run_id)) for r in records])
        return {
            "rig_s": used_s,
            "minimum_arcsec": (minimum_of_modulus_rad(runs) - truth) / ARCSEC,
            "line_arcsec": (line_fit_rad(runs) - truth) / ARCSEC,
        }


def minimum_of_modulus_rad(runs: Sequence[RunObservables]) -> float:
    """The grid's angle with the smallest |S|: the plain reading.

    Roll displaces it by rho g / (A w^2), and it is no finer than the grid; it is what one does without a model.
    """
    ordered = sorted(runs, key=lambda run: run.theta_rad)
    theta = np.array([run.theta_rad for run in ordered])
    size = np.array([abs(run.accel_v.value[1]) for run in ordered])
    lowest = int(np.argmin(size))
    if not 0 < lowest < len(size) - 1:
        raise ValueError("the smallest |S| is at the edge of the scan: scan further out")
    return float(theta[lowest])


def line_fit_rad(runs: Sequence[RunObservables]) -> float:
    """Zero of a straight line through the signed in-phase amplitudes of one frequency: no roll in the model."""
    theta = np.array([run.theta_rad for run in runs])
    signed = np.array([run.accel_v.value[1].real for run in runs])
    slope, offset = np.polyfit(theta, signed, 1)
    return float(-offset / slope)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=24)
    arguments = parser.parse_args()
    cases = [(axis, c) for axis in "XYZ" for c in ("pendulum", "flag")]
    rows = [search(1000 + i, *cases[i % len(cases)]) for i in range(arguments.seeds)]
    ratio = np.array([row["ratio"] for row in rows])
    error = np.array([row["error_arcsec"] for row in rows])
    pull = error / np.array([row["sigma_arcsec"] for row in rows])
    print(machine())
    print(f"null search to {TARGET_ARCSEC} arcsec, {len(rows)} mountings")
    print(f"  bound          {np.mean([row['bound_s'] for row in rows]):7.1f} s acquisition")
    print(f"  acquired       {np.mean([row['acquired_s'] for row in rows]):7.1f} s")
    print(f"  rig time       {np.mean([row['rig_s'] for row in rows]):7.1f} s with moves and settling")
    print(f"  ratio          {ratio.mean():7.2f} mean, {ratio.max():.2f} worst")
    print(f"  error          {error.mean():+7.3f} +- {error.std(ddof=1) / math.sqrt(len(rows)):.3f} arcsec mean")
    print(f"  scatter        {error.std(ddof=1):7.3f} arcsec rms, pulls {pull.std(ddof=1):.2f}")
    scans = [scan(2000 + i, *cases[i], dwell_s=20.0) for i in range(len(cases))]
    print(f"plain scan, {SCAN_ANGLES} angles over +-{SCAN_HALF_WIDTH_DEG} deg at 0.6 Hz, {len(scans)} mountings")
    print(f"  rig time       {np.mean([row['rig_s'] for row in scans]):7.1f} s")
    for name, key in (("minimum of |S|", "minimum_arcsec"), ("line fit", "line_arcsec")):
        values = np.array([row[key] for row in scans])
        print(f"  {name:<14} {values.mean():+7.2f} arcsec mean error, {np.abs(values).max():.2f} worst")


if __name__ == "__main__":
    main()
