"""Which instruments of a rig file make the sensing-axis bench, and which columns its runs have."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.campaigns import Instruments
from procedures.sensing_axis.bench import Bench
from rigctl.campaign.recording import OWN_CLOCK, ChannelInfo, LaserInfo
from rigctl.core.errors import ConfigError
from rigctl.core.interfaces import Channel
from rigctl.experiments.sensing_axis.observe.recorded import STANDARD_G
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL, LASER_PREFIX
from rigctl.files.rig_file import RigFile

KINDS = {"readout": "accelerometer"}
"""What a channel measures where the instrument only knows what it reads."""


def bench_of(rig: Instruments) -> Bench:
    """The sensing-axis bench of a rig; `ConfigError` when the rig file lacks a part of it."""
    if rig.file.package is None:
        raise ConfigError(f"{rig.file.path}: [package] is missing; add what is to be calibrated")
    lasers = tuple(rig.by_role("displacement"))
    columns = {channel.name for meter in lasers for channel in meter.channels()}
    readout = rig.only("readout")
    _require_names(rig.file, columns, readout.channels()[0].name)
    thermometers = rig.by_role("thermometer")
    return Bench(
        rotation=rig.only("rotation"),
        linear=rig.only("linear"),
        lasers=lasers,
        readout=readout,
        thermometer=thermometers[0] if thermometers else None,
        package=rig.file.package,
        heads={name: head for name, head in rig.file.heads.items() if name in columns},
        g_m_s2=rig.file.constant("g_m_s2", STANDARD_G),
        clock=rig.clock,
    )


def _require_names(file: RigFile, heads: set[str], channel: str) -> None:
    """Columns are known by their names wherever a recording goes: the rig file has to use those."""
    for name in sorted(heads):
        if not (name.startswith(LASER_PREFIX) and name.endswith("_mm")):
            raise ConfigError(f"{file.path}: heads: '{name}' is no head's name; call it {LASER_PREFIX}1_mm or alike")
        if name not in file.lasers:
            raise ConfigError(f"{file.path}: [lasers.{name}] is missing; say where the head stands")
    if channel != ACCEL:
        raise ConfigError(f"{file.path}: the readout's channel is '{channel}'; call it {ACCEL}")


def channels(rig: Instruments) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns that runs will have, and where the laser heads look."""
    columns = {"stage_x_mm": ChannelInfo("mm", "position")}
    for role in ("linear", "displacement", "readout"):
        for instrument in rig.by_role(role):
            columns |= {c.name: _info(c, KINDS.get(role, c.kind)) for c in instrument.channels()}
    return columns, {name: LaserInfo(tilt_deg=head.tilt_deg) for name, head in rig.file.lasers.items()}


def _info(channel: Channel, kind: str) -> ChannelInfo:
    clock = None if channel.clock_u_s is None else OWN_CLOCK
    return ChannelInfo(
        channel.unit, kind, None, channel.full_scale, channel.latency_s, clock=clock, clock_u_s=channel.clock_u_s
    )
