"""The uncertainties that budgets read from the certificates of a rig file; a misspelt one would not be counted."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

BY_NAME: Mapping[str, tuple[str, ...]] = {
    "rotation": ("resolution_arcsec",),
    "stage": ("yaw_rad_per_m", "recoil_rad_s2_per_m", "pitch_rad_per_m"),
    "stage_x_mm": ("latency_s",),
    "cube": ("orthogonality_arcsec",),
    "accel_v": ("latency_s", "scale", "clock"),
    "platform": ("zero_deg", "half_turn_deg"),
}
"""Quantities by the name of the certificate."""

OF_HEADS = ("tilt_deg", "scale", "latency_s")
"""Quantities in the certificate of a displacement head, which has the head's name."""


def misspelt(certified: Mapping[str, Iterable[str]], heads: Collection[str]) -> Iterator[str]:
    """What is wrong with quantities of certificates that budgets read: key and mend, where no budget knows them."""
    for name, quantities in certified.items():
        known = OF_HEADS if name in heads else BY_NAME.get(name, ())
        for quantity in quantities:
            if known and quantity not in known:
                yield f"unknown key certificates.{name}.uncertainty.{quantity}; known there: {', '.join(known)}"


def unread(certified: Mapping[str, Collection[str]], heads: Collection[str]) -> Iterator[str]:
    """Certificates of other names: theirs are stated where a result is certified, but are in no budget."""
    for name, quantities in certified.items():
        if quantities and name not in heads and name not in BY_NAME:
            read = ", ".join([*BY_NAME, *heads])
            yield f"certificates.{name}.uncertainty: no budget reads it; budgets read those of {read}"
