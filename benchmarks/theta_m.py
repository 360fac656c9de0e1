"""The mean angle theta_m out of the non-sensitivity plane over many twins of the flight model, beside Table 1's.

Lucente et al. 2022 print theta_m of -0.051, -0.342, -0.008 arcsec (X, Y, Z). They belong to the normal equations
(eq. 12), and are one draw each. Here 100 natures of the shipped rig mount the package as the flight-model campaign
does (ten times in pendulum and in flag), and the motion at each null, as the cube sees it, is wrong by what the
campaign's own nulls state (0.73 arcsec). No campaign is run, so that a hundred take seconds: `--store` holds the
shortcut against a campaign that was run, whose nature has the same mountings.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from rigctl import results
from rigctl.analysis.plane import ARCSEC, PlaneFit, fit_plane
from rigctl.core.arrays import FloatArray
from rigctl.files.rig_file import read_rig
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.mounting import levelled, mount
from simulators.worlds.rotations import Configuration, about_z

RIG = Path(__file__).parent.parent / "campaigns" / "isa-rig.toml"
PRINTED_ARCSEC = {"X": -0.051, "Y": -0.342, "Z": -0.008}
NULL_SIGMA_ARCSEC = 0.73
CONFIGURATIONS: tuple[Configuration, ...] = ("pendulum", "flag")
MOUNTINGS = 10
VERTICAL = np.array([0.0, 0.0, 1.0])


def motion_at_null(nature: BenchSettings, place: tuple[str, Configuration, int], error_rad: float) -> FloatArray:
    """The unit motion in the cube's frame (3,), at a stage angle that is off the null by `error_rad`."""
    mounting = levelled(mount(nature, *place), VERTICAL, 0.0)
    x, y, _ = mounting.sensing_axis_table
    null_rad = math.atan2(x, y)
    along_table = about_z(-(null_rad + error_rad)) @ np.array([1.0, 0.0, 0.0])
    return np.asarray(mounting.table_from_cube.T @ along_table)


def planes(nature: BenchSettings, sigma_rad: float) -> dict[str, PlaneFit]:
    """The planes of the three axes, mountings numbered as the campaign numbers them."""
    rng = np.random.default_rng(nature.seed)
    number, found = 0, {}
    for axis in PRINTED_ARCSEC:
        motions = []
        for configuration in CONFIGURATIONS:
            for _ in range(MOUNTINGS):
                number += 1
                motions.append(
                    motion_at_null(nature, (axis, configuration, number), sigma_rad * rng.standard_normal())
                )
        found[axis] = fit_plane(np.array(motions), np.array(nature.sensors[axis].true_axis))
    return found


def by_equation_12(plane: PlaneFit) -> float:
    """theta_m of the paper's estimator [arcsec]."""
    assert plane.paper_axis is not None, "eq. 12 has a solution wherever the motions are not all in one line"
    return plane.paper_axis.theta_m_arcsec


def held_against(store: Path, nature: BenchSettings) -> None:
    """Print theta_m of a campaign that was run and of the shortcut, with and without what a null is wrong by."""
    axes = results.of(store)["axes"]
    exact = planes(nature, 0.0)
    print("axis   campaign   its mountings with exact nulls   (arcsec)")
    for axis, plane in exact.items():
        print(f"{axis:4}   {axes[axis]['eq12']['theta_m_arcsec']:+8.3f}   {by_equation_12(plane):+8.3f}")


def main() -> None:
    """Print the rms over the twins beside the printed numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=100)
    parser.add_argument("--store", type=Path, help="a store of the flight-model campaign, to be held against")
    asked = parser.parse_args()
    nature = BenchSettings.model_validate(read_rig(RIG).world)
    if asked.store:
        held_against(asked.store, nature)
    twins = [
        planes(nature.model_copy(update={"seed": seed}), NULL_SIGMA_ARCSEC * ARCSEC)
        for seed in range(1, asked.twins + 1)
    ]
    print(f"theta_m of {asked.twins} twins / arcsec; difference: printed size from the mean's, over the scatter")
    print("axis   rms by eq. 12      mean, scatter       least squares   printed   difference   2 sigma_hc")
    for axis, printed in PRINTED_ARCSEC.items():
        paper = np.array([by_equation_12(twin[axis]) for twin in twins])
        least_rms = math.sqrt(np.mean([twin[axis].theta_m_arcsec ** 2 for twin in twins]))
        rms, mean, scatter = math.sqrt(np.mean(paper**2)), float(paper.mean()), float(paper.std(ddof=1))
        # Of the mean square, from its own scatter: theta_m is a quadratic form and not normal.
        error = float(np.std(paper**2)) / (2.0 * rms * math.sqrt(len(twins)))
        # The sign goes with the sides on which normal and motions are counted, which the paper does not tell.
        apart = (abs(printed) - abs(mean)) / scatter
        hc = math.sqrt(np.mean([twin[axis].std_hc_2sigma_arcsec ** 2 for twin in twins]))
        print(
            f"{axis:4}   {rms:.4f} +- {error:.4f}   {mean:+.4f} +- {scatter:.4f}   {least_rms:.4f}          "
            f"{printed:+.3f}    {apart:+.2f}        {hc:.1f}"
        )


if __name__ == "__main__":
    main()
