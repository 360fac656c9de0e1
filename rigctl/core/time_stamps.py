"""Columns of ISO 8601 time stamps as seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from rigctl.core.arrays import FloatArray

_DATE = re.compile(r"\d{4}-\d\d-\d\d")


def seconds_of_stamps(texts: Sequence[str]) -> FloatArray | None:
    """Seconds from the earliest of some time stamps, NaN where a text is empty; None where another is no stamp.

    Stamps without a zone are UTC. A stamp begins with a date in full: "2024-05-01", "2024-05-01T12:00:00+02:00".
    """
    stamps = [_stamp(text.strip()) if text.strip() else None for text in texts]
    known = [stamp for stamp in stamps if stamp is not None]
    if not known or any(stamp is None and text.strip() for stamp, text in zip(stamps, texts, strict=True)):
        return None
    first = min(known)
    return np.array([np.nan if stamp is None else (stamp - first).total_seconds() for stamp in stamps])


def _stamp(text: str) -> datetime | None:
    if not _DATE.match(text):
        return None
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        return None
    return stamp if stamp.tzinfo is not None else stamp.replace(tzinfo=UTC)
