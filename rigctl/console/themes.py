"""Themes: two in Okabe and Ito's colours, which all eyes tell apart, one without grey, one for eyes used to the dark.

Signs and words say the same as colours do.
"""

from __future__ import annotations

from textual.theme import Theme

DARK = Theme(
    name="rigctl-dark",
    primary="#56B4E9",
    secondary="#0072B2",
    accent="#E69F00",
    success="#009E73",
    warning="#E69F00",
    error="#D55E00",
    foreground="#E8E8E8",
    background="#101418",
    surface="#171C21",
    panel="#222A32",
    dark=True,
    variables={"stop-text": "#000000"},
)
LIGHT = Theme(
    name="rigctl-light",
    primary="#0072B2",
    secondary="#56B4E9",
    accent="#B35900",
    success="#00795A",
    warning="#E69F00",
    error="#D55E00",
    foreground="#101418",
    background="#FFFFFF",
    surface="#F4F4F4",
    panel="#E2E6EA",
    dark=False,
    variables={"stop-text": "#000000"},
)
CONTRAST = Theme(
    name="rigctl-contrast",
    primary="#FFFFFF",
    secondary="#FFFFFF",
    accent="#FFFF00",
    success="#00FF00",
    warning="#FFFF00",
    error="#FF6060",
    foreground="#FFFFFF",
    background="#000000",
    surface="#000000",
    panel="#303030",
    dark=True,
    variables={"stop-text": "#000000", "text-muted": "#FFFFFF"},
)
NIGHT = Theme(
    name="rigctl-night",
    primary="#C86400",
    secondary="#A05000",
    accent="#E07800",
    success="#B06000",
    warning="#E07800",
    error="#FF4000",
    foreground="#C87830",
    background="#000000",
    surface="#0C0600",
    panel="#201000",
    dark=True,
    variables={"stop-text": "#000000"},
)
"""Amber only: beside an optical experiment, or in a room lit yellow, nothing blue shines."""

THEMES = {theme.name: theme for theme in (DARK, LIGHT, CONTRAST, NIGHT)}
"""In the order in which a key goes through them."""
