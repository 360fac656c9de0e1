"""The files a store was made with: its campaign, its rig, and the simulated world beside it."""

from __future__ import annotations

from pathlib import Path

from rigctl.campaign.store.parts import parts_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError
from rigctl.files.campaign_file import CampaignFile, parse_campaign
from rigctl.files.rig_file import RigFile, parse_rig

TRUTH_SUFFIX = ".truth.toml"


def campaign_of(store: Store) -> CampaignFile:
    """The campaign file a store was made with; `DataError` for an imported recording."""
    return parse_campaign(parts_of(store)[0].toml, store.path)


def rig_file_of(store: Store, *, with_world: bool = False) -> RigFile:
    """The rig file a store was made with. Only what runs the simulated instruments asks for the world."""
    if store.header.rig_toml is None:
        raise DataError(f"{store.path}: an imported recording has no rig file")
    text = store.header.rig_toml
    truth = truth_path(store.path)
    if with_world and store.header.world_sha256 is not None:
        if not truth.exists():
            raise DataError(f"{store.path}: {truth} is missing; the simulated world cannot be made again without it")
        text = f"{text}\n\n{truth.read_text(encoding='utf-8')}"
    rig_file = parse_rig(text, store.path)
    # A world edited since would measure the rest of the campaign in another nature.
    if with_world and rig_file.world_sha256 != store.header.world_sha256:
        raise DataError(
            f"{truth}, or a file that it names, is not the world {store.path} was measured in; restore the original"
        )
    return rig_file


def truth_path(store: Path) -> Path:
    """Where a simulated world's secrets go; no analysis reads it."""
    return store.with_name(store.name + TRUTH_SUFFIX)
