"""The figures of a rotating-platform recording beside what the paper prints: 5, 7, 8, 9 and table 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigctl.experiments.rotating_platform.observe.recorded import Chains
from rigctl.experiments.rotating_platform.result.bench_runs import Scan
from rigctl.experiments.rotating_platform.result.published import same_sensors
from rigctl.experiments.rotating_platform.result.result import PlatformResult
from rigctl.experiments.rotating_platform.result.run_result import RunResult
from rigctl.report.figures.data import Plate
from rigctl.report.figures.rotating_platform.alignment import alignment_plate
from rigctl.report.figures.rotating_platform.course import course_plate
from rigctl.report.figures.rotating_platform.precision import noise_plate, precision_plate, table_plate


def plates_of(
    result: PlatformResult, chains: Chains, scans: Sequence[Scan]
) -> tuple[list[Plate[Any]], dict[str, str]]:
    """Every figure the recording allows, with printed numbers for the paper's sensors; why another is not there."""
    plates: list[Plate[Any]] = []
    printed = same_sensors(chains.gain_v_per_m_s2)
    left_out: dict[str, str] = {}
    steady = [run for run in result.runs if _external(run) == "constant"]
    if scans or steady:
        plates.append(alignment_plate(result, scans, steady, printed=printed))
    else:
        left_out["fig5"] = "no scan and no run at constant tilt"
    for name, external in (("fig7", "triangle"), ("fig8", "sine")):
        runs = [run for run in result.runs if _external(run) == external]
        if runs:
            plates.append(course_plate(name, external, runs, result, chains, printed=printed))
        else:
            left_out[name] = f"no run with an external {external}"
    plates.append(precision_plate(result, chains, printed=printed))
    plates.append(table_plate(result, printed=printed))
    if result.noise_records:
        plates.append(noise_plate(result.noise_records, printed=printed))
    else:
        left_out["noise"] = "no noise record"
    return plates, left_out


def _external(run: RunResult) -> str:
    return str(run.run.conditions.get("external") or "constant")
