"""Signing a certificate's file, and asking who signed it. Imports `cryptography`, which the extra `sign` brings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from rigctl.certificate import issue, keys, signature
from rigctl.certificate.issue import Issued, NotVerified
from rigctl.certificate.signature import Signature, Signer
from rigctl.core.errors import ConfigError


def sign(path: Path, key: keys.PrivateKey, time: str, *, name: str = "", given: Path | None = None) -> Signer:
    """Sign the certificate in a file, into a new file beside it, at a time in UTC, ISO 8601.

    The signer is the subject of the X.509 certificate `given`, else `name`. `ConfigError` for a name, an X.509
    certificate or a place that does not do; `DataError` and `NotVerified` for what is no certificate as issued.
    """
    issued = issue.read(path)
    public = key.public_key()
    named = keys.certificate(given) if given else None
    der = keys.der(public)
    if named is not None and (flaw := keys.flaw(named, der, time)):
        raise ConfigError(f"{given}: {flaw}; give the X.509 certificate of the key that signs, or --name")
    made = Signature(
        sha256=issued.sha256,
        algorithm=keys.algorithm(public) or "",
        public_key=der,
        x509=named.public_bytes(Encoding.DER) if named else b"",
        name=_checked(keys.subject(named) if named else name),
        time=time,
    )
    made = replace(made, signature=keys.signature(key, made.message))
    signature.write(made, signature.beside(path))
    return _signer(made, trusted=False)


def signer_of(path: Path, issued: Issued, trust: Path | None) -> Signer:
    """Who signed a certificate that has a signature beside it.

    `NotVerified` for a signature that is wrong, and for a key other than the one in the file `trust`; `DataError` for
    no signature, `ConfigError` for a file without a key.
    """
    trusted = keys.der(keys.public_key(trust)) if trust else None
    place = signature.beside(path)
    found = signature.read(place)
    if not keys.fits(found.signature, found.message, found.public_key, found.algorithm):
        raise NotVerified(f"{place}: the signature is wrong: {place.name} was changed; ask for the original")
    if found.sha256 != issued.sha256:
        raise NotVerified(f"{path}: the signature is of another file, or it was changed since; ask for the original")
    if found.x509 and (flaw := _flaw(found)):
        raise NotVerified(f"{place}: the signature is wrong: its X.509 certificate {flaw}; ask the laboratory")
    signer = _signer(found, trusted=trusted is not None)
    if trusted is not None and trusted != found.public_key:
        raise NotVerified(
            f"{path}: signed by another key, SHA-256 {signer.key_sha256}, than that of {trust}, "
            f"SHA-256 {keys.fingerprint(trusted)}; ask the laboratory which is its own"
        )
    return signer


def _flaw(found: Signature) -> str:
    try:
        named = x509.load_der_x509_certificate(found.x509)
        return keys.flaw(named, found.public_key, found.time) or (
            "" if keys.subject(named) == found.name else "has another name"
        )
    except (ValueError, TypeError):
        return "cannot be read"


def _signer(of: Signature, *, trusted: bool) -> Signer:
    return Signer(of.name, of.time, of.algorithm, keys.fingerprint(of.public_key), bool(of.x509), trusted)


def _checked(name: str) -> str:
    plain = name.strip()
    if not plain or not plain.isprintable():
        raise ConfigError(
            "who signs is not said in one line; give --name, or --certificate with an X.509 certificate"
        )
    return plain
