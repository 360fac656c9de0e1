"""The commands that issue a certificate, sign one and verify one."""

from __future__ import annotations

import getpass
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rigctl.certificate.issue import issue
from rigctl.certificate.signature import Signer, beside
from rigctl.certificate.verify import verify as verified
from rigctl.cli.io import Json, Plugins, StoreFile, print_outcome, tell
from rigctl.composition import opened_workbench
from rigctl.core.clock import utc_now
from rigctl.core.errors import Aborted, ConfigError, one_line
from rigctl.core.extra import SIGN, needed
from rigctl.files.certificate_file import CertificateDetails, read_details
from rigctl.report.quantities import counted

app = typer.Typer(add_completion=False)

CertFile = Annotated[Path, typer.Argument(metavar="CERT", help="A file of `rigctl certificate`.")]

VARIABLE = "RIGCTL_PASSPHRASE"
"""Environment variable for scripts: the passphrase of the key that signs."""


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
    given = read_details(details) if details else CertificateDetails()
    with opened_workbench(store, plugin or (), readonly=False) as workbench:
        made = issue(workbench, given, out, unfinished=unfinished, tell=tell)
    for warning in made.content["warnings"]:
        tell(f"warning: {warning}")
    document = {"written": str(out), "number": made.number, "basis_sha256": made.content["basis_sha256"]}
    print_outcome(document, f"certificate {made.number}, unsigned: {out}", as_json=as_json)


@app.command()
def sign(
    cert: CertFile,
    key: Annotated[Path, typer.Option(metavar="KEY.pem", help="Your private key.")],
    name: Annotated[str, typer.Option(metavar="NAME", help="Who signs.")] = "",
    certificate: Annotated[
        Path | None, typer.Option(metavar="X509.pem", help="Your X.509 certificate, which says who signs.")
    ] = None,
    passphrase_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The key's passphrase, in its first line.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Sign a calibration certificate: a file CERT.sig beside it, which `rigctl verify` checks."""
    if name and certificate:
        raise typer.BadParameter("--certificate says who signs; leave out --name")
    needed("cryptography", SIGN)
    from rigctl.certificate import keys, signing

    private = keys.private_key(key, lambda: _passphrase(key, passphrase_file))
    signer = signing.sign(cert, private, utc_now(), name=name, given=certificate)
    for secret in filter(None, (key, passphrase_file)):
        if keys.readable_by_others(secret):
            tell(f"warning: {secret} can be read by others; chmod 600 it")
    written = beside(cert)
    document = {"written": str(written), **asdict(signer)}
    print_outcome(document, f"{_signed(signer)}: {written}", as_json=as_json)


@app.command()
def verify(
    cert: CertFile,
    store: StoreFile,
    trust: Annotated[
        Path | None, typer.Option(metavar="KEY.pem", help="The signer's public key or X.509 certificate.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check that a certificate is as it was issued and signed, and that a store is still what it rests on."""
    found = verified(cert, store, trust)
    later = f"; {counted(found.later, 'later version')} of the model" if found.later else ""
    print_outcome(
        asdict(found),
        f"certificate {found.number} is true of {store}{later}; {_who(found.signature, cert, trust)}",
        as_json=as_json,
    )


def _who(signer: Signer | None, cert: Path, trust: Path | None) -> str:
    if signer is None:
        return f"unsigned: there is no {beside(cert).name}"
    key = f"which is that of {trust}" if signer.trusted else "which was compared with none that you trust (--trust)"
    return f"{_signed(signer)}, {key}"


def _signed(signer: Signer) -> str:
    said = "X.509, issuer not checked" if signer.x509 else "by the signer's own word"
    return one_line(
        f"signed by {signer.name} ({said}) on {signer.time} with the {signer.algorithm} key {signer.key_sha256}"
    )


def _passphrase(key: Path, file: Path | None) -> bytes:
    if file:
        from rigctl.certificate.keys import passphrase_in

        return passphrase_in(file)
    if VARIABLE in os.environ:
        return os.fsencode(os.environ[VARIABLE])
    if not sys.stdin.isatty():
        raise ConfigError(f"{key}: encrypted; give its passphrase in {VARIABLE} or by --passphrase-file")
    try:
        return getpass.getpass(f"passphrase of {key}: ").encode()
    except EOFError:
        raise Aborted("no passphrase was typed") from None
