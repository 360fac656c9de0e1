"""A header, and whatever else is kept as text, to JSON and back: floats bit for bit, NaN included."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from rigctl.campaign.recording import ChannelInfo, Header, LaserInfo


def dumps(value: Any) -> str:
    """JSON text; numpy scalars and arrays become numbers and lists."""
    return _encode(value)


def _plain(value: object) -> Any:
    # Told without numpy: what only asks a store for its state does not load it.
    if type(value).__module__ == "numpy" and (as_list := getattr(value, "tolist", None)):
        return as_list()
    raise TypeError(f"{type(value).__name__} cannot be kept as JSON")


_encode = json.JSONEncoder(separators=(",", ":"), default=_plain).encode


def header_to_json(header: Header) -> str:
    """The header as JSON text."""
    return dumps(asdict(header))


def header_from_json(text: str) -> Header:
    """The header `header_to_json` wrote."""
    data = json.loads(text)
    data["channels"] = {name: ChannelInfo(**info) for name, info in data["channels"].items()}
    data["lasers"] = {name: LaserInfo(**info) for name, info in data["lasers"].items()}
    return Header(**data)
