"""The file: a DCC of a certificate's content, with that content attached as JSON, for `rigctl verify`."""

from __future__ import annotations

import base64
import json
import re
from typing import Any
from xml.etree import ElementTree

from rigctl.certificate import sealed
from rigctl.certificate.dcc.administration import SCHEMA_VERSION, administrative_data
from rigctl.certificate.dcc.elements import NAMESPACES, content, element, filled, named
from rigctl.certificate.dcc.results import measurement_results
from rigctl.certificate.sections import Content

ATTACHMENT = "rigctl-certificate.json"

_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_DATA = re.compile(r"<dcc:document>.*?<dcc:dataBase64>([A-Za-z0-9+/=\s]+)</dcc:dataBase64>", re.DOTALL)
"""Texts have no `<` of their own, so that this is the element."""


def dcc(said: Content) -> bytes:
    """The file, with a place for its hash."""
    root = element(
        "dcc:digitalCalibrationCertificate",
        administrative_data(said),
        measurement_results(said),
        _document(said),
        schemaVersion=SCHEMA_VERSION,
    )
    where = f"{NAMESPACES['dcc']} {NAMESPACES['dcc']}/v{SCHEMA_VERSION}/dcc.xsd"
    root.set(f"{{{_INSTANCE}}}schemaLocation", where)
    for prefix, namespace in (*NAMESPACES.items(), ("xsi", _INSTANCE)):
        ElementTree.register_namespace(prefix, namespace)
    ElementTree.indent(root)
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written + f"\n<!-- {sealed.place()} -->\n".encode()


def data_of(text: str) -> Any:
    """The data of a certificate's file; `ValueError` where there are none."""
    found = _DATA.search(text)
    if found is None:
        raise ValueError("no certificate's data in it")
    return json.loads(base64.b64decode(found.group(1)))


def _document(said: Content) -> ElementTree.Element:
    data = base64.b64encode(json.dumps(said, ensure_ascii=True).encode()).decode()
    about = (
        "All that this certificate says, in full, with the hash of every run's samples and conditions; "
        "`rigctl verify` compares it with a store.",
    )
    return named(
        "dcc:document",
        "data of the certificate",
        content("dcc:description", *about),
        filled("dcc:fileName", ATTACHMENT),
        filled("dcc:mimeType", "application/json"),
        filled("dcc:dataBase64", data),
    )
