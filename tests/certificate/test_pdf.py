"""A certificate as PDF: printed by a browser, with its data attached, and verified like the page."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from rigctl.certificate.pdf import BROWSERS

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"

PRINTER = """#!{python}
import sys
from pypdf import PdfWriter

(out,) = [each.partition("=")[2] for each in sys.argv if each.startswith("--print-to-pdf=")]
writer = PdfWriter()
writer.add_blank_page(width=595, height=842)
writer.write(out)
"""
"""A browser that prints an empty sheet."""


@pytest.fixture
def table(desk: Any) -> Any:
    """A desk with the table of Pontius, imported and with its square."""
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    assert desk.rigctl("model", "add", desk.store, "power2[load_lb]").status == 0
    return desk


def browser(monkeypatch: pytest.MonkeyPatch, directory: Path, script: str) -> None:
    path = directory / "browser"
    path.write_text(script)
    path.chmod(0o755)
    monkeypatch.setenv("RIGCTL_BROWSER", str(path))


@pytest.fixture
def printer(table: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    browser(monkeypatch, table.directory, PRINTER.format(python=sys.executable))


@pytest.mark.usefixtures("printer")
def test_a_pdf_is_verified_by_the_data_it_carries(table: Any) -> None:
    out = table.directory / "t.pdf"
    issued = table.rigctl("certificate", table.store, "--out", out, "--json").json
    assert table.rigctl("verify", out, table.store, "--json").json["sha256"] == issued["basis_sha256"]
    assert table.rigctl("mark", table.store, "readings", "dropped", "--invalid").status == 0
    table.rigctl("verify", out, table.store).refused(1, "was marked invalid since (dropped)")


@pytest.mark.usefixtures("printer")
def test_a_changed_or_damaged_pdf_is_refused(table: Any) -> None:
    out = table.directory / "t.pdf"
    assert table.rigctl("certificate", table.store, "--out", out).status == 0
    data = out.read_bytes()
    out.write_bytes(data.replace(b"842", b"843", 1))
    table.rigctl("verify", out, table.store).refused(1, "changed after it was issued")
    out.write_bytes(data[: len(data) // 3])
    table.rigctl("verify", out, table.store).refused(2, "no certificate of this program")
    out.write_bytes(b"%PDF-1.7\n")
    table.rigctl("verify", out, table.store).refused(2, "no certificate of this program")


def test_without_a_browser_one_line_says_so_before_any_work(table: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    out = table.directory / "t.pdf"
    monkeypatch.setenv("RIGCTL_BROWSER", "/nowhere/browser")
    table.rigctl("certificate", table.store, "--out", out).refused(2, "/nowhere/browser", "write an .html")
    monkeypatch.delenv("RIGCTL_BROWSER")
    monkeypatch.setenv("PATH", str(table.directory))
    table.rigctl("certificate", table.store, "--out", out).refused(2, "no browser is found", "install chromium")
    assert not out.exists()


def test_a_browser_that_prints_nothing_is_told(table: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    out = table.directory / "t.pdf"
    browser(monkeypatch, table.directory, "#!/bin/sh\necho no display >&2\n")
    ended = table.rigctl("certificate", table.store, "--out", out)
    assert ended.status == 2
    assert ended.err.splitlines()[-1].endswith("was not printed: no display; write an .html")
    assert not out.exists()


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no browser here")
def test_a_printed_certificate_says_what_its_page_does_on_numbered_sheets(table: Any) -> None:
    (table.directory / "d.toml").write_text("number = 'N\"</style>-1'\n")
    out = table.directory / "t.pdf"
    assert table.rigctl("certificate", table.store, "--details", "d.toml", "--out", out).status == 0
    sheets = [sheet.extract_text() for sheet in PdfReader(out).pages]
    # NIST's Pontius: b1 = 7.3206e-07.
    assert "7.3206e-07" in sheets[0]
    for number, sheet in enumerate(sheets, 1):
        assert f"page {number} of {len(sheets)}" in sheet
        assert 'N"</style>-1' in sheet
    assert table.rigctl("verify", out, table.store).status == 0
