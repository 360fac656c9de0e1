"""Are the stated uncertainties true? Twin campaigns by seed against nature's axes.

Each axis' two error components over their stated sigma must follow Student's t with N - 2 degrees of freedom. Runs
the flight-model campaign (six configurations, ten mountings each) once per seed; results are kept in a file of JSON
lines, so that an interrupted study goes on where it was.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.machine import machine
from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from benchmarks.twin import CAMPAIGNS, twin
from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.campaign import plan as plan_of
from rigctl.analysis.plane import ARCSEC
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.store_reduction import reduction
from rigctl.experiments.sensing_axis.result.result import AxisResult
from rigctl.experiments.sensing_axis.result.result import sensing_axes as axes_of
from rigctl.files.campaign_file import read_campaign


def campaign(seed: int) -> list[dict[str, float | str | int]]:
    """One campaign; a row per axis."""
    plan = plan_of(read_campaign(CAMPAIGNS / "isa-flight-model.toml"))
    with twin(seed) as t:
        sensing_axes.run(t.session, t.bench, plan)
        # The twin's store has no rig file: the bench says what is mounted where.
        runs = reduction(t.store).runs
        result = axes_of(RecordingModel(runs, t.bench.package, t.bench.heads, t.bench.g_m_s2, plan.effects))
        sensors = t.rig.simulation.nature.sensors
        return [row(seed, axis, np.array(sensors[name].true_axis)) for name, axis in result.axes.items()]


def row(seed: int, axis: AxisResult, truth: np.ndarray) -> dict[str, float | str | int]:
    """Error of one axis along two directions perpendicular to it, and what was stated."""
    normal = axis.plane.normal
    first = axis.vectors[0] - (axis.vectors[0] @ normal) * normal
    first /= np.linalg.norm(first)
    basis = np.stack([first, np.cross(normal, first)])
    error = basis @ (normal - truth)
    sigma = np.sqrt(np.diag(basis @ axis.plane.covariance @ basis.T))
    return {
        "seed": seed,
        "axis": axis.name,
        "vectors": axis.plane.vectors,
        "error_1": error[0] / ARCSEC,
        "error_2": error[1] / ARCSEC,
        "sigma_1": sigma[0] / ARCSEC,
        "sigma_2": sigma[1] / ARCSEC,
        "std_hc_2sigma": axis.plane.std_hc_2sigma_arcsec,
        "e_c_e": float(error @ np.linalg.inv(basis @ axis.plane.covariance @ basis.T) @ error),
    }


SMALLEST_P = 1e-3
"""With --check: a study of true uncertainties fails once in a thousand."""


def report(rows: list[dict[str, float]]) -> float:
    """Print the statistics of all rows; returns the Kolmogorov-Smirnov p."""
    pulls = np.array([[r["error_1"] / r["sigma_1"], r["error_2"] / r["sigma_2"]] for r in rows]).ravel()
    errors = np.array([[r["error_1"], r["error_2"]] for r in rows]).ravel()
    dof = int(rows[0]["vectors"]) - 2
    campaigns = len({r["seed"] for r in rows})
    test = stats.kstest(pulls, stats.t(dof).cdf)
    inside = np.mean(np.abs(pulls) < stats.t(dof).ppf(0.975))
    spread = math.sqrt(0.05 * 0.95 / len(pulls))
    print(machine())
    print(f"{campaigns} campaigns, {len(pulls)} error components, Student t with {dof} degrees of freedom")
    print(f"  Kolmogorov-Smirnov p  {test.pvalue:.3f}")
    print(f"  within 95 %           {100 * inside:.1f} % (expected 95.0 +- {100 * spread:.1f})")
    print(f"  rms pull              {np.sqrt(np.mean(pulls**2)):.3f} (expected {math.sqrt(dof / (dof - 2)):.3f})")
    print(f"  mean error            {errors.mean():+.3f} +- {errors.std() / math.sqrt(len(errors)):.3f} arcsec")
    print(f"  rms error             {np.sqrt(np.mean(errors**2)):.2f} arcsec per component")
    std = np.array([r["std_hc_2sigma"] for r in rows])
    print(f"  std_hc at 2 sigma     {std.mean():.2f} arcsec mean, {std.min():.1f} to {std.max():.1f} (nature: 25)")
    limit = 2.0 * stats.f(2, dof).ppf(0.9973)
    beyond = sum(r["e_c_e"] > limit for r in rows)
    print(f"  e' C^+ e > {limit:.1f}        {beyond} of {len(rows)} axes (expected {0.0027 * len(rows):.1f})")
    return float(test.pvalue)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1)
    add_workers(parser, 2)
    parser.add_argument("--keep", type=Path, default=Path("out/accuracy.jsonl"))
    parser.add_argument("--check", action="store_true", help="exit 1 when the uncertainties are not true")
    arguments = parser.parse_args()
    wanted = range(arguments.first_seed, arguments.first_seed + arguments.campaigns)
    missing = sorted(set(wanted) - {r["seed"] for r in rows_in(arguments.keep)})
    keep_trials(campaign, missing, arguments.keep, workers_of(arguments))
    p_value = report([r for r in rows_in(arguments.keep) if r["seed"] in wanted])
    if arguments.check and p_value < SMALLEST_P:
        sys.exit(f"stated uncertainties are not true: p = {p_value:.2g}")


if __name__ == "__main__":
    main()
