from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.core.errors import DataError

SENSING_TOML = """\
format = 1
experiment = "sensing-axis"
title = "X and Y, night run"
started = 2026-11-21T01:00:00Z

[constants]
g_m_s2 = 9.803
gain_v_per_m_s2 = 100

[channels.accel_v]
unit = "V"
kind = "accelerometer"
noise_rms = 0.0004
full_scale = 10.0
latency_s = 1e-5

[channels.stage_x_mm]
unit = "mm"
kind = "position"

[lasers.laser_1_mm]
face = "x"
tilt_deg = 5.0

[lasers.laser_2_mm]
tilt_deg = 5
"""

PLATFORM_TOML = """\
format = 1
experiment = "rotating-platform"
title = "platform"

[constants]
g_m_s2 = 9.81
gain_q_a_v_per_m_s2 = 846.73
gain_q_b_v_per_m_s2 = 804.32
gain_dm1_y_v_per_m_s2 = 805.0
gain_dm1_z_v_per_m_s2 = 825.0

[channels.q_a_v]
full_scale = 10.0
"""

INFLIGHT_TOML = """\
format = 1
experiment = "inflight-calibration"

[constants]
orbit_period_s = 5950.0
eccentricity = 5e-3
"""

TABLE_TOML = """\
format = 1
experiment = "table"
title = "load cell"

[table]
response = "deflection_in"
baseline = "b0 + b1 * load_lb"
start = { b0 = 0.0, b1 = 1e-6 }
order = "time_s"
block = "day"
"""

INFLIGHT_COLUMNS = [
    "t_s",
    "m1_x",
    "m1_y",
    "m1_z",
    "m2_x",
    "m2_y",
    "m2_z",
    "t_xx",
    "t_xz",
    "t_yy",
    "t_zz",
    "t_xy",
    "t_yz",
    "dw_x",
    "dw_y",
    "dw_z",
    "att_x",
    "att_y",
    "att_z",
    "command_x",
    "command_y",
    "command_z",
    "temperature_1_k",
]


@dataclass
class BundleText:
    """A bundle as a laboratory would write it, file by file, so that a test can spoil one."""

    path: Path
    toml: str
    tables: dict[str, list[list[str]]] = field(default_factory=dict)
    raw: dict[str, bytes] = field(default_factory=dict)

    def table(self, name: str, header: str, *rows: str) -> None:
        self.tables[name] = [line.split(",") for line in (header, *rows)]

    def columns(self, name: str, **columns: np.ndarray) -> None:
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        self.tables[name] = [list(columns), *([repr(x) for x in row] for row in rows)]

    def set(self, name: str, line: int, column: str, text: str) -> None:
        """Replace one field; `line` as in the file."""
        table = self.tables[name]
        table[line - 1][table[0].index(column)] = text

    def write(self) -> Path:
        files = {"recording.toml": self.toml.encode()}
        files |= {name: "".join(",".join(row) + "\n" for row in rows).encode() for name, rows in self.tables.items()}
        for name, data in {**files, **self.raw}.items():
            target = self.path / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        return self.path


@pytest.fixture
def sensing(tmp_path):
    bundle = BundleText(tmp_path / "night", SENSING_TOML)
    bundle.table(
        "runs.csv",
        "run_id,axis,configuration,mounting,theta_deg,approach,frequency_hz,amplitude_mm,"
        "temperature_c,start_s,valid,laser_2_face,pressure_hpa,shift",
        "1,X,pendulum,1,0.1,+1,0.5,5,21.5,10,1,y,1013.2,late",
        "2,Y,flag,2,-0.1,-1,0.3,5,,20.5,1,-y,,early",
        "3,Z,flag,3,0.30000000000000004,,0.6,5.0,nan,30,0,,1013.5,",
    )
    rng = np.random.default_rng(1)
    for run_id in "123":
        t_s = np.arange(400) * 0.01
        bundle.columns(
            f"runs/{run_id}.csv",
            t_s=t_s,
            stage_x_mm=5 * np.sin(2 * np.pi * {"1": 0.5, "2": 0.3, "3": 0.6}[run_id] * t_s),
            accel_v=rng.normal(size=t_s.size),
            laser_1_mm=np.where(t_s < 3, rng.normal(size=t_s.size), np.nan),
            laser_2_mm=rng.normal(size=t_s.size),
        )
    return bundle


