"""A certificate as one HTML file: no script, no network; its data stand in it as JSON, for `rigctl verify`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from rigctl.certificate.sections import UNSIGNED, Content, Section, heading, sections, signature_lines
from rigctl.report import html
from rigctl.report.tables.result_table import ResultTable

_DATA = '<script type="application/json" id="rigctl-certificate">'
_END = "</script>"


def page(content: Content) -> str:
    """The certificate, its data in it."""
    body = [
        html.heading(heading(content), 1),
        html.paragraph(UNSIGNED, "verdict"),
        *(html.paragraph(warning, "verdict") for warning in content["warnings"]),
        *(piece for each in sections(content) for piece in _section(each)),
        html.heading("Signatures"),
        *(html.paragraph(f"{line} ____________________________") for line in signature_lines(content)),
        f"{_DATA}{_data(content)}{_END}",
    ]
    return html.page(heading(content), body, _sheets(str(content["number"])))


def _sheets(number: str) -> str:
    """On paper every sheet says of which certificate it is, and of how many (ISO/IEC 17025, 7.8.2.1 d)."""
    told = "".join(each if each.isascii() and each.isalnum() else f"\\{ord(each):x} " for each in number)
    return (
        "@page { margin: 16mm 15mm 18mm; "
        f'@bottom-left {{ content: "{told}"; font: 8pt sans-serif }} '
        '@bottom-right { content: "page " counter(page) " of " counter(pages); font: 8pt sans-serif } }'
    )


def data_of(text: str) -> Any:
    """The data of a certificate's page; `ValueError` where there are none."""
    found = re.search(re.escape(_DATA) + "(.*?)" + re.escape(_END), text, re.DOTALL)
    if found is None:
        raise ValueError("no certificate's data in it")
    return json.loads(found.group(1))


def _section(section: Section) -> Iterator[str]:
    yield html.heading(section.title)
    for block in section.blocks:
        if isinstance(block, ResultTable):
            yield html.paragraph(block.title) if block.title and block.title != section.title else ""
            yield html.table(block)
        elif isinstance(block, str):
            yield html.paragraph(block)
        else:
            yield html.listing(block)


def _data(content: Content) -> str:
    # A name with markup must not end the element.
    return json.dumps(content, ensure_ascii=True).replace("<", "\\u003c")
