"""Over the wire, all channels of a run are aligned within 0.2 mrad at 0.6 Hz once their delays are taken out.

What the phases are in truth the world says, asked at times of its own: its stage, its sensor and its heads without
any instrument between. When an LK-G3001's values were taken its simulator says. The reduction sees what came over the
wire and the rig file's latencies.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import results, runner
from rigctl.campaign.recording import time_column
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.toml import to_toml
from rigctl.experiments.sensing_axis.observe.reduction import ReducedRun, reduce_run
from rigctl.files.campaign_file import read_campaign
from simulators.measured import Measurement, joined
from simulators.rig import SimulatedRig
from tests.campaigns.lockstep import served
from tests.campaigns.test_laser_dialects import CAMPAIGNS

FREQUENCY_HZ = 0.6
ALLOWED_RAD = 0.2e-3
CLOCK_PPM = 12.0
"""How fast the drive's clock is, in the shipped rig."""
LATENCIES_S = {"accelerometer": -2.5e-3, "stage": 1e-3, "lasers": 3e-3}
"""Of the middle of an aperture of 5 ms, which ends with the edge, of the latched position and of a stored value."""
AVERAGED_S = 7.5e-3
"""How much earlier than that sixteen values a millisecond apart have their middle."""

RUN = f"""\
experiment = "sensing-axis"
rig = "rig.toml"
[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag"]
angles_deg = [1.6]
frequencies_hz = [{FREQUENCY_HZ}]
approaches = [1]
amplitude_mm = 5.0
dwell_s = 40.0
order_seed = 1
"""
AXIS = """\
experiment = "sensing-axis"
rig = "rig.toml"
[procedure]
name = "six-mountings"
axes = ["X"]
configurations = ["pendulum", "flag"]
mountings = 2
frequencies_hz = [0.3, 0.6]
coarse_s = 4.0
noise_check_s = 0.0
[targets]
theta0_sigma_arcsec = 15.0
noise_m_s2_rthz = 1e-5
[model]
effects = ["roll-gravity", "resonance"]
"""


@dataclass(frozen=True)
class Aligned:
    """A run as the reduction has it, and the world that it was measured in, still warm."""

    reduced: ReducedRun
    samples: dict[str, FloatArray]
    simulated: SimulatedRig
    taken: dict[str, Measurement]
    """What each instrument measured, and at which edges, or ticks of its own clock [rig time]."""


def rig_text(*following: str, corrected: bool = True) -> str:
    """The shipped rig with delays everywhere; `following` are the lasers that are LK-G5000s, on the rig's edges.

    `corrected` where the operator has written the delays into the rig file.
    """
    tables = tomllib.loads((CAMPAIGNS / "isa-rig.toml").read_text())
    instruments = tables["instruments"]
    instruments["accelerometer"] |= {"aperture_s": 5e-3} | ({} if corrected else {"latency_s": 0.0})
    instruments["stage"]["simulator"]["capture_latency_s"] = LATENCIES_S["stage"]
    instruments["stage"] |= {"latency_s": LATENCIES_S["stage"]} if corrected else {}
    for name in ("lasers_a", "lasers_b"):
        each = instruments[name]
        each |= {"averaging": 16, "simulator": {"latency_s": LATENCIES_S["lasers"]}}
        # Without a correction the average's own delay is undone as well, which the driver knows of.
        each["latency_s"] = LATENCIES_S["lasers"] if corrected else AVERAGED_S
        if name in following:
            each |= {"driver": "keyence-lkg5000", "timing_pulse_s": 4e-3}
    tables["certificates"]["accel_v"] = {"uncertainty": {"latency_s": 2e-5}}
    for name in ("laser_1_mm", "laser_2_mm", "laser_3_mm"):
        tables["certificates"][name]["uncertainty"]["latency_s"] = 2e-5
    return to_toml(tables)


def measured(directory: Path, rig: str, campaign: str) -> tuple[Path, SimulatedRig, dict[str, Measurement]]:
    """A campaign over the wire; the world as it is left, and what was measured in the last run."""
    (directory / "rig.toml").write_text(rig)
    (directory / "campaign.toml").write_text(campaign)
    store = directory / "x.rig.sqlite"
    with served(directory / "rig.toml", pytest.MonkeyPatch()) as (file, lockstep):
        kept = lockstep.simulated.measured.keep()
        runner.start(read_campaign(directory / "campaign.toml"), file, store, runner.Options(unattended=True))
    return store, lockstep.simulated, {each.channel: each for each in joined(kept)}


def aligned(directory: Path, rig: str) -> Aligned:
    """The one run, reduced."""
    path, simulated, taken = measured(directory, rig, RUN)
    with Store.open(path, readonly=True) as store:
        (run,) = store.runs()
        samples = store.samples(run.run_id)
        reduced = reduce_run(run.run_id, run.conditions, samples, channels=store.header.channels)
    return Aligned(reduced, samples, simulated, taken)


