"""Are the budgets of the sensing axes true in the host's frame? Twins whose natures are drawn from them.

What the shipped rig file states is drawn: tilts of the beams, the sensor's delay, yaw times lever, recoil, gravity,
and what is read of the cube's normals in the host's frame (1 arcsec). Each twin runs the flight-model campaign: three
axes, ten mountings in pendulum and flag. Held against nature's axes in the host's frame: two components of each axis
over their combined uncertainty, all six together with their covariance, and the angles. The scale of the heads and
the faces of the cube (0.3 arcsec) are as believed, because the world has no such errors. Results are kept in a file
of JSON lines, so that an interrupted study goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import math
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.machine import machine
from benchmarks.twin import CAMPAIGNS, twin
from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.campaign import plan as plan_of
from rigctl.analysis.plane import ARCSEC
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.store_reduction import reduction
from rigctl.experiments.sensing_axis.result.budget import axis_budgets
from rigctl.experiments.sensing_axis.result.host_axes import host_axes
from rigctl.experiments.sensing_axis.result.result import sensing_axes as axes_of
from rigctl.files.campaign_file import read_campaign
from rigctl.files.package import Package
from rigctl.files.rig_file import RigFile, read_rig

GIVEN = ("uoaf_from_coc", "uoaf_u_arcsec", "uoaf_correlation")
"""Keys of a rotation that is given, not measured."""

READ_ARCSEC = 1.0
"""Of a normal in the host's frame, across it."""


def drawn_nature(believed: RigFile, rng: np.random.Generator) -> RigFile:
    """The rig file with a nature as its certificates have it."""
    u, world = believed.uncertainties, believed.world
    stage, lever_m = u["stage"], believed.package.lever_mm / 1e3
    effects = {
        **world["effects"],
        "bench-recoil": {"c": stage["recoil_rad_s2_per_m"] * rng.standard_normal()},
        "yaw-lever": {"lever_cos": stage["yaw_rad_per_m"] * lever_m * rng.standard_normal()},
        # The world knows delays only.
        "time-skew": {"tau": abs(u["accel_v"]["latency_s"] * rng.standard_normal())},
    }
    lasers = {
        name: {**laser, "tilt_deg": laser["tilt_deg"] + u[name]["tilt_deg"] * rng.standard_normal()}
        for name, laser in world["lasers"].items()
    }
    g_m_s2 = believed.constants["g_m_s2"].value + u["constants"]["g_m_s2"] * rng.standard_normal()
    nature = {**world, "effects": effects, "lasers": lasers, "g_m_s2": g_m_s2}
    return believed.model_copy(update={"world": nature})


def read_package(believed: Package, rng: np.random.Generator) -> Package:
    """The package with the host's frame measured: three normals, read with errors."""
    rotation, normals = believed.uoaf_rotation().matrix, np.eye(3)
    read = normals @ rotation.T + READ_ARCSEC * ARCSEC * rng.standard_normal((3, 3))
    directions = [
        {"coc": normal.tolist(), "uoaf": there.tolist(), "u_arcsec": READ_ARCSEC}
        for normal, there in zip(normals, read, strict=True)
    ]
    given = {name: value for name, value in believed.model_dump().items() if name not in GIVEN}
    return Package.model_validate({**given, "uoaf_directions": directions})


def campaign(seed: int) -> dict[str, Any]:
    """One twin: its pulls."""
    rng = np.random.default_rng([16, seed])
    believed = read_rig(CAMPAIGNS / "isa-rig.toml")
    package = read_package(believed.package, rng)
    plan = plan_of(read_campaign(CAMPAIGNS / "isa-flight-model.toml"))
    with twin(seed, drawn_nature(believed, rng)) as t:
        sensing_axes.run(t.session, t.bench, plan)
        runs = reduction(t.store).runs
        result = axes_of(RecordingModel(runs, package, t.bench.heads, t.bench.g_m_s2, plan.effects))
        sensors = t.rig.simulation.nature.sensors
    budgets = axis_budgets(result, believed.uncertainties)
    host = host_axes(result, budgets)
    turn = believed.package.uoaf_rotation().matrix
    truth = np.array([turn @ np.array(sensors[name].true_axis) for name in host.names])
    components, sigma = [], []
    for place, name in enumerate(host.names):
        components += (budgets[name].basis_uoaf @ (host.units[place] - truth[place])).tolist()
        sigma += budgets[name].budget.standard_uncertainty.tolist()
    covariance = host.correlation * np.outer(sigma, sigma)
    angles = {
        f"{a}{b}": (_angle(host.units[i], host.units[j]) - _angle(truth[i], truth[j])) / host.angle_sigma_rad(i, j)
        for (i, a), (j, b) in combinations(enumerate(host.names), 2)
    }
    return {
        "seed": seed,
        "pulls": (np.array(components) / sigma).tolist(),
        "chi2": float(components @ np.linalg.solve(covariance, components)),
        "angles": angles,
        "monte_carlo": [all(each.check.validated) for each in budgets.values()],
        "sigma_arcsec": (np.array(sigma) / ARCSEC).tolist(),
    }


def _angle(a: FloatArray, b: FloatArray) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


DOF = 18
"""Of each axis: twenty vectors, two components of the normal."""


def report(twins: list[dict[str, Any]]) -> None:
    """Print pulls of components and angles, and chi-square of all components together."""
    pulls = np.array([each["pulls"] for each in twins])
    expected = math.sqrt(DOF / (DOF - 2))
    print(machine())
    print(
        f"{len(twins)} twins; pulls should have mean 0 and rms {expected:.2f} (Student's t, {DOF} degrees of freedom)"
    )
    for place, name in enumerate(f"{axis} {n}" for axis in "XYZ" for n in (1, 2)):
        print(f"  component {name}: {_told(pulls[:, place])}")
    print(f"  all components: {_told(pulls.ravel())}, p {stats.kstest(pulls.ravel(), stats.t(DOF).cdf).pvalue:.2f}")
    for pair in twins[0]["angles"]:
        print(f"  angle {pair}: {_told(np.array([each['angles'][pair] for each in twins]))}")
    chi2 = np.array([each["chi2"] for each in twins])
    spread = chi2.std(ddof=1) / math.sqrt(len(twins))
    wanted = 6.0 * expected**2
    print(f"  chi-square of the six by their covariance: {chi2.mean():.2f} +- {spread:.2f}, {wanted:.2f} expected")
    validated = np.mean([each["monte_carlo"] for each in twins])
    print(f"  budgets that Monte Carlo agrees with: {100.0 * validated:.1f} %")


def _told(pulls: FloatArray) -> str:
    n = len(pulls)
    rms = math.sqrt(float(np.mean(pulls**2)))
    return f"mean {pulls.mean():+.3f} +- {1 / math.sqrt(n):.3f}, rms {rms:.3f} +- {rms / math.sqrt(2 * n):.3f}"


def main() -> None:
    """Run what is missing of the twins asked for, and report on all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("out/axis-twins.jsonl"))
    asked = parser.parse_args()
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    lines = asked.out.read_text(encoding="utf-8").splitlines() if asked.out.exists() else []
    done = {each["seed"]: each for each in map(json.loads, lines)}
    with asked.out.open("a", encoding="utf-8") as file:
        for seed in range(1, asked.twins + 1):
            if seed not in done:
                done[seed] = campaign(seed)
                file.write(json.dumps(done[seed]) + "\n")
                file.flush()
    report([done[seed] for seed in sorted(done)])


if __name__ == "__main__":
    main()
