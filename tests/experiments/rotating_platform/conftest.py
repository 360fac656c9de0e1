"""Acceptance tables of the bias-rejection experiment, and its patterns by name."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
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


def _coloured(density: Callable[[Any], Any], samples: int, rate_hz: float, seed: int, longer: int = 4) -> Any:
    rng = np.random.default_rng(seed)
    length = samples * longer
    frequency = np.fft.rfftfreq(length, 1.0 / rate_hz)
    amplitude = np.zeros(frequency.size)
    amplitude[1:] = np.sqrt(density(frequency[1:]) * length * rate_hz / 2.0)
    parts = rng.normal(size=(2, frequency.size)) * amplitude
    return np.fft.irfft(parts[0] + 1j * parts[1], length)[:samples]


@pytest.fixture
def coloured() -> Callable[..., Any]:
    """Noise of a two-sided density, cut from a longer record, so that it holds what lies below one over its own."""
    return _coloured
