"""Two themes in Okabe and Ito's colours, which all eyes tell apart; signs and words say the same as colours do."""

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
