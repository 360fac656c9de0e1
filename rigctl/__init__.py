"""rigctl: instrument control and model building for precision accelerometer calibration.

    from rigctl import Campaign, Rig, Store

Names are imported when they are asked for, so that a command starts fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.campaign.store.store import Store
    from rigctl.core.errors import RigError
    from rigctl.notebook import Campaign
    from rigctl.rig import Rig

__all__ = ["Campaign", "Rig", "RigError", "Store"]

_HOMES = {
    "Campaign": "rigctl.notebook",
    "Rig": "rigctl.rig",
    "RigError": "rigctl.core.errors",
    "Store": "rigctl.campaign.store.store",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'rigctl' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)
