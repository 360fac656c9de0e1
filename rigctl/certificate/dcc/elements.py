"""Elements of a DCC: their namespaces, texts, and numbers as its schemas write them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement

NAMESPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
LANGUAGE = "en"

_NO_CHARACTER = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to write."""


def element(tag: str, *children: Element | None, **attributes: str) -> Element:
    """`dcc:name` or `si:name` with its children; None among these is one that is not stated."""
    prefix, _, name = tag.partition(":")
    made = Element(f"{{{NAMESPACES[prefix]}}}{name}", attributes)
    made.extend(child for child in children if child is not None)
    return made


def filled(tag: str, said: str) -> Element | None:
    """An element with a line of text; None where nothing is said, for the schema allows no empty one."""
    line = " ".join(_written(said).split())
    if not line:
        return None
    made = element(tag)
    made.text = line
    return made


def content(tag: str, *said: str) -> Element | None:
    """An element of `dcc:content` paragraphs; None where nothing is said."""
    paragraphs = [_written(each) for each in said if each.strip()]
    if not paragraphs:
        return None
    made = element(tag)
    for each in paragraphs:
        SubElement(made, f"{{{NAMESPACES['dcc']}}}content", lang=LANGUAGE).text = each
    return made


def named(tag: str, name: str, *children: Element | None, **attributes: str) -> Element:
    """An element that begins with its `dcc:name`."""
    return element(tag, content("dcc:name", name), *children, **attributes)


def some(tag: str, children: Iterable[Element | None], **attributes: str) -> Element | None:
    """A list of elements; None where there is none."""
    there = [child for child in children if child is not None]
    return element(tag, *there, **attributes) if there else None


def decimal(value: float) -> str:
    """A number to its last digit; the schemas have no infinity, only what is no number."""
    return repr(float(value)) if math.isfinite(value) else "NaN"


def _written(said: str) -> str:
    return _NO_CHARACTER.sub("\ufffd", said)
