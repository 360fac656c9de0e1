"""From what the workbench would measure next to a campaign that a rig can carry out."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from procedures.bench import Bench, SetPoint
from procedures.tables import Procedure
from rigctl import config
from rigctl.campaign.parts import parts_of
from rigctl.campaign.store import Store
from rigctl.errors import ConfigError, DataError, LimitError
from rigctl.kinds import kind_of
from rigctl.kinds.sensing_axis import bench_of, place_of, scan_of
from rigctl.origin import rig_file_of
from rigctl.rig import Rig
from rigctl.workbench.recommend import Allowed
from rigctl.workbench.study import Proposal

RUNNABLE = "sensing-axis"
"""The experiment whose proposals are set-points of a scan."""


def allowed_by(store: Store) -> Allowed | None:
    """Which proposals the rig of a store can carry out; None where there is no rig to ask."""
    if store.header.experiment != RUNNABLE or store.header.rig_toml is None or store.header.campaign_toml is None:
        return None
    procedure = _procedure(config.parse_campaign(store.header.campaign_toml, store.path))
    axis, configuration = place_of(store)
    return within(rig_file_of(store), procedure, axis, configuration)


def within(rig_file: config.RigFile, procedure: Procedure, axis: str, configuration: str) -> Allowed:
    """Which proposals a rig can carry out: its stages' limits, its recorders' memories, the sensor's range."""
    bench = bench_of(Rig(_without_world(rig_file)))

    def allowed(proposal: Proposal) -> bool:
        return _possible(bench, _set_point(proposal.settings, procedure, axis, configuration))

    return allowed


def require_rig(store: Store) -> str:
    """The campaign that made a store; `DataError` where no rig of ours did, and so none could go on."""
    text = store.header.campaign_toml
    if text is None:
        raise DataError(f"{store.path}: no rig of ours measured it: leave out --write and take the values shown")
    return text


def campaign_text(store: Store, runs: Sequence[Proposal], title: str, path: Path, effects: Sequence[str]) -> str:
    """A campaign file for these runs, on the rig of a store; `path` is where it will stand.

    Effects of files of one's own are named too: the file has to be passed when the campaign is run.
    """
    campaign = config.parse_campaign(require_rig(store), store.path)
    procedure = kind_of(campaign.experiment, store.path).further(store, runs, campaign)
    return text_of(campaign.experiment, title, _rig_seen_from(path, store, campaign.rig), procedure, effects)


def scan_text(
    title: str,
    rig: str,
    axis: str,
    configuration: str,
    runs: Sequence[Proposal],
    effects: Sequence[str],
    like: Procedure,
) -> str:
    """A scan given as a list of runs, in its order; amplitudes and rates as in `like` where runs do not say."""
    return text_of(RUNNABLE, title, rig, scan_of(axis, configuration, runs, like), effects)


def text_of(experiment: str, title: str, rig: str, procedure: Mapping[str, Any], effects: Sequence[str]) -> str:
    """A campaign file; entries of `procedure` that are lists of tables come last, as such."""
    lines = [f"experiment = {_toml(experiment)}", f"title = {_toml(title)}", f"rig = {_toml(rig)}", "", "[procedure]"]
    lines += [f"{name} = {_toml(value)}" for name, value in procedure.items() if not _tables(value)]
    for name, value in procedure.items():
        for table in value if _tables(value) else ():
            lines += ["", f"[[procedure.{name}]]", *(f"{key} = {_toml(each)}" for key, each in table.items())]
    lines += ["", "[model]", f"effects = {_toml(list(effects))}", ""]
    return "\n".join(lines)


def _tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)


_NOWHERE = "tcp://127.0.0.1:9"


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _procedure(campaign: config.CampaignFile) -> Procedure:
    return config.validated(Procedure, campaign.procedure, campaign.path, "procedure")


def _set_point(settings: Mapping[str, Any], procedure: Procedure, axis: str, configuration: str) -> SetPoint:
    return SetPoint(
        axis,
        configuration,
        0,
        float(settings["angle_deg"]),
        float(settings["frequency_hz"]),
        float(settings.get("amplitude_mm", procedure.amplitude_mm)),
        float(settings.get("dwell_s", procedure.dwell_s)),
        procedure.sample_rate_hz,
        int(settings.get("approach", 1)),
    )


def _without_world(rig_file: config.RigFile) -> config.RigFile:
    """The rig for its limits alone: simulated instruments at an address that nobody opens."""
    nowhere = {
        name: each.model_copy(update={"address": _NOWHERE}) if each.simulated else each
        for name, each in rig_file.instruments.items()
    }
    clock = rig_file.rig.model_copy(update={"clock": "real"})
    return rig_file.model_copy(update={"instruments": nowhere, "rig": clock, "world": None})


def _possible(bench: Bench, point: SetPoint) -> bool:
    try:
        bench.check(point, lasers=bench.spots_stay(point))
        bench.check_level(point)
    except (LimitError, ConfigError):
        return False
    return True


def _rig_seen_from(path: Path, store: Store, name: str) -> str:
    """The rig file as `path` has to name it; as the store's campaign did where it is not found."""
    for place in (path.parent, Path(parts_of(store)[0].path).parent, Path(), Path("campaigns")):
        if name and (place / name).is_file():
            return Path(os.path.relpath(place / name, path.parent)).as_posix()
    return name
