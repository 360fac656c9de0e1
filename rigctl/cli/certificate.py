"""The commands that issue a certificate and verify one."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rigctl.campaign.item import ITEM
from rigctl.campaign.store.entries import CERTIFIED
from rigctl.certificate import issue
from rigctl.certificate.content import certificate_of
from rigctl.certificate.verify import verify as verified
from rigctl.cli.io import Json, Plugins, StoreFile, print_outcome, tell
from rigctl.composition import opened_workbench
from rigctl.core.clock import utc_now
from rigctl.files.certificate_file import CertificateDetails, read_details

app = typer.Typer(add_completion=False)


@app.command()
def certificate(
    store: StoreFile,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Written as .html, .pdf or .xml.")],
    details: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Laboratory, customer, item, requirements.")
    ] = None,
    unfinished: Annotated[bool, typer.Option("--unfinished", help="Also of a campaign that is not over.")] = False,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Write a calibration certificate: result, uncertainty, conformity, and a hash over what they rest on."""
    issue.form_of(out)
    given = read_details(details) if details else CertificateDetails()
    with opened_workbench(store, plugin or ()) as workbench:
        made = certificate_of(workbench, given, utc_now(), unfinished=unfinished, tell=tell)
        issue.write(made, out)
        # Who looks at the store later knows of which item it is: no certificate need be at hand.
        workbench.store.add_event(CERTIFIED, {"number": made.number, "file": str(out), ITEM: made.item.stated})
    for warning in made.content["warnings"]:
        tell(f"warning: {warning}")
    document = {"written": str(out), "number": made.number, "basis_sha256": made.content["basis_sha256"]}
    print_outcome(document, f"certificate {made.number}, unsigned: {out}", as_json=as_json)


@app.command()
def verify(
    cert: Annotated[Path, typer.Argument(metavar="CERT", help="A file of `rigctl certificate`.")],
    store: StoreFile,
    as_json: Json = False,
) -> None:
    """Check that a certificate is as it was issued, and that a store is still what it rests on."""
    found = verified(cert, store)
    state = "signed" if found.signed else "unsigned"
    later = f"; {found.later} later versions of the model" if found.later else ""
    print_outcome(asdict(found), f"certificate {found.number} ({state}) is true of {store}{later}", as_json=as_json)