@pytest.fixture
def platform(tmp_path):
    bundle = BundleText(tmp_path / "platform", PLATFORM_TOML)
    bundle.table(
        "runs.csv",
        "run_id,pattern,modulation_period_s,sample_rate_hz,external,v_z_v,external_period_s,"
        "temperature_c,start_s,valid,g_sign",
        "1,b,60,10,constant,0.5,,22,0,1,",
        "2,custom,60,10,sine,1,3600,22,100,1,",
        "3,flip,,10,,,,22,200,1,-1",
        "4,noise,,10,,,,22,300,1,",
    )
    bundle.table(
        "patterns.csv",
        "pattern,period_s,dwell_index,sign_cos_theta,start_s,stop_s",
        "custom,60,0,+1,5.000000,25.5",
        "custom,60,1,-1,35,55",
    )
    rng = np.random.default_rng(2)
    t_s = np.arange(600) * 0.1 + 0.05
    moving = ((t_s % 30 > 10) & (t_s % 30 < 20)).astype(float)
    for run_id, dm1_z_v in (("1", np.full(t_s.size, 0.5)), ("2", np.sin(2.0 * np.pi * t_s / 3600.0))):
        bundle.columns(
            f"runs/{run_id}.csv",
            t_s=t_s,
            theta_deg=np.where(t_s < 30, 0.0, 180.0),
            q_a_v=rng.normal(size=t_s.size),
            q_b_v=rng.normal(size=t_s.size),
            dm1_y_v=np.zeros(t_s.size),
            dm1_z_v=dm1_z_v,
            moving=moving,
        )
    for run_id in "34":
        bundle.columns(
            f"runs/{run_id}.csv",
            t_s=t_s,
            q_a_v=rng.normal(size=t_s.size),
            q_b_v=rng.normal(size=t_s.size),
        )
    return bundle


@pytest.fixture
def inflight(tmp_path):
    bundle = BundleText(tmp_path / "inflight", INFLIGHT_TOML)
    bundle.table(
        "runs.csv",
        "run_id,session,orbits,sample_period_s,calibration_frequency_hz,amplitude,amplitude_unit,phase_rad,"
        "start_s,valid",
        "a,dx+dz,10,5,,,,,0,1",
        "b,dy,10,5,1.22689e-3,1e-2,rad,-1.5707963267948966,59500,1",
        "c,k2c_1,10,5,8.9916e-3,9e-6,m,0,119000,1",
    )
    rng = np.random.default_rng(3)
    t_s = np.arange(400) * 5.0
    for run_id in "abc":
        columns = {name: 1e-9 * rng.normal(size=t_s.size) for name in INFLIGHT_COLUMNS}
        columns["temperature_1_k"] += 285.0
        columns["t_zz"] = -columns["t_xx"] - columns["t_yy"]
        bundle.columns(f"runs/{run_id}.csv", **{**columns, "t_s": t_s})
    return bundle


@pytest.fixture
def readings(tmp_path):
    bundle = BundleText(tmp_path / "cell", TABLE_TOML)
    rows = [
        f"{150000 * (i % 5)},{0.11 * (i % 5) + 1e-4 * i!r},{float(i)!r},{'Mon' if i < 6 else 'Tue'},"
        for i in range(12)
    ]
    bundle.table("readings.csv", "load_lb,deflection_in,time_s,day,empty", *rows)
    return bundle


@pytest.fixture(params=["sensing", "platform", "inflight", "readings"])
def any_bundle(request):
    return request.getfixturevalue(request.param)


@pytest.fixture
def refusal():
    """The message with which a bundle is refused, without the directory it lies in."""

    def read(path: Path) -> str:
        with pytest.raises(DataError) as caught:
            read_bundle(path)
        message = str(caught.value)
        assert "\n" not in message
        assert message.startswith(str(path))
        return message.removeprefix(f"{path.parent}/")

    return read
