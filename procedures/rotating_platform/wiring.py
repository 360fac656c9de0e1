"""Which instruments of a rig file make the platform's bench, and which columns its runs have."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.campaigns import Instruments
from procedures.rotating_platform.bench import TILT_Y, TILT_Z, PlatformBench
from procedures.rotating_platform.tables import Procedure
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.core.errors import ConfigError
from rigctl.core.interfaces import TimedRotationStage
from rigctl.experiments.rotating_platform.columns import COLUMNS

Q_A, Q_B = "q_a_v", "q_b_v"


def bench_of(rig: Instruments, procedure: Procedure) -> PlatformBench:
    """The platform's bench of a rig; `ConfigError` when the rig file lacks a part of it."""
    path, platform, readout = rig.file.path, rig.only("rotation"), rig.only("readout")
    if not isinstance(platform, TimedRotationStage):
        raise ConfigError(f"{path}: {platform.name} cannot be told how long a turn takes; a newport-xps can")
    voltmeter, source = rig.only("voltmeter"), rig.only("source")
    for meter, name in ((readout, Q_A), (voltmeter, Q_B)):
        if (channel := meter.channels()[0].name) != name:
            raise ConfigError(f"{path}: the channel of {meter.name} is '{channel}'; call it {name}")
    if {channel.name for channel in source.channels()} != {TILT_Y, TILT_Z}:
        raise ConfigError(f"{path}: the outputs of {source.name} have to be {TILT_Y} and {TILT_Z}")
    for name in COLUMNS.constants:
        if name not in rig.file.constants:
            # Without them what is measured could not be analysed; said before the first run, not after the last.
            raise ConfigError(f"{path}: [constants.{name}] is missing; add it")
    thermometers = rig.by_role("thermometer")
    return PlatformBench(
        platform=platform,
        readout=readout,
        voltmeter=voltmeter,
        source=source,
        thermometer=thermometers[0] if thermometers else None,
        clock=rig.clock,
        settle_s=procedure.settle_s,
        temperature_every_s=procedure.temperature_every_s,
    )


def channels(rig: Instruments) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns that runs will have; there are no laser heads."""
    infos = {
        "theta_deg": ChannelInfo("deg", "angle"),
        "moving": ChannelInfo("", "flag"),
        "temperature_c": ChannelInfo("degC", "temperature"),
    }
    for role in ("readout", "voltmeter"):
        for instrument in rig.by_role(role):
            infos |= {
                c.name: ChannelInfo(c.unit, "accelerometer", full_scale=c.full_scale, latency_s=c.latency_s)
                for c in instrument.channels()
            }
    # What the source may give at most is no full scale: at its limit it is not saturated.
    commands = (c for instrument in rig.by_role("source") for c in instrument.channels())
    return infos | {c.name: ChannelInfo(c.unit, "command", latency_s=c.latency_s) for c in commands}, {}
