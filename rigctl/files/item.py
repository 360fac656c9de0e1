"""The item that is calibrated, as a campaign file, a bundle or the details of a certificate name it."""

from __future__ import annotations

from datetime import date
from typing import Annotated
from unicodedata import category

from pydantic import AfterValidator, Field, StringConstraints

from rigctl.core.file_tables import Table


def _printable(text: str) -> str:
    """The text in one line; a terminal would obey control characters, and no page can show them."""
    line = " ".join(text.split())
    for each in line:
        if category(each) == "Cc":
            raise ValueError(f"it has the control character U+{ord(each):04X}; take it out")
    return line


Line = Annotated[str, StringConstraints(max_length=2000), AfterValidator(_printable)]


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
