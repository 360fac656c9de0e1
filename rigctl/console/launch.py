"""What speaks against starting a campaign, before its process is made."""

from __future__ import annotations

from rigctl.console.messages import Launch
from rigctl.console.widgets.dialogs import Fault
from rigctl.core.errors import ConfigError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig


def launch_fault(launch: Launch) -> Fault | None:
    """What speaks against a launch, as far as the files say at a glance; the rest the campaign's process tells."""
    try:
        file = read_campaign(launch.campaign)
    except ConfigError as error:
        return Fault("campaign", str(error))
    if not launch.store.name:
        return Fault("store", "name the store")
    if launch.store.exists() and file.procedure.get("mounting") not in {"same", "kept"}:
        return Fault("store", f"{launch.store} exists already; choose another name")
    if not launch.store.absolute().parent.is_dir():
        return Fault("store", f"{launch.store.parent}: no such directory")
    if launch.rig is None and not file.rig:
        return Fault("rig", "the campaign file names no rig; name one here")
    try:
        read_rig(launch.rig or file.rig_path)
    except ConfigError as error:
        return Fault("rig", str(error))
    return None
