"""A certificate as PDF: its page printed by a browser, its data attached as a file, for `rigctl verify`."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rigctl.certificate import page, sealed
from rigctl.certificate.sections import Content
from rigctl.core.errors import ConfigError, DataError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
"""Programs that print a page without a screen, all by the same options."""

PRINTING_S = 120.0
"""A certificate of some pages takes a second or two."""

ATTACHMENT = "rigctl-certificate.json"


def browser() -> str:
    """The browser that prints; `ConfigError` where none is found."""
    named = os.environ.get("RIGCTL_BROWSER")
    for name in [named] if named else BROWSERS:
        if found := shutil.which(name):
            return found
    wanted = f"RIGCTL_BROWSER names {named}, which is not there" if named else "no browser is found that prints it"
    raise ConfigError(f"a PDF needs a browser: {wanted}; install chromium, or write an .html and print that")


def pdf(content: Content) -> bytes:
    """The file, with its data attached and a place for its hash; `ConfigError` and `DataError` where none is made."""
    from pypdf import PdfReader, PdfWriter

    writer = PdfWriter(clone_from=PdfReader(io.BytesIO(_printed(page.page(content)))))
    writer.add_attachment(ATTACHMENT, json.dumps(content).encode())
    made = io.BytesIO()
    writer.write(made)
    # A comment behind the end, as readers expect it within the last kilobyte.
    return made.getvalue() + f"\n% {sealed.place()}\n".encode()


def data_of(data: bytes) -> Any:
    """The data of a certificate's file; `ValueError` where there are none."""
    from pypdf import PdfReader
    from pypdf.errors import PyPdfError

    try:
        attached = PdfReader(io.BytesIO(data)).attachments.get(ATTACHMENT)
    except (PyPdfError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a whole PDF ({error})") from error
    if not attached:
        raise ValueError("no certificate's data in it")
    return json.loads(attached[0])


def _printed(text: str) -> bytes:
    program = browser()
    with TemporaryDirectory() as directory:
        source, printed = Path(directory) / "certificate.html", Path(directory) / "certificate.pdf"
        source.write_text(text)
        options = ["--headless", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={directory}/profile"]
        if os.name == "posix" and os.geteuid() == 0:
            # It refuses to begin in its sandbox for the superuser; what it prints is ours.
            options.append("--no-sandbox")
        command = [program, *options, f"--print-to-pdf={printed}", source.as_uri()]
        try:
            # Found on the path, or named by the operator.
            ended = subprocess.run(command, capture_output=True, timeout=PRINTING_S, check=False)  # noqa: S603
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DataError(f"{program}: the certificate was not printed: {error}; write an .html") from error
        if not printed.exists():
            last = ended.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["it said nothing"]
            raise DataError(f"{program}: the certificate was not printed: {last[0]}; write an .html")
        return printed.read_bytes()
