"""What a recording says of the package and the heads when there is no rig file: the bundle of another laboratory."""

from __future__ import annotations

import math
from pathlib import Path

from rigctl.campaign.recording import Header
from rigctl.campaign.stated import heads_of
from rigctl.core.errors import DataError
from rigctl.files.package import HeadSettings, Package
from rigctl.files.rig_file import parse_rig

STANDARD_G = 9.80665
"""Where nobody has given the local one."""

UNKNOWN = math.inf
"""Relative uncertainty of a data sheet nobody has given."""

ROUGHLY = 1.0
"""Relative uncertainty of a gain that a recording mentions: as good as none."""

_NOMINAL = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def recorded_calibration(header: Header) -> tuple[Package, dict[str, HeadSettings], float]:
    """Package, heads and gravity: from the rig file, else from what an imported recording says; `DataError`."""
    if header.rig_toml is None:
        g_m_s2 = float(header.constants.get("g_m_s2", STANDARD_G))
        return recorded_package(header), heads_of(header), g_m_s2
    rig_file = parse_rig(header.rig_toml, Path("rig file"))
    if rig_file.package is None:
        raise DataError("the recording's rig file has no [package]: what was calibrated is not known")
    return rig_file.package, heads_of(header), rig_file.constant("g_m_s2", STANDARD_G)


def recorded_package(header: Header) -> Package:
    """A three-axis package in the nominal mountings of the experiment; gains from the recording's constants.

    The sensors' resonance is that of the paper (Lucente et al. 2022), without the weight of a data sheet.
    """
    given = "gain_v_per_m_s2" in header.constants
    # Else a place to start from: without a belief in it, it has no weight in the fit.
    gain = float(header.constants["gain_v_per_m_s2"]) if given else 100.0
    free = {"u_gain": ROUGHLY if given else UNKNOWN, "u_frequency": UNKNOWN, "u_q": UNKNOWN}
    sensor = {
        # The hanging mass is stiffer: with one transducer gain and 1/w0^2 fall by the same ratio.
        "pendulum": {"gain_v_per_m_s2": gain * (3.5 / 4.53) ** 2, "frequency_hz": 4.53, "q": 10.0, **free},
        "flag": {"gain_v_per_m_s2": gain, "frequency_hz": 3.5, "q": 10.0, **free},
    }
    axes = {name: {"cube_axis": name, "nominal": axis, "sensor": sensor} for name, axis in _NOMINAL.items()}
    configurations = {"pendulum": {"i": "+y", "j": "+z", "k": "+x"}, "flag": {"i": "+y", "j": "+x", "k": "-z"}}
    return Package.model_validate(
        {"name": header.title or "recorded", "axes": axes, "configurations": configurations}
    )


def recorded_faces(header: Header) -> dict[str, str]:
    """Faces that hold for the whole recording, by head."""
    return {name: laser.face for name, laser in header.lasers.items() if laser.face}
