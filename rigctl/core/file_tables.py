"""Tables of files an operator writes, as pydantic models."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A table of a file an operator writes: no unknown keys, never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)
