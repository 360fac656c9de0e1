"""What speaks against a fit is said first: a term that predicts nothing, a fit that ends above its promise."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.cli.application import app
from rigctl.composition import opened_workbench
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.promise import warnings

ROWS, SIGMA_V = 60, 0.1
HEADER = 'format = 1\nexperiment = "table"\n[table]\nresponse = "out_v"\nbaseline = "{baseline}"\n{start}'


def _store(place: Path, baseline: str, start: str, columns: dict[str, np.ndarray[Any, np.dtype[np.float64]]]) -> Path:
    bundle, store = place / "bundle", place / "warned.rig.sqlite"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(HEADER.format(baseline=baseline, start=start))
    rows = np.column_stack(list(columns.values()))
    np.savetxt(bundle / "readings.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    import_bundle(bundle, store).close()
    return store


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A line, and beside it the column of a knob that does nothing; a draw in which its slope predicts badly."""
    rng = np.random.default_rng(0)
    force, knob = rng.uniform(0.0, 10.0, ROWS), rng.uniform(0.0, 1.0, ROWS)
    noise = rng.normal(0.0, SIGMA_V, ROWS)
    columns = {"out_v": 1.0 + 0.2 * force + noise, "force_n": force, "knob_mm": knob}
    store = _store(tmp_path_factory.mktemp("idle"), "b0 + b1 * force_n", "", columns)
    with opened_workbench(store) as bench:
        bench.add(["linear[knob_mm]"])
        bench.history()
    return store


@pytest.fixture(scope="module")
def wave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Attempt]:
    """A wave whose fit starts, and ends, valleys away from the frequency that it has."""
    at_s = np.linspace(0.0, 20.0, ROWS)
    volts = np.cos(3.0 * at_s) + np.random.default_rng(4).normal(0.0, SIGMA_V, ROWS)
    start = "[table.start]\nb0 = 1.0\nb1 = 2.0\n"
    columns = {"out_v": volts, "at_s": at_s}
    store = _store(tmp_path_factory.mktemp("wave"), "b0 * cos(b1 * at_s)", start, columns)
    with opened_workbench(store) as bench:
        yield Attempt(bench.study, (), start={"b0": 1.0, "b1": 2.0})


def test_a_term_that_predicts_nothing_is_warned_of(idle: Path) -> None:
    with opened_workbench(idle) as bench:
        first, second = bench.history()
    assert first["warnings"] == []
    assert second["error_held_out"] > first["error_held_out"]
    assert len(second["warnings"]) == 1
    assert "the error on runs held out rises" in second["warnings"][0]


@pytest.mark.parametrize("command", [["fit"], ["model", "history"]])
def test_the_warning_is_the_first_that_is_printed(idle: Path, command: list[str]) -> None:
    said = CliRunner().invoke(app, [*command, str(idle)])
    assert said.exit_code == 0, said.output
    assert said.stdout.lstrip().startswith("Warning")


def test_the_headline_of_a_report_stays_with_the_last_version_without_a_warning(idle: Path, tmp_path: Path) -> None:
    said = CliRunner().invoke(app, ["report", str(idle), "--out", str(tmp_path / "report.html")])
    assert said.exit_code == 0, said.output
    text = (tmp_path / "report.html").read_text()
    assert "model version 1: the baseline alone" in text
    assert "model version 2" not in text
    assert text.index("Warning, version 2: the error on runs held out rises") < text.index("Error ladder")
    assert "Nothing speaks against version 1." in text


def test_a_fit_that_ends_above_what_was_promised_is_warned_of(wave: Attempt) -> None:
    promised = {"b0": 1.0, "b1": 3.0}
    (warning,) = warnings(wave, None, promised)
    assert warning.startswith(f"chi-square ends at {wave.result.chi2:.4g}, above the ")
    assert warning.endswith("the fit has ended elsewhere; diagnose again")


def test_a_fit_that_ends_where_it_was_promised_is_not(wave: Attempt) -> None:
    assert warnings(wave, None, wave.values) == []
