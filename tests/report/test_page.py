"""The report as a page, of stores that no rig of ours made: a table of NIST's, and another laboratory's recording."""

from __future__ import annotations

import csv
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.report import html
from rigctl.report.chart.scale import Scale, Ticks
from rigctl.report.document import write_report
from rigctl.report.figures.residuals import CROWDED, ResidualRow, draw_residuals
from rigctl.report.figures.sensing_axis.result import NullRow, draw_nulls
from rigctl.report.quantities import p_value
from rigctl.report.tables.result_table import ResultTable

EXAMPLES = Path(__file__).parents[2] / "examples"
VOID = {"meta", "br"}


class Page(HTMLParser):
    """A page's text by heading, its tables as rows of cells, its figures' captions; tags must be closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {"": ""}
        self.tables: list[list[list[str]]] = []
        self.captions: list[str] = []
        self.figures = 0
        self._open: list[str] = []
        self._heading = ""
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        if tag in VOID:
            return
        self._open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in {"td", "th"}:
            self.tables[-1][-1].append("")
        if tag == "figcaption":
            self.captions.append("")
        if tag in {"h1", "h2", "h3"}:
            self._heading = ""
        self.figures += tag == "svg"

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag
        if tag in {"h1", "h2", "h3"}:
            self.sections[self._heading] = ""

    def handle_data(self, data: str) -> None:
        if {"svg", "style", "script", "title"} & set(self._open):
            return
        if self._open and self._open[-1] in {"h1", "h2", "h3"}:
            self._heading += data
            return
        if self._open and self._open[-1] in {"td", "th"}:
            self.tables[-1][-1][-1] += data
        if self._open and self._open[-1] == "figcaption":
            self.captions[-1] += data
        self.sections[self._heading] += data

    def table(self, *columns: str) -> list[dict[str, str]]:
        """The rows of the one table with these columns."""
        (found,) = [rows for rows in self.tables if rows[0] == list(columns)]
        return [dict(zip(columns, row, strict=True)) for row in found[1:]]


def reported(example: str, directory: Path, *effects: str, repeated: int = 0) -> tuple[Page, set[str]]:
    """An example imported, effects added, its report read; and the figures that were written beside it."""
    store = directory / f"{example}.rig.sqlite"
    import_bundle(EXAMPLES / example, store).close()
    with Store.open(store) as opened:
        for _ in range(repeated):
            opened.add_event("run-repeated", {"key": "a", "error": "LinkTimeout"})
        bench = workbench_of(opened)
        bench.add(effects)
        written = write_report(bench, directory / "r.html", directory / "figures", lambda _: None)
    assert all(path.is_file() for path in written)
    text = (directory / "r.html").read_text(encoding="utf-8")
    assert not re.search(r"\b(nan|None|inf)\b", re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL))
    return Page(text), {path.stem for path in written if path.suffix == ".svg"}


@pytest.fixture(scope="module")
def pontius(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, set[str]]:
    return reported("pontius", tmp_path_factory.mktemp("pontius"), "power2[load_lb]")


@pytest.fixture(scope="module")
def unknown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, set[str]]:
    return reported("unknown-effect", tmp_path_factory.mktemp("unknown"), repeated=3)


def test_a_tables_report_tells_of_readings_and_of_nothing_that_a_table_has_not(
    pontius: tuple[Page, set[str]],
) -> None:
    page, figures = pontius
    assert "Calibration of a load cell: a line is not enough" in page.sections
    assert "table, 40 readings; model version 2: baseline + power2[load_lb]" in " ".join(page.sections.values())
    assert figures == {"ladder", "residuals_load_lb", "ranking", "term_power2_load_lb"}
    assert page.figures == 4
    assert "What is left in the samples" not in page.sections
    assert page.table("channel", "rms", "noise", "unit", "chi2/n")[0]["channel"] == "deflection_in"


def test_a_tables_ladder_and_parameters_are_the_fits(pontius: tuple[Page, set[str]]) -> None:
    page, _ = pontius
    first, second = page.table("version", "rms/in", "chi2/dof", "error", "held out")
    assert first["version"].startswith("1: baseline    b0 = ")
    assert second["version"].startswith("2: + power2[load_lb]    b0 = ")
    # NIST's residual standard deviation of the quadratic, 2.05177424076185e-04 of 37 degrees of freedom.
    assert float(second["rms/in"]) == pytest.approx(2.05177424076185e-4 * (37.0 / 40.0) ** 0.5, rel=0.01)
    assert float(first["rms/in"]) > 10.0 * float(second["rms/in"])
    assert float(first["error"]) > 10.0
    assert float(second["held out"]) == pytest.approx(0.98, abs=0.03)
    values = {
        row["parameter"]: f"{row['value']} {row['unit']}".strip() for row in page.table("parameter", "value", "unit")
    }
    # NIST's certified values: 6.73565789473684e-04, 7.32059160401003e-07, -3.16081871345029e-15.
    assert values == {
        "b0": "(6.7 ± 1.1)e-04",
        "b1": "(7.3206 ± 0.0016)e-07",
        "power2[load_lb]": "(-3.161 ± 0.050)e-15 in/lb2",
    }


def test_a_tables_candidates_have_sizes_without_their_name(pontius: tuple[Page, set[str]]) -> None:
    page, _ = pontius
    cells = [
        row["effect (*: suggested)"]
        for row in page.table("effect (*: suggested)", "p corr.", "chi2 fall", "held out")
    ]
    assert any(cell.startswith("  power3[load_lb]    = (") for cell in cells)
    assert any("    cos = " in cell for cell in cells)
    assert "in no order" in page.sections["Cannot be tested with these data"]


def test_an_imported_recordings_report_says_what_remains_once(unknown: tuple[Page, set[str]]) -> None:
    page, _ = unknown
    everything = " ".join(page.sections.values())
    assert "840 data of 48 runs; model version 1: the baseline alone" in everything
    assert everything.count("none of the known effects explains") == 1
    assert everything.count("with pressure_hpa") == 1
    assert "they do not suffice" in everything
    assert "rigctl model add unknown-effect.rig.sqlite resonance roll-gravity" in everything
    assert "p < 1e-300" in page.sections["Residuals"]


def test_runs_that_were_repeated_are_told_of_where_there_were_any(
    unknown: tuple[Page, set[str]], pontius: tuple[Page, set[str]]
) -> None:
    assert "3 repeated after a fault (LinkTimeout 3)" in " ".join(unknown[0].sections.values())
    assert "repeated after a fault" not in " ".join(pontius[0].sections.values())


def test_an_imported_recordings_figures_are_those_it_has_data_for(unknown: tuple[Page, set[str]]) -> None:
    page, figures = unknown
    assert {"residuals_pressure_hpa", "spectrum_accel_v", "spectrum_laser_1_mm", "fig3", "fig12", "nulls"} <= figures
    assert "residuals_mounting" not in figures
    assert not {"budget", "fig15"} & figures
    assert "budget: no axis was found" in page.sections["Result"]
    assert "plane of axis X" in page.sections["Result"]


def test_one_version_makes_no_ladder_and_one_mounting_one_figure_12(unknown: tuple[Page, set[str]]) -> None:
    page, figures = unknown
    assert not any("Error of each model version" in caption for caption in page.captions)
    assert {"ladder", "fig12", "fig12_X_flag"} <= figures
    assert sum("Response in phase" in caption for caption in page.captions) == 1
    assert page.figures == len(figures) - 2


def test_a_page_is_plain_text_made_safe() -> None:
    text = html.table(ResultTable("", ["#n", "a & b", "nothing"], [["1 ± 2", "<x>\ny", ""]], [True]))
    page = Page(text)
    assert page.table("n", "a & b") == [{"n": "1 ± 2", "a & b": "<x>y"}]
    assert '<tr class="mark">' in text
    assert html.paragraph("1 ± 2 <b>", "soft") == '<p class="soft">1 ± 2 &lt;b&gt;</p>'
    assert html.listing([]) == ""


def test_a_p_value_too_small_to_tell_is_below_a_bound() -> None:
    assert [p_value(p) for p in (0.0123, 0.0, None)] == ["p = 0.012", "p < 1e-300", "p = -"]


def ticks_of(scale: Scale, limits: tuple[float, float]) -> Ticks:
    return scale.ticks(*limits, 9)


def rows(values: Any, residuals: Any) -> list[ResidualRow]:
    pairs = zip(values, residuals, strict=True)
    return [ResidualRow("c", float(x), "", 1, "", "v", "", str(i), float(r)) for i, (x, r) in enumerate(pairs)]


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ([-1.0, 1.0] * 8, ["−1", "1"]),
        ([0.3, 0.3000001, 0.5, 0.6], ["0.3", "0.5", "0.6"]),
    ],
    ids=["directions", "frequencies as found"],
)
def test_a_few_set_points_have_a_tick_each(values: list[float], labels: list[str]) -> None:
    figure = draw_residuals(rows(values, np.zeros(len(values))))
    assert list(ticks_of(figure.axes[0].x, figure.axes[0].limits_x()).labels) == labels


@pytest.mark.parametrize("values", [np.linspace(0.0, 1.0, 40), np.array([0.0, 0.01, 1.0])], ids=["many", "close"])
def test_other_covariates_have_round_ticks(values: np.ndarray) -> None:
    axes = draw_residuals(rows(values, np.zeros(len(values)))).axes[0]
    ticks = ticks_of(axes.x, axes.limits_x()).places
    assert len(ticks) > 3
    assert np.diff(ticks) == pytest.approx(ticks[1] - ticks[0])


@pytest.mark.parametrize("largest", [2.0, 4.9, 20.0, 60.0, 400.0, 3e3, 5e4, 1e7])
def test_ticks_of_residuals_do_not_touch(largest: float) -> None:
    figure = draw_residuals(rows([0.0, 1.0], [largest, -largest]))
    labels = re.findall(r'y="([\d.]+)" font-size="7" text-anchor="end"', figure.svg("residuals"))
    places = sorted(map(float, labels))
    assert len(places) >= 3
    assert np.diff(places).min() > 7.0
    assert (3.0 in ticks_of(figure.axes[0].y, figure.axes[0].limits_y()).places) == (
        1.0 + np.log10(max(2.0 * largest, 6.0) / 3.0) <= CROWDED
    )


def test_mountings_are_counted_in_whole_numbers() -> None:
    figure = draw_nulls([NullRow("X", "flag", 4, 0.13, 0.35)])
    assert list(ticks_of(figure.axes[1].x, figure.axes[1].limits_x()).places) == [4.0]


@pytest.fixture(scope="module")
def wave(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Path]:
    """A wave of 3 m/s and 40 d in a year of velocities, its term added: the page, and where the figures are."""
    place = tmp_path_factory.mktemp("wave")
    bundle = place / "bundle"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(
        'format = 1\nexperiment = "table"\n[table]\nresponse = "velocity_m_s"\nbaseline = "b0"\n'
        '[channels.velocity_m_s]\nunit = "m/s"\n'
    )
    day = np.linspace(0.0, 365.0, WAVE_ROWS)
    velocity = WAVE_M_S * np.sin(2.0 * np.pi * day / 40.0 + 0.3) + np.random.default_rng(4).normal(0.0, 1.0, day.size)
    rows = "\n".join(f"{v!r},{d!r}" for v, d in zip(velocity.tolist(), day.tolist(), strict=True))
    (bundle / "readings.csv").write_text(f"velocity_m_s,day\n{rows}\n")
    import_bundle(bundle, place / "wave.rig.sqlite").close()
    with Store.open(place / "wave.rig.sqlite") as opened:
        bench = workbench_of(opened)
        bench.add(["periodic[day]"])
        write_report(bench, place / "r.html", place / "figures", lambda _: None)
    return Page((place / "r.html").read_text(encoding="utf-8")), place / "figures"


WAVE_ROWS, WAVE_M_S = 90, 3.0


def test_a_wave_is_shown_by_its_phase_with_its_amplitude(wave: tuple[Page, Path]) -> None:
    page, figures = wave
    _, second = page.table("version", "rms/(m/s)", "chi2/dof", "error", "held out")
    told = re.search(r"periodic\[day\]\.amplitude = (\S+) ± (\S+) m/s", second["version"])
    assert told is not None
    amplitude, sigma = map(float, told.groups())
    assert sigma == pytest.approx((2.0 / WAVE_ROWS) ** 0.5, rel=0.25)  # of a sine in white noise of 1 m/s
    assert abs(amplitude - WAVE_M_S) < 4.0 * sigma
    with (figures / "term_periodic_day.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    phase, reading, term = (np.array([float(row[key]) for row in rows]) for key in ("value", "reading", "term"))
    assert len(rows) == WAVE_ROWS
    assert np.all((phase >= 0.0) & (phase < 1.0))
    design = np.stack([np.cos(2.0 * np.pi * phase), np.sin(2.0 * np.pi * phase)], axis=1)
    quadratures, left, *_ = np.linalg.lstsq(design, term, rcond=None)
    assert np.hypot(*quadratures) == pytest.approx(amplitude, abs=0.005)
    assert float(np.sum(left)) < 1e-18
    # The scatter about the wave is the noise: chi-square of 90 readings less 4 parameters, within 4 of its sigmas.
    assert float(np.sum((reading - term) ** 2)) == pytest.approx(WAVE_ROWS - 4, abs=4.0 * (2.0 * WAVE_ROWS) ** 0.5)
