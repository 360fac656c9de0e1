"""Files as they should be, to be spoilt, and odd pieces to spoil them with."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]

Bundle = dict[str, bytes]
"""Files by name."""

ODD_TEXT = (
    "",
    " ",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e308",
    "-1e308",
    "1e39",
    "1e-320",
    "1_0",
    "0x10",
    "٣",
    "½",
    "\x00",
    "\x1b[2J",
    "'",
    '"',
    '""',
    '"a\nb"',
    ",",
    ";",
    "\t",
    "1,5",
    "1e",
    "+",
    "-0",
    "0",
    "9" * 500,
    "A" * 5000,
    "../../etc/passwd",
    "{}",
    "[1, 2]",
    "true",
    "2026-11-21T01:00:00Z",
    "0001-01-01T00:00:00+23:59",
    "\N{ZERO WIDTH SPACE}",
    "\u202e",
    "é",
    "e\u0301",
)
ODD_TOML = (
    "x = " + "[" * 60 + "]" * 60,
    "x = " + "{a = " * 40 + "1" + "}" * 40,
    ".".join("ab" * 30) + " = 1",
    "[[runs]]\n" * 3,
    "x = " + "9" * 30,
    "x = " + "9" * 5000,
    "x = 1e400",
    "x = nan",
    "x = 1979-05-27",
    "x = 07:32:00",
    "x = '''\na\n'''",
    'x = "\\u0000\\n"',
    "x = true",
    "format = 1",
    "[constants]",
    "[table]",
    "[channels]\naccel_v = 3",
    "[lasers]\n[lasers]",
    "constants = []",
    "table = 1",
    "started = 0001-01-01T00:00:00+23:59",
    "title = 7",
    "[x]\ny = [1, 'a', {z = []}]",
    "\ufeff",
    "\x00",
    "[table.start]\nb0 = 1e39",
    "[package]\naxes = 1",
    "[instruments]\nx = 1",
    "procedure = 3",
)


@functools.cache
def bundles() -> list[Bundle]:
    """One of every experiment, and some that are shipped."""
    return [_sensing(), _platform(), _inflight(), _table(), *map(_directory, ("norris", "misra", "gauss"))]


def _directory(name: str) -> Bundle:
    folder = ROOT / "examples" / name
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.*") if path.is_file()}


@functools.cache
def shipped(pattern: str) -> list[bytes]:
    """Rig and campaign files of the project."""
    return [path.read_bytes() for path in sorted((ROOT / "campaigns").glob(pattern))]


@functools.cache
def effects() -> list[bytes]:
    """Files of effects."""
    return [(ROOT / "examples/unknown-effect/my_effect.py").read_bytes()]


def _columns(**columns: Any) -> bytes:
    rows = zip(*(np.asarray(each).tolist() for each in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows), ""]).encode()


def _sensing() -> Bundle:
    t_s = np.arange(80) * 0.05
    run = _columns(t_s=t_s, stage_x_mm=5 * np.sin(np.pi * t_s), accel_v=np.cos(t_s), laser_1_mm=np.sin(t_s))
    return {
        "recording.toml": b'format = 1\nexperiment = "sensing-axis"\ntitle = "X"\nstarted = 2026-11-21T01:00:00Z\n'
        b"[constants]\ng_m_s2 = 9.803\ngain_v_per_m_s2 = 100.0\n"
        b'[channels.accel_v]\nunit = "V"\nnoise_rms = 0.0004\nfull_scale = 10.0\n'
        b'[lasers.laser_1_mm]\nface = "x"\ntilt_deg = 5.0\n',
        "runs.csv": b"run_id,axis,configuration,mounting,theta_deg,approach,frequency_hz,amplitude_mm,"
        b"temperature_c,valid\n1,X,pendulum,1,0.1,1,0.5,5,21.5,1\n2,Y,flag,2,-0.1,-1,0.5,5,,1\n",
        "runs/1.csv": run,
        "runs/2.csv": run,
    }


def _platform() -> Bundle:
    t_s = np.arange(150) * 0.4
    turned = np.where(t_s % 60 < 30, 0.0, 180.0)
    level = np.sin(t_s)
    return {
        "recording.toml": b'format = 1\nexperiment = "rotating-platform"\n[constants]\ng_m_s2 = 9.81\n',
        "runs.csv": b"run_id,pattern,modulation_period_s,sample_rate_hz,external,v_z_v\n"
        b"1,custom,60,2.5,constant,0.5\n",
        "patterns.csv": b"pattern,period_s,dwell_index,sign_cos_theta,start_s,stop_s\n"
        b"custom,60,0,1,5,25\ncustom,60,1,-1,35,55\n",
        "runs/1.csv": _columns(t_s=t_s, theta_deg=turned, q_a_v=level, q_b_v=level, moving=np.zeros(150)),
    }


def _inflight() -> Bundle:
    names = "m1_x m1_y m1_z m2_x m2_y m2_z t_xx t_xz t_yy t_zz t_xy t_yz dw_x dw_y dw_z att_x att_y att_z"
    t_s = np.arange(60) * 5.0
    columns = {name: 1e-9 * np.sin(t_s) for name in [*names.split(), "command_x", "command_y", "command_z"]}
    return {
        "recording.toml": b'format = 1\nexperiment = "inflight-calibration"\n'
        b"[constants]\norbit_period_s = 5950.0\neccentricity = 5e-3\n",
        "runs.csv": b"run_id,session,orbits,sample_period_s,calibration_frequency_hz,amplitude,amplitude_unit\n"
        b"a,dx+dz,10,5,,,\n",
        "runs/a.csv": _columns(t_s=t_s, **columns),
    }


def _table() -> Bundle:
    rows = "".join(
        f"{150 * (i % 5)},{0.11 * (i % 5) + 1e-4 * i!r},{i},{'Mon' if i < 6 else 'Tue'}\n" for i in range(12)
    )
    return {
        "recording.toml": b'format = 1\nexperiment = "table"\n[table]\nresponse = "deflection_in"\n'
        b'baseline = "b0 + b1 * load_lb"\nstart = { b0 = 0.0, b1 = 1e-6 }\norder = "time_s"\nblock = "day"\n',
        "readings.csv": f"load_lb,deflection_in,time_s,day\n{rows}".encode(),
    }
