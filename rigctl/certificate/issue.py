"""A certificate written to a file whose name says the form, and read back from one."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.item import ITEM
from rigctl.campaign.store.entries import CERTIFIED
from rigctl.certificate import page, pdf, sealed, signature
from rigctl.certificate.content import FORMAT, Certificate, Tell, certificate_of
from rigctl.certificate.dcc import document
from rigctl.certificate.sections import Content
from rigctl.core.clock import utc_now
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.core.whole_file import writing
from rigctl.files.certificate_file import CertificateDetails
from rigctl.report import html
from rigctl.workbench.workbench import Workbench


class NotVerified(ProcedureError):
    """A certificate that is not as it was issued or signed, or not that of a store: what differs, in one line."""


@dataclass(frozen=True)
class Issued:
    """A certificate's file as it was issued: its `content`, and the SHA-256 of the file, in hexadecimal digits."""

    content: Mapping[str, Any]
    sha256: str


def _html(content: Content) -> bytes:
    text = page.page(content)
    return text.replace("</body>", f"<!-- {sealed.place()} -->\n</body>").encode()


FORMS: Mapping[str, Callable[[Content], bytes]] = {".html": _html, ".pdf": pdf.pdf, ".xml": document.dcc}
"""By suffix, what makes a file of a certificate's content."""


def form_of(out: Path) -> str:
    """The suffix of a file that can be written; `ConfigError` for another one, and for a PDF without a browser.

    A file that was signed is not written anew: `ConfigError`. `DataError` where there is no such directory.
    """
    suffix = out.suffix.lower()
    if suffix not in FORMS:
        raise ConfigError(f"{out}: certificates are written as {', '.join(FORMS)} only; give the file such a name")
    if signature.beside(out).exists():
        raise ConfigError(f"{out}: {signature.beside(out).name} signs what is there; give the new one another name")
    html.require_directory(out)
    if suffix == ".pdf":
        pdf.browser()
    return suffix


def issue(
    workbench: Workbench, details: CertificateDetails, out: Path, *, unfinished: bool = False, tell: Tell
) -> Certificate:
    """Certify a store's result in a file, and keep in the store that this was done, and of which item.

    `ConfigError` and `DataError` as `form_of`, `certificate_of` and `write` raise them.
    """
    form_of(out)
    made = certificate_of(workbench, details, utc_now(), unfinished=unfinished, tell=tell)
    write(made, out)
    # Who looks at the store later knows of which item it is: no certificate need be at hand.
    workbench.store.add_event(CERTIFIED, {"number": made.number, "file": str(out), ITEM: made.item.stated})
    return made


def write(certificate: Certificate, out: Path) -> None:
    """Write a certificate, whole or not at all; `ConfigError` for its name, `DataError` where it cannot be."""
    data = sealed.sealed(FORMS[form_of(out)](certificate.content))
    partial = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        with writing(out):
            partial.write_bytes(data)
            partial.replace(out)
    finally:
        with suppress(OSError):  # it has its name, or its medium takes nothing
            partial.unlink()


def read(path: Path) -> Issued:
    """A certificate; `NotVerified` for one that was changed since, `DataError` for anything else."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error
    unchanged = sealed.intact(data)
    try:
        content = _data_of(data)
    except (ValueError, json.JSONDecodeError) as error:
        raise DataError(
            f"{path}: no certificate of this program: {error}; name a file of `rigctl certificate`"
        ) from error
    if unchanged is None or not isinstance(content, dict) or content.get("format") != FORMAT:
        raise DataError(f"{path}: no certificate of this program ({FORMAT}); name a file of `rigctl certificate`")
    if not unchanged:
        raise NotVerified(f"{path}: changed after it was issued: its own hash does not fit; ask for the original")
    return Issued(content, hashlib.sha256(data).hexdigest())


def _data_of(data: bytes) -> Any:
    if data.startswith(b"%PDF"):
        return pdf.data_of(data)
    text = data.decode("utf-8")
    return document.data_of(text) if text.startswith("<?xml") else page.data_of(text)
