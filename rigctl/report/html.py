"""One HTML file that needs nothing else: no network, whole without script, in light, in the dark and on paper."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

from rigctl.core.errors import DataError
from rigctl.core.whole_file import writing
from rigctl.report.figures.data import Plate
from rigctl.report.tables.result_table import ResultTable

_STYLE = """
:root { color-scheme: light dark;
        --paper: #ffffff; --ink: #1a1a1a; --soft: #6b6b6b; --rule: #d0d0d0; --mark: #fff3d6; --good: #e3f3ec; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #16181c; --ink: #e4e4e4; --soft: #9a9a9a; --rule: #3b3f46; --mark: #3d3315; --good: #15352a; }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 58rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0.2rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
h3 { font-size: 1rem; margin-top: 1.6rem; }
p.verdict { font-size: 1.15rem; padding: 0.7rem 1rem; border-left: 4px solid #D55E00; background: var(--mark); }
p.verdict.adequate { border-color: #009E73; background: var(--good); }
.soft, figcaption { color: var(--soft); font-size: 0.87rem; }
figure { margin: 1.2rem 0; break-inside: avoid; } svg { width: 100%; height: auto; color: var(--ink); }
table { border-collapse: collapse; font-size: 0.87rem; margin: 0.8rem 0; }
.wide { overflow-x: auto; }
th, td { padding: 0.2rem 0.7rem 0.2rem 0; text-align: left; vertical-align: top;
         border-bottom: 1px solid var(--rule); }
th { vertical-align: bottom; } td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
td.n { white-space: nowrap; }
tr.mark td { background: var(--mark); } code { font-size: 0.95em; }
svg text { fill: currentColor; }
@media print {
  :root { color-scheme: light; --paper: #ffffff; --ink: #000000; --soft: #444444; --rule: #bbbbbb;
          --mark: #eeeeee; --good: #eeeeee; }
  body { margin: 0; max-width: none; font-size: 10pt; } h2, h3, p:has(+ .wide) { break-after: avoid; }
  table { font-size: 8pt; } tr, .wide { break-inside: avoid; } .wide { overflow: visible; }
  svg { max-height: 10.5cm; } figure { margin: 0.8rem 0; }
}
"""


def page(title: str, body: Iterable[str], style: str = "", script: str = "") -> str:
    """A whole document around pieces of HTML, with further rules of `style`, and a script where there is one."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}{style}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + (f"\n<script>{script}</script>" if script else "")
        + "\n</body>\n</html>\n"
    )


def require_directory(out: Path) -> None:
    """`DataError` unless there is a directory to write a page into; asked before its contents are worked out."""
    if not out.parent.is_dir():
        raise DataError(f"{out}: cannot be written: there is no directory {out.parent}; make it first")


def write_page(out: Path, text: str) -> None:
    """Write a page, whole or not at all; `DataError` when it cannot be written."""
    # Beside the page, so that the replacement is one step of one file system.
    partial = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        with writing(out):
            partial.write_text(text, encoding="utf-8")
            partial.replace(out)
    finally:
        with suppress(OSError):  # it has its name, or its medium takes nothing
            partial.unlink()


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text."""
    return f'<p class="{escape(kind)}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def command(text: str) -> str:
    """A command line."""
    return f"<p><code>{escape(text)}</code></p>"


def listing(items: Iterable[str]) -> str:
    """A list of plain texts; "" when it is empty."""
    inside = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{inside}</ul>" if inside else ""


def table(table: ResultTable) -> str:
    """A table's rows and its notes."""
    filled = table.filled()
    kinds = [' class="n"' if name.startswith("#") else "" for name in filled.columns]
    names = zip(kinds, filled.columns, strict=True)
    head = "".join(f"<th{kind}>{escape(name.lstrip('#'))}</th>" for kind, name in names)
    body = ""
    for row, marked in zip(filled.rows, filled.marks, strict=True):
        texts = ["<br>".join(map(escape, cell.split("\n"))) for cell in row]
        cells = "".join(f"<td{kind}>{text}</td>" for kind, text in zip(kinds, texts, strict=True))
        mark = ' class="mark"' if marked else ""
        body += f"<tr{mark}>{cells}</tr>"
    # A wide table scrolls by itself; the page does not.
    rows = f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    return (rows if body else "") + "".join(paragraph(note, "soft") for note in table.notes)


def figure(plate: Plate[Any]) -> str:
    """A figure with its caption, in the page's own ink on its own paper."""
    # Ink and paper of the figure become those of the page, in the dark too.
    svg = plate.svg.replace("#000000", "currentColor").replace("#ffffff", "var(--paper)")
    return f"<figure>{svg}<figcaption>{escape(plate.caption)}</figcaption></figure>"
