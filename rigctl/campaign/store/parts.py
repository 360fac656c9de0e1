"""The campaigns of a store: the one it was made by, and those that were run into it later, on the same rig.

The first is in the store's header, each later one is a document `campaign`. All share runs, rig and world; keys,
mounting numbers and the world's clock go on from one to the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError

KIND = "campaign"

PLUGINS = "plugins"
"""Where the header keeps those of the first campaign."""

Plugins = Mapping[str, Mapping[str, str]]
"""Of each effect that came from a file, its `path` and `sha256`."""


@dataclass(frozen=True)
class Part:
    """One campaign: its file, and what the store held when it began (`mounted`: axis, configuration, number).

    `plugins` are the files that brought effects of its model.
    """

    number: int
    path: str
    toml: str
    runs_before: int = 0
    mountings_before: int = 0
    mounted: tuple[str, str, int] | None = None
    plugins: Plugins = field(default_factory=dict)


def parts_of(store: Store) -> list[Part]:
    """All campaigns of a store in order; `DataError` for an imported recording."""
    if store.header.campaign_toml is None:
        raise DataError(f"{store.path}: an imported recording has no campaign to go on with")
    later = []
    for document in store.documents(KIND):
        mounted = document.data["mounted"]
        later.append(Part(**{**document.data, "mounted": None if mounted is None else tuple(mounted)}))
    first = Part(1, str(store.path), store.header.campaign_toml, plugins=store.header.extra.get(PLUGINS, {}))
    return [first, *later]


def next_part(
    store: Store, path: Path, toml: str, mountings: Sequence[tuple[str, str, int]], plugins: Plugins
) -> Part:
    """What a further campaign would be, after `mountings`; nothing is kept yet."""
    return Part(
        number=len(parts_of(store)) + 1,
        path=str(path),
        toml=toml,
        runs_before=len(store.runs()),
        mountings_before=max((number for _, _, number in mountings), default=0),
        mounted=mountings[-1] if mountings else None,
        plugins=plugins,
    )


def begin_part(store: Store, part: Part, rig_time_s: float) -> None:
    """Keep that a further campaign begins."""
    # In this order: a store killed in between has nothing left to do, and says so when it is resumed.
    store.set_status({**store.status(), "state": "running"})
    store.add_document(KIND, asdict(part))
    store.add_event("extended", {"part": part.number}, rig_time_s)
