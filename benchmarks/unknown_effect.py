"""Makes examples/unknown-effect: a recording of the simulated world in which something acts that no catalogue has.

The gain follows the pressure of the room: gas around the proof mass takes part in its motion, and there is less of it
when the barometer falls. A barometer stood beside the rig. Everything else is the twin's own nature.

    PYTHONPATH=. .venv/bin/python benchmarks/unknown_effect.py examples/unknown-effect
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from benchmarks.blind_sampler import Design, Perturbation, SampledRun, sample_world
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, LaserInfo, Recording, RunRecord
from simulators.keyed_random import generator
from simulators.worlds.bench_settings import isa_twin

SEED = 7
GAIN_PER_HPA = 3e-5
STANDARD_HPA = 1013.25

DESIGN = Design(
    axes=("X",),
    configurations=("flag",),
    angles_deg=(-30.0, -10.0, -1.6, -0.8, 0.8, 1.6, 10.0, 30.0),
    sample_rate_hz=25.0,
    order_seed=3,
)
"""48 runs of 20 s, 500 samples each: small enough to be shipped as text."""

DECIMALS = {"t_s": 3, "stage_x_mm": 6, "accel_v": 6, "laser_1_mm": 4, "laser_2_mm": 4, "laser_3_mm": 4}
"""Digits that the instruments give."""


def pressure_hpa(number: int) -> float:
    """The barometer's reading in a run: weather, and the door of the laboratory."""
    return round(STANDARD_HPA + 6.0 * float(generator("barometer", number).standard_normal()), 1)


def breathing(run: SampledRun) -> Any:
    """What the pressure adds to the output, static level and all."""
    return GAIN_PER_HPA * (run.conditions["pressure_hpa"] - STANDARD_HPA) * run.columns["accel_v"]


def recording() -> Recording:
    """The recording as another laboratory would send it."""
    nature = isa_twin(SEED)
    runs = sample_world(nature, DESIGN, Perturbation(volts=breathing, columns={"pressure_hpa": pressure_hpa}))
    header = Header(
        "sensing-axis",
        title="X in flag, 48 runs, a barometer beside the rig",
        constants={"g_m_s2": nature.g_m_s2, "gain_v_per_m_s2": 100.0},
        channels={
            "stage_x_mm": ChannelInfo(unit="mm", kind="position"),
            "accel_v": ChannelInfo(unit="V", kind="accelerometer", full_scale=nature.range_v),
            **{name: ChannelInfo(unit="mm", kind="displacement") for name in nature.lasers},
        },
        lasers={name: LaserInfo(tilt_deg=head.tilt_deg) for name, head in nature.lasers.items()},
    )
    records = tuple(RunRecord(str(run.number), str(run.number), "", run.conditions) for run in runs)
    columns = {
        str(run.number): {name: values.round(DECIMALS[name]) for name, values in run.columns.items()} for run in runs
    }
    return Recording(header, records, columns, ImportReport(len(records)))


def main() -> None:
    """Write recording.toml, runs.csv and runs/ into a directory; what else is there stays."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=Path, help="where to write; not yet there, or empty")
    write_bundle(recording(), parser.parse_args().directory)


if __name__ == "__main__":
    main()
