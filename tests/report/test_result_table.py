"""Tables at any width: no number is cut, none is parted from its uncertainty, and no text is lost."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from rigctl.report.tables.result_table import ResultTable, rich_table

NUMBERS = st.tuples(st.floats(-1e6, 1e6), st.floats(1e-9, 1e3)).map(lambda pair: f"{pair[0]:.6g} ± {pair[1]:.2g}")
WORDS = st.text("abcdefgh ", min_size=1, max_size=24).map(lambda text: " ".join(text.split()) or "a")


def drawn(table: ResultTable, width: int) -> str:
    console = Console(width=width, file=io.StringIO(), no_color=True)
    console.print(rich_table(table))
    return console.file.getvalue()  # type: ignore[attr-defined]


@st.composite
def tables(draw: st.DrawFn) -> ResultTable:
    count, rows = draw(st.integers(1, 9)), draw(st.integers(1, 6))
    headings = ["run", *(f"#{draw(WORDS)} / m s" for _ in range(count))]
    return ResultTable("", headings, [[f"r{row}", *(draw(NUMBERS) for _ in range(count))] for row in range(rows)])


@given(table=tables(), width=st.integers(48, 200))
def test_every_number_stands_whole_beside_the_name_of_its_row(table: ResultTable, width: int) -> None:
    lines = drawn(table, width).splitlines()
    assert max(map(len, lines)) <= width
    for name, *cells in table.rows:
        mine = [line for line in lines if f" {name} " in line]
        for cell in cells:
            assert any(cell in line for line in mine), (cell, mine)


@given(table=tables())
def test_where_there_is_room_a_table_is_one(table: ResultTable) -> None:
    lines = drawn(table, 2000).splitlines()
    assert sum("┏" in line for line in lines) == 1
    assert all(heading.lstrip("#") in lines[1] for heading in table.columns)


def test_a_cell_of_several_lines_is_as_wide_as_its_longest() -> None:
    rows = [["* quadratic\n    K2[X] = 0.0040 ± 0.0002 s2/m\n    like cable-hysteresis", "1e-23"], ["  yaw", "1"]]
    lines = drawn(ResultTable("", ["effect", "#p corr."], rows), 100).splitlines()
    assert len(lines[0]) == len("│     K2[X] = 0.0040 ± 0.0002 s2/m │ p corr. │")


def test_rows_that_one_column_does_not_tell_apart_keep_the_columns_that_do() -> None:
    rows = [["3", "-606", reading, *["-1430.3 ± 6.9"] * 6] for reading in ("m_y", "m_z")]
    pieces = drawn(ResultTable("", ["scan", "#tilt", "reading", *["#cos"] * 6], rows), 64)
    assert pieces.count("reading") == 3
    assert pieces.count("-1430.3 ± 6.9") == 12


def test_what_is_wider_than_the_terminal_by_itself_is_folded_and_not_lost() -> None:
    value = "0123456789±987654321"
    shown = drawn(ResultTable("", ["name", "#value"], [["a", value]]), 24)
    assert max(map(len, shown.splitlines())) <= 24
    assert "".join(sign for sign in shown if sign in value) == value


@pytest.mark.parametrize("columns", [None, "60"])
def test_a_file_has_whole_lines_unless_a_width_is_asked_for(columns: str | None) -> None:
    code = (
        "from rigctl.report.tables.result_table import ResultTable, print_tables\n"
        "columns, row = ['run', *['#value'] * 20], ['r1', *['287.51 ± 0.14'] * 20]\n"
        "print_tables([ResultTable('', columns, [row], notes=['x ' * 90])])"
    )
    env = {} if columns is None else {"COLUMNS": columns}
    out = subprocess.run(
        [sys.executable, "-c", code], env=env | {"PYTHONIOENCODING": "utf-8"}, capture_output=True, check=True
    ).stdout.decode()
    assert out.count("287.51 ± 0.14") == 20
    assert sum("287.51" in line for line in out.splitlines()) == (1 if columns is None else 7)
    assert sum(line.startswith("x ") for line in out.splitlines()) == (1 if columns is None else 3)
