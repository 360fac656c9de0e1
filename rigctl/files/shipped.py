"""The rig and campaign files that come with the program."""

from __future__ import annotations

from pathlib import Path


def shipped_campaigns() -> Path:
    """Their directory: beside this module in what a wheel has installed, else the source tree's own."""
    installed = Path(__file__).parent / "campaigns"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "campaigns"
