"""Tables of readings made from a description: a bench with batches, rows pasted twice, a triad, a gravimeter.

Each maker writes a bundle and returns what is hidden in it, which the bundle does not hold. Numbers come from numpy's
generator with the seed given; nothing of the program is used.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ARCSEC_RAD = np.pi / 180.0 / 3600.0


@dataclass(frozen=True)
class Hidden:
    """What is right to say of a made table: verdicts, effects (alternatives of each), parameters with their sigma."""

    verdicts: Sequence[str]
    known: str
    effects: Sequence[Sequence[str]] = ()
    only: Sequence[str] = ()
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    batches: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def as_reference(self) -> dict[str, Any]:
        """As [reference] of a published data set has it."""
        stated = {"known": self.known, "verdicts": list(self.verdicts), "only": list(self.only)}
        sized = {"parameters": self.parameters, "batches": self.batches}
        return {
            **stated,
            **({"effects": [list(alternatives) for alternatives in self.effects]} if self.effects else {}),
            **{
                name: {key: {"value": value, "sigma": sigma} for key, (value, sigma) in values.items()}
                for name, values in sized.items()
            },
        }


def write(bundle: Path, response: str, baseline: str, columns: Mapping[str, Sequence[Any] | Floats]) -> None:
    """The two files of a table."""
    bundle.mkdir(parents=True)
    table = f'[table]\nresponse = "{response}"\nbaseline = "{baseline}"\n'
    (bundle / "recording.toml").write_text(f'format = 1\nexperiment = "table"\ntitle = "{bundle.name}"\n\n{table}')
    with (bundle / "readings.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))


def common_offsets(bundle: Path, seed: int) -> Hidden:
    """Sixty readings in twelve batches of five: the batch has an offset of 3 sigma and conditions of its own."""
    random = np.random.default_rng(seed)
    batch = np.repeat(np.arange(12), 5)
    load_n = random.uniform(0.0, 10.0, 60)
    offset = random.normal(0.0, 0.3, 12)[batch]
    columns = {
        "reading_v": np.round(1.0 + 0.2 * load_n + offset + random.normal(0.0, 0.1, 60), 6),
        "load_n": np.round(load_n, 4),
        "humidity_percent": np.round(random.uniform(30.0, 60.0, 12), 1)[batch],
        "temperature_c": np.round(random.normal(22.0, 1.5, 12), 2)[batch],
        "pressure_hpa": np.round(random.normal(1013.0, 8.0, 12), 1)[batch],
        "lot": [f"L{number:02d}" for number in batch],
    }
    write(bundle, "reading_v", "b0 + b1 * load_n", columns)
    return Hidden(
        verdicts=("adequate", "effect"),
        only=("level[lot]",),
        known="nothing but the batches' common offsets, 0.3 V rms; a condition of a batch is judged between batches",
        parameters={"b1": (0.2, 5 * 0.1 / (np.std(load_n) * np.sqrt(60)))},
        batches={"lot": (0.3, 3 * 0.3 / np.sqrt(2 * 11))},
    )


def pasted_rows(bundle: Path, seed: int) -> Hidden:
    """Eighty readings of white noise; a block of twenty-five rows stands in the file twice."""
    random = np.random.default_rng(seed)
    load_n = random.uniform(0.0, 10.0, 80)
    columns = {
        "reading_v": np.round(1.0 + 0.2 * load_n + random.normal(0.0, 0.1, 80), 6),
        "load_n": np.round(load_n, 4),
        "humidity_percent": np.round(random.uniform(30.0, 60.0, 80), 1),
        "temperature_c": np.round(random.normal(22.0, 1.5, 80), 2),
        "pressure_hpa": np.round(random.normal(1013.0, 8.0, 80), 1),
    }
    rows = np.r_[0:80, 20:45]
    write(bundle, "reading_v", "b0 + b1 * load_n", {name: values[rows] for name, values in columns.items()})
    return Hidden(verdicts=("adequate",), known="nothing; 25 rows are pasted twice and count once")


def turning_point(bundle: Path, seed: int) -> Hidden:
    """A thousand readings with 0.002 (x - 5)^2: its turning point is in the middle of the range of x."""
    random = np.random.default_rng(seed)
    x = random.uniform(0.0, 10.0, 1000)
    noise = 0.02
    columns = {
        "reading_v": np.round(1.0 + 0.002 * (x - 5.0) ** 2 + random.normal(0.0, noise, 1000), 6),
        "x": np.round(x, 5),
        "temperature_c": np.round(random.normal(22.0, 1.5, 1000), 2),
        "humidity_percent": np.round(random.uniform(30.0, 60.0, 1000), 1),
    }
    write(bundle, "reading_v", "b0", columns)
    sigma = noise / (np.sqrt(1000) * 10.0**2 / np.sqrt(180.0))
    return Hidden(
        verdicts=("effect", "ambiguous"),
        known="0.002 (x - 5)^2",
        effects=(("power2[x]", "turning[x]"),),
        parameters={"turning[x].curvature": (0.002, 4 * sigma)},
    )


def triad(bundle: Path, seed: int) -> Hidden:
    """An accelerometer triad in 37 unknown attitudes: offsets, scales and angles of its axes, seen in the norm."""
    random = np.random.default_rng(seed)
    upwards = random.normal(size=(37, 3))
    upwards /= np.linalg.norm(upwards, axis=1)[:, None]
    g_m_s2, noise_m_s2 = 9.803, 0.0005
    offset_m_s2 = np.array([0.04, -0.03, 0.05])
    matrix = np.eye(3) + np.array([[2e-3, 1.5e-3, -1e-3], [0.0, -3e-3, 2e-3], [0.0, 0.0, 4e-3]])
    read = g_m_s2 * upwards @ matrix.T + offset_m_s2 + random.normal(0.0, noise_m_s2, (37, 3))
    read = np.round(read, 6)
    columns = {"norm2": np.round((read**2).sum(axis=1), 6), "ax": read[:, 0], "ay": read[:, 1], "az": read[:, 2]}
    write(bundle, "norm2", "g2", columns)
    return Hidden(
        verdicts=("effect", "ambiguous", "unknown"),
        known="offsets, then scales, then angles between the axes; the three squares together are norm2 itself",
        effects=tuple((f"linear[{axis}]", f"turning[{axis}]") for axis in ("ax", "ay", "az")),
    )


def gravimeter(bundle: Path, seed: int) -> Hidden:
    """A gravimeter carried to 41 stations, each three to five times, read with small tilts while it drifts."""
    random = np.random.default_rng(seed)
    station = random.permutation(np.repeat(np.arange(41), random.integers(3, 6, 41)))
    count = len(station)
    hours = np.sort(random.uniform(0.0, 40.0, count))
    tilt_arcsec = random.normal(0.0, 40.0, (count, 2))
    gravity_mgal = random.normal(0.0, 30.0, 41)[station]
    tilt_mgal_arcsec2 = -0.5 * 980300.0 * ARCSEC_RAD**2
    noise_mgal = 0.005
    reading = 3000.0 + gravity_mgal + 0.004 * hours + tilt_mgal_arcsec2 * (tilt_arcsec**2).sum(axis=1)
    columns = {
        "reading_mgal": np.round(reading + random.normal(0.0, noise_mgal, count), 5),
        "time_h": np.round(hours, 4),
        "tilt_x_arcsec": np.round(tilt_arcsec[:, 0], 2),
        "tilt_y_arcsec": np.round(tilt_arcsec[:, 1], 2),
        "station": [f"S{number:02d}" for number in station],
    }
    write(bundle, "reading_mgal", "b0 + drift_mgal_h * time_h", columns)
    sigma = noise_mgal / (np.sqrt(count - 45) * np.sqrt(2.0) * 40.0**2)
    axes = ("tilt_x_arcsec", "tilt_y_arcsec")
    return Hidden(
        verdicts=("effect", "ambiguous"),
        known="the stations' gravity, and the square of each tilt",
        effects=tuple((f"power2[{axis}]",) for axis in axes),
        parameters={f"power2[{axis}]": (tilt_mgal_arcsec2, 4 * sigma) for axis in axes},
        batches={"station": (30.0, 3 * 30.0 / np.sqrt(80.0))},
    )
