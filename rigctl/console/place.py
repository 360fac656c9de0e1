"""What a file is that is to be opened."""

from __future__ import annotations

from pathlib import Path


def kind_of(path: Path) -> tuple[str, str]:
    """Whether a TOML file is a `rig` or a `campaign`, and its text; `ConfigError` when it cannot be read."""
    from rigctl.files.toml_files import parsed_file, read_text  # with pydantic, after the first paint

    text = read_text(path)
    tables = parsed_file(text, path)
    # A campaign file needs one of these keys, and no rig file has them.
    return ("campaign" if "experiment" in tables or "procedure" in tables else "rig"), text


def require_store(path: Path) -> None:
    """`DataError` when a file is no campaign store that can be read."""
    from rigctl.campaign.store.store import Store  # a console that is started without a place starts faster

    Store.open(path, readonly=True).close()
