"""From what the workbench would measure next to a campaign that a rig can carry out."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from procedures.campaigns import campaigns_of
from rigctl.campaign.store.parts import parts_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError
from rigctl.core.toml import to_toml
from rigctl.core.whole_file import writing
from rigctl.files.campaign_file import CampaignFile, parse_campaign
from rigctl.workbench.next.recommendation import Recommendation
from rigctl.workbench.study import Proposal
from rigctl.workbench.workbench import Workbench


def require_rig(store: Store) -> str:
    """The campaign that made a store; `DataError` where no rig of ours did, and so none could go on."""
    text = store.header.campaign_toml
    if text is None:
        raise DataError(f"{store.path}: no rig of ours measured it: leave out --write and take the values shown")
    return text


def write_next(workbench: Workbench, path: Path, tell: Callable[[str], None]) -> Recommendation:
    """Write what to measure next as a campaign file; `DataError` without a rig, or with nothing to measure."""
    # First: what to measure takes minutes to find, and cannot be written without a rig.
    require_rig(workbench.store)
    found = workbench.recommend(tell)
    if not found.runs:
        raise DataError(f"{workbench.store.path}: there is nothing to write: {found.words}")
    title, effects = f"Next: {found.purpose}", workbench.current.effects
    text = campaign_text(workbench.store, found.runs, title, path, effects)
    with writing(path):
        path.write_text(text, encoding="utf-8")
    return found


def campaign_text(store: Store, runs: Sequence[Proposal], title: str, path: Path, effects: Sequence[str]) -> str:
    """A campaign file for these runs, on the rig of a store; `path` is where it will stand.

    Effects of files of one's own are named too: the file has to be passed when the campaign is run.
    """
    campaign = parse_campaign(require_rig(store), store.path)
    procedure = campaigns_of(campaign.experiment, store.path).further(store, runs, campaign)
    return text_of(campaign, title, _rig_seen_from(path, store, campaign.rig), procedure, effects)


def text_of(
    campaign: CampaignFile, title: str, rig: str, procedure: Mapping[str, Any], effects: Sequence[str]
) -> str:
    """A campaign file like `campaign` with another title, rig, procedure and model."""
    named = {"experiment": campaign.experiment, "title": title, "rig": rig}
    planned = {"procedure": procedure, "model": {"effects": list(effects)}}
    # Keys that nobody wrote stay unwritten, so that a later version's defaults apply.
    kept = campaign.model_dump(mode="json", exclude={"path", "text", *named, *planned}, exclude_defaults=True)
    return to_toml({**named, **kept, **planned})


def _rig_seen_from(path: Path, store: Store, name: str) -> str:
    """The rig file as `path` has to name it; as the store's campaign did where it is not found."""
    # A rig file is named relative to its campaign file: beside the new one, beside the old one, here, where ours are.
    for place in (path.parent, Path(parts_of(store)[0].path).parent, Path(), Path("campaigns")):
        if name and (place / name).is_file():
            return Path(os.path.relpath(place / name, path.parent)).as_posix()
    return name