def phase_rad(times_s: FloatArray, values: Any) -> float:
    """Of the drive's sine in a signal of the world, by least squares beside its harmonics and a mean."""
    w = 2.0 * math.pi * FREQUENCY_HZ * (1.0 + 1e-6 * CLOCK_PPM)
    turns = np.outer(times_s, w * np.arange(1, 6))
    design = np.column_stack([np.ones_like(times_s), np.cos(turns), np.sin(turns)])
    found = np.linalg.lstsq(design, values, rcond=None)[0]
    return math.atan2(-found[6], found[1])


def begun_s(run: Aligned) -> float:
    """When the first edge came."""
    return float(run.taken["accel_v"].at_s[0])


def world_phases_rad(run: Aligned) -> dict[str, float]:
    """Of the world's sensor and heads against its stage, asked at times that are no edges'."""
    bench = run.simulated.bench
    # Whole periods, as the record has them: what the ground does meanwhile is then the same for both.
    lasts_s = math.floor(run.reduced.duration_s * FREQUENCY_HZ) / FREQUENCY_HZ
    times_s = begun_s(run) + lasts_s * (np.arange(20_000) + 0.5) / 20_000.0
    stage = phase_rad(times_s, bench.axes["linear"].sample(times_s)[0])
    signals = {"accel_v": bench.volts("accel_v"), "laser_1_mm": bench.displacement_mm("laser_1_mm")}
    return {name: phase_rad(times_s, signal(times_s)) - stage for name, signal in signals.items()}


def error_rad(run: Aligned, channel: str) -> float:
    """How far the phase that the reduction reports of a channel is from the world's."""
    value = run.reduced.channels[channel].value[1]
    reported = math.atan2(value.imag, value.real)
    return math.remainder(reported - world_phases_rad(run)[channel], 2.0 * math.pi)


def test_an_lkg5000_and_the_meter_are_aligned_with_the_encoder(tmp_path: Path) -> None:
    run = aligned(tmp_path, rig_text("lasers_a", "lasers_b"))
    for channel in ("accel_v", "laser_1_mm"):
        assert abs(error_rad(run, channel)) < ALLOWED_RAD, channel


def test_what_is_not_corrected_is_seen(tmp_path: Path) -> None:
    run = aligned(tmp_path, rig_text("lasers_a", "lasers_b", corrected=False))
    w = 2.0 * math.pi * FREQUENCY_HZ
    late_s = {name: latency_s - LATENCIES_S["stage"] for name, latency_s in LATENCIES_S.items()}
    assert error_rad(run, "accel_v") == pytest.approx(w * late_s["accelerometer"], abs=ALLOWED_RAD)
    assert error_rad(run, "laser_1_mm") == pytest.approx(w * (late_s["lasers"] - AVERAGED_S), abs=ALLOWED_RAD)


def test_an_lkg3001s_values_are_put_where_they_were_taken(tmp_path: Path) -> None:
    run = aligned(tmp_path, rig_text())
    assert abs(error_rad(run, "accel_v")) < ALLOWED_RAD
    own_s = run.samples[time_column("laser_1_mm")]
    clock = run.reduced.channels["laser_1_mm"].clock
    assert clock is not None
    seen = np.isfinite(run.samples["laser_1_mm"])
    rig_s = own_s + clock.offset_s + clock.rate * (own_s - own_s[seen].mean())
    stored = run.taken["laser_1_mm"]
    # Which of the stored values they are, by the values; those before the first edge are left out.
    (first,) = [
        k
        for k in range(len(stored.values) - len(own_s) + 1)
        if np.allclose(stored.values[k : k + len(own_s)], run.samples["laser_1_mm"], atol=1e-9, equal_nan=True)
    ]
    # What the offset has aligned is the encoder's samples, whose latency is no part of it.
    stands_for_s = stored.at_s[first : first + len(own_s)] + LATENCIES_S["lasers"] - AVERAGED_S - begun_s(run)
    error_s = rig_s - (stands_for_s - LATENCIES_S["stage"])
    assert 2.0 * math.pi * FREQUENCY_HZ * np.abs(error_s).max() < ALLOWED_RAD
    # And not because its times were known before: they were wrong by more than that.
    assert abs(clock.offset_s) > ALLOWED_RAD / (2.0 * math.pi * FREQUENCY_HZ)


def test_how_well_the_delays_are_known_is_in_the_budget(tmp_path: Path) -> None:
    path, _, _ = measured(tmp_path, rig_text("lasers_b"), AXIS)
    told = {each["name"]: each["input"] for each in results.of(path)["budget"]["X"]["contributions"]}
    assert told["latency of accel_v"] == told["latency of laser_3_mm"] == "2e-05 s"
    # What the fit leaves open of a clock; nobody has to know it before.
    u_s = float(told["clock of laser_1_mm"].removesuffix(" s"))
    assert 0.0 < 2.0 * math.pi * FREQUENCY_HZ * u_s < ALLOWED_RAD
    assert "latency of laser_1_mm" not in told
