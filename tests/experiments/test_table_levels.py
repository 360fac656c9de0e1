"""Columns of words in a table: who measured, up or down."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import DataError
from rigctl.effects.plugins import load
from rigctl.experiments.table.study import TableStudy
from rigctl.report.figures.residuals import residual_plate
from rigctl.report.figures.table.terms import term_plates
from rigctl.workbench.study import Proposal, Term
from rigctl.workbench.verdict.compare import compare
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit
from rigctl.workbench.verdict.shapes import covariates_of
from rigctl.workbench.verdict.transfer import transfer

ROWS = 60
X = np.linspace(0.0, 10.0, ROWS)
OPERATOR = np.random.default_rng(1).choice(["Ada", "Ben", "Cy"], ROWS)
DIRECTION = np.where(np.arange(ROWS) % 2, "up", "down")


def study(
    seed: int = 2, plugins: Any = (), operator: Any = OPERATOR, block: str | None = None, **more: Any
) -> TableStudy:
    """A line, on which Ben reads 0.05 more than the others; noise of 0.01."""
    noise = 0.01 * np.random.default_rng(seed).standard_normal(ROWS)
    y = 1.0 + 0.5 * X + 0.05 * (np.asarray(operator) == "Ben") + noise
    texts = {"operator": list(operator), "direction": DIRECTION.tolist(), **more}
    spec = {"response": "y_mm", "baseline": "b0 + b1 * x_mm", "start": {}, "block": block}
    record = RunRecord(READINGS, READINGS, "import", {name: list(map(str, text)) for name, text in texts.items()})
    header = Header("table", extra={"table": spec})
    recording = Recording(header, (record,), {READINGS: {"y_mm": y, "x_mm": X}}, ImportReport(1))
    return TableStudy(recording, plugins)


def reasons(table: TableStudy) -> dict[str, str]:
    model = table.model([])
    return {each.effect: each.reason for each in table.candidates(model, np.array([1.0, 0.5]))[1]}


def test_a_word_that_matters_is_named_with_what_it_makes() -> None:
    found = diagnose(study(), ())
    assert found.verdict == "effect"
    assert [term.effect for term in found.suggested] == ["level[operator]"]
    best = found.ranking[0].parameters
    assert list(best) == ["level[operator].Ben-Ada", "level[operator].Cy-Ada"]
    assert best["level[operator].Ben-Ada"].value == pytest.approx(0.05, abs=0.012)
    assert best["level[operator].Ben-Ada"].unit == "mm"
    assert abs(best["level[operator].Cy-Ada"].value) < 4.0 * best["level[operator].Cy-Ada"].sigma


def test_the_fit_is_that_of_indicator_columns() -> None:
    table = study()
    found = fit(table, [Term("level[operator]")])
    design = np.stack([np.ones(ROWS), X, OPERATOR == "Ben", OPERATOR == "Cy"], axis=1)
    expected = np.linalg.lstsq(design, table.observations.value, rcond=None)[0]
    assert [each.value for each in found.parameters.values()] == pytest.approx(expected, rel=1e-9)
    assert list(found.parameters)[2:] == ["level[operator].Ben-Ada", "level[operator].Cy-Ada"]
    assert diagnose(table, [Term("level[operator]")]).verdict == "adequate"


def test_residuals_are_compared_by_words() -> None:
    found = compare(study(), ())
    first, *others = found.trends
    assert first.covariate == "operator"
    assert first.p_value_corrected < 1e-6
    assert "direction" in {trend.covariate for trend in others}
    assert found.observations.levels["operator"] == ("Ada", "Ben", "Cy")


def test_many_words_share_a_scatter() -> None:
    """Ten benches, one of which is off: five words or more are a scatter between them, and part of the noise."""
    bench = np.array([f"b{i % 10}" for i in range(ROWS)])
    table = study(operator=np.where(bench == "b3", "Ben", bench))
    (offset,) = table.observations.offsets
    assert offset.name == "operator"
    assert offset.share > 0.7
    assert "operator" not in {
        trend.covariate for trend in compare(table, ()).trends if trend.p_value_corrected < 0.01
    }


def test_words_are_no_polynomials() -> None:
    observations = study().observations
    names = covariates_of(observations, np.arange(ROWS))
    assert "x_mm" in names
    assert not [name for name in names if name.startswith(("operator", "direction"))]


REFUSED = {
    "in all readings": (["Ada"] * ROWS, "operator is Ada in all readings"),
    "remarks": (
        [f"n{i}" for i in range(ROWS)],
        f"operator takes {ROWS} different values in {ROWS} readings: too many",
    ),
    "one reading": (["Ada"] * (ROWS - 1) + ["Ben"], "operator is Ben in fewer than 2 readings"),
    "unknown": (["Ada"] * 20 + [""] * 5 + ["Ben"] * (ROWS - 25), "operator has no value in 5 readings"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_words_that_cannot_be_levels_say_why(case: str) -> None:
    words, reason = REFUSED[case]
    table = study(operator=words)
    assert reason in reasons(table)["level[operator]"]
    with pytest.raises(DataError, match="effect 'level\\[operator\\]' cannot be fitted"):
        table.model([Term("level[operator]")])
    compare(table, ())


def test_remarks_are_no_covariate() -> None:
    table = study(remark=[f"n{i}" for i in range(ROWS)])
    assert set(table.observations.covariates) == {"x_mm", "operator", "direction"}


def test_a_block_of_words_can_be_an_effect_of_its_own() -> None:
    """What only a block tells is fitted there again when it is held out."""
    found = diagnose(study(block="operator"), ())
    assert [term.effect for term in found.suggested] == ["level[operator]"]


def test_another_table_is_compared_by_the_same_words() -> None:
    terms = [Term("level[operator]")]
    alike = transfer(study(), study(seed=3), terms)
    assert alike.error_transferred == pytest.approx(1.0, abs=0.3)
    assert "level[operator].Ben-Ada" in {each.name for each in alike.shared}
    others = transfer(study(), study(seed=3, operator=np.where(OPERATOR == "Ada", "Cy", OPERATOR)), terms)
    assert {each.name for each in others.shared} == {"b0", "b1"}


def test_readings_that_could_be_taken_are_of_the_last_word() -> None:
    table = study()
    more = table.extended([Proposal({"x_mm": 3.0}), Proposal({"x_mm": 20.0})])
    assert more.data.readings.categories["operator"].values.tolist() == [*OPERATOR, OPERATOR[-1], OPERATOR[-1]]
    candidates, _ = more.candidates(more.model([]), np.array([1.0, 0.5]))
    (found,) = [each for each in candidates if each.term.effect == "level[operator]"]
    assert found.derivative.shape == (ROWS + 2, 2)


PLUGIN = '''\
from rigctl.effects import effect


@effect("bens-thumb", on="response", parameters={"push": "mm"}, typical={"push": 0.01})
def bens_thumb(run, push):
    """Ben leans on the table, the more the farther out."""
    return push * (run.column("operator") == "Ben") * run.column("x_mm")
'''


def test_a_plugin_may_look_at_words(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(PLUGIN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plugins = [load(path)]
    table = study(plugins=plugins)
    candidates, _ = table.candidates(table.model([]), np.array([1.0, 0.5]))
    (found,) = [each for each in candidates if each.term.effect == "bens-thumb"]
    assert found.derivative[:, 0] == pytest.approx((OPERATOR == "Ben") * X)


def test_a_figure_has_the_words_below() -> None:
    plate = residual_plate("operator", [compare(study(), ())])
    assert {(row.value, row.level) for row in plate.rows} == {(0.0, "Ada"), (1.0, "Ben"), (2.0, "Cy")}
    assert turned(plate.svg, "Ada", "Ben", "Cy") == {False}
    bench = [f"the bench in room {i % 10}" for i in range(ROWS)]
    crowded = residual_plate("operator", [compare(study(operator=bench), ())])
    assert turned(crowded.svg, *set(bench)) == {True}


def turned(svg: str, *labels: str) -> set[bool]:
    """Whether labels of a figure, all of which must be there, stand upright."""
    found = {text: "rotate" in look for look, text in re.findall(r"<text ([^>]*)>([^<]*)</text>", svg)}
    return {found[label] for label in labels}


def test_slopes_by_word_are_drawn_as_a_line_for_each_word() -> None:
    table = study()
    found = fit(table, [Term("slope[x_mm by operator]")])
    model = table.model(found.terms)
    values = np.array([found.parameters[each.name].value for each in model.parameters])
    (plate,) = term_plates(model, values)
    assert {row.level for row in plate.rows} == {"Ada", "Ben", "Cy"}
    lines = dict(plate.draw(plate.rows).axes[0].labelled())
    assert lines.keys() == {"Ada", "Ben", "Cy"}
    for line in lines.values():
        x, y = line.x, line.y
        assert y == pytest.approx(np.polyval(np.polyfit(x, y, 1), x), abs=1e-9)  # straight, not from word to word
