"""The item that is calibrated, as a campaign file, a bundle or the details of a certificate name it."""

from __future__ import annotations

from datetime import date
from typing import Annotated

from pydantic import Field, StringConstraints

from rigctl.core.file_tables import Table

Line = Annotated[str, StringConstraints(max_length=2000, strip_whitespace=True)]


class Item(Table):
    """What was calibrated (ISO/IEC 17025:2017, 7.8.2.1 g, h)."""

    name: Line = ""
    manufacturer: Line = ""
    model: Line = ""
    serial: Line = ""
    condition: Line = ""
    # A campaign written from another one, and a store, have it as text.
    received: Annotated[date, Field(strict=False)] | None = None

    @property
    def stated(self) -> dict[str, str]:
        """What is said of it, by key, as JSON has it; empty for nothing."""
        return {key: value for key, value in self.model_dump(mode="json").items() if value}
