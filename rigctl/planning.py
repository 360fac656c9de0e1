"""From what the workbench would measure next to a campaign that a rig can carry out."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl import config
from rigctl.campaign.parts import parts_of
from rigctl.campaign.store import Store
from rigctl.errors import DataError
from rigctl.kinds import kind_of
from rigctl.workbench.study import Proposal


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
    return text_of(campaign, title, _rig_seen_from(path, store, campaign.rig), procedure, effects)


def text_of(
    campaign: config.CampaignFile, title: str, rig: str, procedure: Mapping[str, Any], effects: Sequence[str]
) -> str:
    """A campaign file like `campaign`; entries of `procedure` that are lists of tables come last, as such."""
    lines = [f"experiment = {_toml(campaign.experiment)}", f"title = {_toml(title)}", f"rig = {_toml(rig)}"]
    lines += [f"on_terminal_lost = {_toml(campaign.on_terminal_lost)}", "", "[procedure]"]
    lines += [f"{name} = {_toml(value)}" for name, value in procedure.items() if not _tables(value)]
    for name, value in procedure.items():
        for table in value if _tables(value) else ():
            lines += ["", f"[[procedure.{name}]]", *(f"{key} = {_toml(each)}" for key, each in table.items())]
    lines += ["", "[model]", f"effects = {_toml(list(effects))}", ""]
    return "\n".join(lines)


def _tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _rig_seen_from(path: Path, store: Store, name: str) -> str:
    """The rig file as `path` has to name it; as the store's campaign did where it is not found."""
    for place in (path.parent, Path(parts_of(store)[0].path).parent, Path(), Path("campaigns")):
        if name and (place / name).is_file():
            return Path(os.path.relpath(place / name, path.parent)).as_posix()
    return name
