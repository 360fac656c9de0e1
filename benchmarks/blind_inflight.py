"""Does the workbench find what is hidden in an in-flight calibration? Blind trials on the simulated satellite.

Each batch draws satellites and one hidden effect (or none, or one that no session can show), simulates their
sessions, asks `diagnose`, and compares the answer with the truth. An answer is right when it is the hidden effect, or
names it as one of those these data cannot tell apart; of nothing, and of what cannot show, when it is "adequate".
Scores are kept in a file of JSON lines, so that an interrupted study goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from benchmarks.blind_trials import clopper_pearson
from procedures.inflight.tables import TEN, Calibration
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import RigError
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.workbench.verdict.diagnose import diagnose
from simulators.keyed_random import generator
from simulators.worlds.satellite.ensemble import Ensemble
from simulators.worlds.satellite.forcing import ROOM_K, temperature_k
from simulators.worlds.satellite.settings import SatelliteSettings

SATELLITES = 2
"""Draws of one batch: they share the hidden effect, and are simulated in lock step."""

CHUNK = 4096
WARM = {"orbit_k": 1e-4, "twice_k": 0.0}

SHOWN: Mapping[str, Mapping[str, float]] = {
    "thermal-bias": {"lambda[1]": 1e-9},
    "thermal-gain": {"kappa[1]": 5e-2},
    "thermal-off-centring": {"beta": 5e-4},
    "wire-stiffness": {"kappa[1]": 1e-3, "kappa[2]": 1e-3, "quality": 100.0},
    "cubic-stiffness": {"kappa3[1]": 1e3, "kappa3[2]": 1e3},
    "charge": {"rate[1]": 1e-16},
    "magnetic": {"a1_cos[1]": 6e-14, "a1_sin[1]": -4e-14},
    "orbit-precession": {"rate": 2e-7},
    "gravity-j2": {"j2": 1.083e-3, "inclination": 1.72, "perigee": 0.4},
    "sensor-skew": {"delay": 2e-4},
    "cubic-electrode": {"k3[1]": 4e9},
    "bias-drift": {"rate[1]": 5e-17, "curvature[1]": 3e-21},
    "glitches": {"amplitude": 1e-8, "per_orbit": 10.0, "ratio": 1e-2},
    "noise-level": {"change": 0.3, "period": 20000.0},
}
"""Effects that sessions show, in a size of ten sigma or so; the size drawn multiplies it."""

HIDDEN: Mapping[str, Mapping[str, float]] = {
    "tracker-bias": {"x": 1e-4, "y": 1e-4, "z": 1e-4},
    "orbit-dating": {"delay": 0.3},
    "tracker-aberration": {"annual": 1.0, "orbital": 1.0},
    "cross-quadratic": {"kxy[1]": 100.0},
    "mass-drift": {"rate_x": 4e-11},
    "moved-mass-reaction": {"factor": 1.0},
    "thrust-quantisation": {"step": 1e-10, "minimum": 1e-10, "maximum": 0.0},
}
"""Effects that parameters take up, or that move both masses alike."""

SCALES = (1.0, 2.0)
SIZES_KEPT = ("quality", "per_orbit", "period", "inclination", "perigee", "maximum", "ratio")


@dataclass(frozen=True)
class Batch:
    """Satellites with one hidden effect, "" for none."""

    seed: int
    effect: str
    weaker: float = 1.0
    """What its size is divided by."""

    @property
    def settings(self) -> SatelliteSettings:
        """Nature."""
        parameters = {**SHOWN, **HIDDEN}.get(self.effect, {})
        scale = float(generator(self.seed, "size", self.effect).uniform(*SCALES)) / self.weaker
        effects = {
            self.effect: {
                name: value if name.partition("[")[0] in SIZES_KEPT else scale * value
                for name, value in parameters.items()
            }
        }
        return SatelliteSettings(
            kind="drag-free-satellite",
            seed=self.seed,
            temperature=WARM,  # type: ignore[arg-type]
            effects=effects if self.effect else {},
        )


def recordings(batch: Batch) -> list[Recording]:
    """What the satellites send down, in single precision: nothing in it tells what is hidden."""
    settings, calibration = batch.settings, Calibration()
    ensemble, draws = Ensemble(settings), tuple(range(SATELLITES))
    columns: list[dict[str, Mapping[str, Any]]] = [{} for _ in draws]
    records = []
    for run, name in enumerate(TEN):
        asked = calibration.session(name, settings.orbit_period_s)
        chunks = [part.astype(np.float32) for part in ensemble.telemetry(draws, run, asked, CHUNK)]
        t_s = np.arange(sum(map(len, chunks))) * settings.sample_period_s
        warm = ROOM_K + temperature_k(settings, t_s)
        for place, own in enumerate(columns):
            samples = np.concatenate([part[:, :, place] for part in chunks]).T
            own[name] = {
                "t_s": t_s,
                **dict(zip(ensemble.columns, samples, strict=True)),
                "temperature_1_k": warm,
                "temperature_2_k": warm,
            }
        records.append(RunRecord(name, name, "blind", calibration.conditions(name, settings.sample_period_s)))
    header = Header(
        "inflight-calibration",
        constants={"orbit_period_s": settings.orbit_period_s, "eccentricity": settings.eccentricity},
    )
    return [_Double(header, records, own, ImportReport(len(records))) for own in columns]


class _Double(Recording):
    """Samples in double precision when they are read."""

    def samples(self, run_id: str) -> dict[str, Any]:
        return {name: np.asarray(column, dtype=np.float64) for name, column in self.columns[run_id].items()}


def scores(batch: Batch, alpha: float) -> Iterator[dict[str, Any]]:
    """One row per satellite."""
    for place, recording in enumerate(recordings(batch)):
        began_s = time.perf_counter()
        row = {"seed": batch.seed, "effect": batch.effect, "satellite": place}
        try:
            found = diagnose(InflightStudy(recording), (), alpha=alpha).as_json()
        except RigError as error:
            yield {**row, "error": str(error), "right": False}
            continue
        ranks = {rank["effect"]: rank for rank in found["ranking"]}
        alike = {other for name in found["suggested"] for other in ranks[name]["equivalent_to"]}
        yield {
            **row,
            "verdict": found["verdict"],
            "suggested": found["suggested"],
            "alike": sorted(alike),
            "p": {name: ranks[name]["p_value_corrected"] for name in found["suggested"]},
            "sigmas": {name: _sigmas(ranks[name]["parameters"]) for name in found["suggested"]},
            "unexplained": found["unexplained"],
            "right": _right(batch.effect, found["suggested"], alike, found["verdict"]),
            "seconds": time.perf_counter() - began_s,
        }


def _sigmas(parameters: Mapping[str, Mapping[str, Any]]) -> float:
    """How many standard uncertainties an effect is large, by its best-seen parameter."""
    return max(
        (abs(each["value"]) / each["sigma"] for each in parameters.values() if each["sigma"] > 0.0), default=0.0
    )


def _right(effect: str, suggested: list[str], alike: set[str], verdict: str) -> bool:
    if effect in SHOWN:
        return suggested == [effect] or (len(suggested) == 1 and effect in alike)
    return verdict == "adequate"


def main() -> int:
    """Go on with the study and print what it has so far."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scores", type=Path, help="file of JSON lines, made or gone on with")
    parser.add_argument("--batches", type=int, default=1, help="per effect")
    parser.add_argument("--first", type=int, default=0, help="seed of the first batch")
    parser.add_argument("--effects", nargs="*", default=["", *SHOWN, *HIDDEN])
    parser.add_argument("--weaker", type=float, default=1.0, help="divides the sizes of what is hidden")
    parser.add_argument("--alpha", type=float, default=0.01)
    asked = parser.parse_args()
    rows = [json.loads(line) for line in asked.scores.read_text().splitlines()] if asked.scores.exists() else []
    done = {(row["seed"], row["effect"]) for row in rows}
    with asked.scores.open("a") as file:
        for seed in range(asked.first, asked.first + asked.batches):
            for effect in asked.effects:
                if (seed, effect) in done:
                    continue
                new = list(scores(Batch(seed, effect, asked.weaker), asked.alpha))
                rows += new
                file.writelines(json.dumps(row) + "\n" for row in new)
                file.flush()
                for row in new:
                    print(json.dumps(row), file=sys.stderr)
    told(rows)
    return 0


def told(rows: list[dict[str, Any]]) -> None:
    """Shares of right answers with their 95 % interval, by effect and together."""
    groups = {"nothing hidden": [""], "effects that show": list(SHOWN), "effects that cannot show": list(HIDDEN)}
    for title, names in groups.items():
        own = [row for row in rows if row["effect"] in names]
        for name in names if len(names) > 1 else []:
            hits = [bool(row["right"]) for row in own if row["effect"] == name]
            if hits:
                print(f"  {name:22} {sum(hits)} of {len(hits)}")
        hits = [bool(row["right"]) for row in own]
        if hits:
            low, high = clopper_pearson(sum(hits), len(hits))
            print(f"{title}: right in {sum(hits)} of {len(hits)} ({100 * low:.0f} to {100 * high:.0f} %)")


if __name__ == "__main__":
    sys.exit(main())
