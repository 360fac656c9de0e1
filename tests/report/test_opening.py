"""What a report opens with: the item, the result and the verdict before the evidence, whatever the store is like."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.report.chart.scale import Scale
from rigctl.report.document import write_report
from rigctl.report.figure_script import SCRIPT

HEADER = (
    'format = 1\nexperiment = "table"\ntitle = "Cell <b>bold</b> & \\"more\\""\n'
    '[item]\nname = "load cell <i>"\nserial = "7<8"\n'
    '[table]\nresponse = "deflection_mm"\nbaseline = "b0 + b1 * load_n"\n'
)


def written(place: Path, rows: int, status: dict[str, object] | None = None) -> str:
    """The page of a straight line through so many readings, with a column of words that are markup."""
    bundle = place / "bundle"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(HEADER)
    rng = np.random.default_rng(3)
    load = np.linspace(0.0, 100.0, rows)
    value = 0.1 + 0.06 * load + 2e-3 * rng.standard_normal(rows)
    lines = [
        f"{a!r},{b!r},<b>{k % 2}</b>" for k, (a, b) in enumerate(zip(load.tolist(), value.tolist(), strict=True))
    ]
    (bundle / "readings.csv").write_text("\n".join(["load_n,deflection_mm,operator", *lines]) + "\n")
    import_bundle(bundle, place / "t.rig.sqlite").close()
    with Store.open(place / "t.rig.sqlite") as store:
        if status:
            store.set_status(status)
        write_report(workbench_of(store), place / "r.html", None, lambda _: None)
    return (place / "r.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    status = {"state": "running", "step": "", "runs_done": 30, "runs_planned": 40, "eta_s": 1.0}
    return written(tmp_path_factory.mktemp("opening"), 30, status)


def test_the_item_the_verdict_and_the_result_stand_before_the_evidence(page: str) -> None:
    order = [
        "Calibrated: load cell",
        "The model is adequate",
        "<h2>Result</h2>",
        "<td>b1</td>",
        "<h2>Error ladder</h2>",
    ]
    places = [page.index(each) for each in order]
    assert places == sorted(places)
    # The parameters of a table are its result; they do not stand there twice.
    assert page.count("<td>b1</td>") == 1


def test_names_with_markup_are_text(page: str) -> None:
    assert "<title>Cell &lt;b&gt;bold&lt;/b&gt; &amp; &quot;more&quot;</title>" in page
    assert "Calibrated: load cell &lt;i&gt;, serial number 7&lt;8." in page
    assert not re.search(r"<(b|i)>", page)


def test_a_half_finished_campaign_says_so_before_its_result(page: str) -> None:
    said = "The campaign is interrupted after 30 of 40 runs: what follows is preliminary."
    assert page.index(said) < page.index("<h2>Result</h2>")


def test_every_figure_says_in_words_what_it_shows(page: str) -> None:
    figures = re.findall(r"<figure><svg[^>]*?>", page)
    assert figures
    for figure in figures:
        assert re.search(r'role="img" aria-label="[^"]{20,}"', figure)


def test_thousands_of_readings_are_a_page_of_moderate_size(tmp_path: Path) -> None:
    text = written(tmp_path, 3000)
    assert len(text.encode()) < 500_000
    assert "table, 3000 readings" in text


def test_the_script_reads_the_axes_as_they_are_drawn(tmp_path: Path) -> None:
    """Its two functions for scales, against `Scale`: a value found under the pointer is the one that was drawn."""
    body = SCRIPT[SCRIPT.index("  const unscaled") : SCRIPT.index("  const valueAt")]
    cases = [("linear", 1.0, -3.5), ("log", 1.0, 2e-6), ("symlog", 3.0, -40.0), ("symlog", 3.0, 1.5)]
    for kind, up_to, value in cases:
        share = float(Scale(kind, linear_up_to=up_to).values_of(np.array([value]))[0])
        body += f"console.log(unscaled('{kind}', {up_to}, {share!r}), scaled('{kind}', {up_to}, {value!r}));\n"
    (tmp_path / "s.js").write_text(body)
    try:
        told = subprocess.run(["node", tmp_path / "s.js"], capture_output=True, text=True, check=True)
    except FileNotFoundError:
        pytest.skip("no node to run a script with")
    for line, (kind, up_to, value) in zip(told.stdout.splitlines(), cases, strict=True):
        share = float(Scale(kind, linear_up_to=up_to).values_of(np.array([value]))[0])
        assert [float(each) for each in line.split()] == pytest.approx([value, share])
