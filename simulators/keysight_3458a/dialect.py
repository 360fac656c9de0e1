"""What sources leave open of a 3458A; the defaults are the readings that make life hardest."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict


class Meter3458ADialect(BaseModel):
    """How this meter reads the manual."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    recall_order: Literal["newest first", "oldest first"] = "newest first"
    """In which order RMEM sends readings, of which the newest has number 1."""
    hears_while_sampling: bool = False
    """Are commands taken up during the readings of a TARM SGL, or after them?"""
    padded_numbers: bool = True
    """Have whole numbers a space in front, as older instruments send them?"""
    heeds_device_clear: bool = False
    """Does a device clear end the readings of a TARM SGL?"""
    error_numbers: Literal["bits", "hundreds"] = "hundreds"
    """ERRSTR?: the value of the register's bit, or 100 and the bit's number."""


GENTLE = Meter3458ADialect(
    recall_order="oldest first",
    hears_while_sampling=True,
    padded_numbers=False,
    heeds_device_clear=True,
    error_numbers="bits",
)
"""The other reading of each."""
