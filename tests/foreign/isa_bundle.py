"""A recording of the second sensing-axis world as another laboratory would hand it over: noise, gaps, files."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.foreign.isa_world import AXES, HEADS_FACE, Bench, Design, Floats, cyclic, readings


@dataclass(frozen=True)
class Noise:
    """Spectral densities of the sensor's noise, and what the heads and the encoder add to every sample."""

    white_v: float
    flicker_v_rthz: float
    exponent: float
    bump_v_rthz: float
    drifting_v: float
    laser_m: float = 5e-8
    stage_m: float = 2e-9

    def density(self, frequency_hz: Floats, rate_hz: float) -> Floats:
        """One-sided, V2/Hz."""
        f = np.maximum(np.abs(frequency_hz), 1e-3)
        bump = self.bump_v_rthz**2 * np.exp(-0.5 * ((f - 0.17) / 0.02) ** 2)
        coloured = self.flicker_v_rthz**2 * (0.1 / f) ** self.exponent
        return np.asarray(2.0 * self.white_v**2 / rate_hz + coloured + bump)


def coloured(random: np.random.Generator, noise: Noise, design: Design) -> Floats:
    """Noise of the spectrum given, from random phases and amplitudes; a slow wandering of the level in addition."""
    count = len(design.time_s)
    frequency = np.fft.rfftfreq(2 * count, 1.0 / design.rate_hz)
    spread = np.sqrt(noise.density(frequency, design.rate_hz) * design.rate_hz * count)
    spread[0] = 0.0
    shape = (design.runs, len(frequency))
    spectrum = spread * (random.normal(size=shape) + 1j * random.normal(size=shape)) / np.sqrt(2.0)
    samples = np.fft.irfft(spectrum, 2 * count, axis=1)[:, :count]
    wandering = np.zeros(design.runs)
    for scale_s in (100.0, 1000.0, 10000.0):
        kept = np.exp(-np.diff(design.start_s, prepend=design.start_s[0] - 1e9) / scale_s)
        fresh = random.normal(size=design.runs) * np.sqrt(1.0 - kept**2)
        level = 0.0
        for run in range(design.runs):
            level = kept[run] * level + fresh[run]
            wandering[run] += level * noise.drifting_v / np.sqrt(3.0)
    return np.asarray(samples + wandering[:, None])


def write(design: Design, bench: Bench, noise: Noise, seed: int, bundle: Path) -> None:
    """The bundle: what a laboratory would hand over, with gaps, and nothing of the truth."""
    random = np.random.default_rng([22112026, seed])
    given = readings(design, bench)
    accel = given.accel_v + coloured(random, noise, design)
    stage = given.stage_m + random.normal(0.0, noise.stage_m, given.stage_m.shape)
    laser = given.laser_m + random.normal(0.0, noise.laser_m, given.laser_m.shape)
    laser += random.uniform(-1e-3, 1e-3, (3, design.runs, 1))
    laser[:, random.random(accel.shape) < 2e-3] = np.nan
    (bundle / "runs").mkdir(parents=True)
    (bundle / "recording.toml").write_text(recording_toml(design.axis))
    columns = ["t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm", "laser_3_mm"]
    for run in range(design.runs):
        heads = laser[:, run] * 1e3 if design.lasers[run] else np.full((3, accel.shape[1]), np.nan)
        table = np.vstack([design.time_s, stage[run] * 1e3, accel[run], heads])
        np.savez(bundle / "runs" / f"{run_name(run)}.npz", **dict(zip(columns, table, strict=True)))
    write_runs(design, bundle)


def run_name(run: int) -> str:
    return f"n{run + 1:03d}"


def face_letter(axis: str, face: str) -> str:
    """The face ``k`` or ``-k`` of a mounting for that axis, in the cube's letters."""
    return face[:-1] + AXES[cyclic(axis)["ijk".index(face[-1])]].lower()


def write_runs(design: Design, bundle: Path) -> None:
    names = ["run_id", "axis", "configuration", "mounting", "theta_deg", "approach", "frequency_hz", "amplitude_mm"]
    names += ["temperature_c", "humidity_percent", "start_s", "laser_1_face", "laser_2_face", "laser_3_face"]
    with (bundle / "runs.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(names)
        for run in range(design.runs):
            configuration = "flag" if design.flag[run] else "pendulum"
            rows.writerow([
                run_name(run), design.axis, configuration, design.mounting[run],
                repr(float(np.degrees(design.theta_rad[run]))), int(design.approach[run]),
                repr(float(design.frequency_hz[run])), design.amplitude_m[run] * 1e3,
                design.temperature_c[run], design.humidity_percent[run], design.start_s[run],
                *(face_letter(design.axis, face) for face in HEADS_FACE[configuration]),
            ])  # fmt: skip


def recording_toml(axis: str) -> str:
    lines = ["format = 1", 'experiment = "sensing-axis"', 'title = "a bench elsewhere"', "", "[constants]"]
    lines += ["g_m_s2 = 9.803", "gain_v_per_m_s2 = 80.0", "", "[channels.accel_v]", 'unit = "V"']
    lines += ['kind = "accelerometer"', "full_scale = 10.0", ""]
    for head, face in enumerate(HEADS_FACE["pendulum"], start=1):
        lines += [
            f"[lasers.laser_{head}_mm]",
            f'face = "{face_letter(axis, face)}"',
            "tilt_deg = 5.0",
            "",
        ]
    return "\n".join(lines)
