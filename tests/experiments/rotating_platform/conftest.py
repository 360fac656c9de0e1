"""Acceptance tables of the bias-rejection experiment, and its patterns by name."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

TABLES = Path(__file__).parents[2] / "data" / "bias_rejection"


def _cell(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


@pytest.fixture
def table() -> Callable[[str], list[dict[str, Any]]]:
    """The rows of a table by its name; cells are numbers where they look like it."""

    def read(name: str) -> list[dict[str, Any]]:
        with (TABLES / f"{name}.csv").open(newline="", encoding="utf-8") as file:
            return [{key: _cell(cell) for key, cell in row.items()} for row in csv.DictReader(file)]

    return read
