"""Instruments as devices of a bluesky `RunEngine`, campaigns as its documents: the extra `bluesky`.

    from rigctl.bluesky import devices_of, documents

`ConfigError` on import without the package.
"""

from __future__ import annotations

from rigctl.core.extra import BLUESKY, needed

needed("bluesky", BLUESKY)

from rigctl.bluesky.campaign_documents import documents  # noqa: E402 - after the line that says what is missing
from rigctl.bluesky.devices import devices_of  # noqa: E402

__all__ = ["devices_of", "documents"]
