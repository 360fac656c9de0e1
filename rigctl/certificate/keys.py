"""Keys that sign and check signatures, in PEM files. Imports `cryptography`, which the extra `sign` brings."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import padding
from cryptography.hazmat.primitives.asymmetric.ec import (
    ECDSA,
    SECP256R1,
    EllipticCurvePrivateKey,
    EllipticCurvePublicKey,
)
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    PublicFormat,
    load_der_public_key,
    load_pem_private_key,
    load_pem_public_key,
)

from rigctl.core.bounds import KEY_BYTES, read_regular
from rigctl.core.errors import ConfigError

PrivateKey = Ed25519PrivateKey | EllipticCurvePrivateKey | RSAPrivateKey
PublicKey = Ed25519PublicKey | EllipticCurvePublicKey | RSAPublicKey

KINDS = "Ed25519, ECDSA P-256, or RSA of 2048 bits and more"
RSA_BITS = 2048
"""The least that NIST SP 800-57 has after 2015."""

_SHA256 = hashes.SHA256()
_PSS = padding.PSS(padding.MGF1(_SHA256), padding.PSS.DIGEST_LENGTH)
_FLAWS = (ValueError, TypeError, UnsupportedAlgorithm)
"""What is raised of a file that has no key, or none for the passphrase."""


def private_key(path: Path, passphrase: Callable[[], bytes]) -> PrivateKey:
    """The key that signs; `passphrase` is asked where the file is encrypted. `ConfigError` for anything else."""
    data = _read(path)
    try:
        key = _decrypted(data, None)
    except TypeError:
        # So says the library that a passphrase is needed.
        try:
            key = _decrypted(data, passphrase())
        except _FLAWS as error:
            raise ConfigError(f"{path}: the passphrase does not open this key; give the right one") from error
    except _FLAWS as error:
        raise ConfigError(f"{path}: no private key in PEM; name the file of one: {KINDS}") from error
    if not isinstance(key, PrivateKey) or not algorithm(key.public_key()):
        raise ConfigError(f"{path}: no key of a kind that signs here; make one of {KINDS}")
    return key


def _decrypted(data: bytes, passphrase: bytes | None) -> object:
    return load_pem_private_key(data, passphrase)


def certificate(path: Path) -> x509.Certificate:
    """The X.509 certificate in a file, the first of several; `ConfigError`."""
    try:
        return x509.load_pem_x509_certificate(_read(path))
    except _FLAWS as error:
        raise ConfigError(f"{path}: no X.509 certificate in PEM; name the file of one") from error


def public_key(path: Path) -> PublicKey:
    """The public key in a file, or that of its X.509 certificate; `ConfigError`."""
    data = _read(path)
    try:
        if b"-----BEGIN CERTIFICATE-----" in data:
            key: object = x509.load_pem_x509_certificate(data).public_key()
        else:
            key = load_pem_public_key(data)
    except _FLAWS as error:
        raise ConfigError(f"{path}: neither a public key nor an X.509 certificate in PEM; name one") from error
    if not isinstance(key, PublicKey):
        raise ConfigError(f"{path}: no key of a kind that signs here: {KINDS}")
    return key


def _read(path: Path) -> bytes:
    """The bytes of a small file; `ConfigError`."""
    try:
        return read_regular(path, KEY_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error


def passphrase_in(path: Path) -> bytes:
    """The first line of a file; `ConfigError`."""
    return _read(path).partition(b"\n")[0].rstrip(b"\r")


def readable_by_others(path: Path) -> bool:
    """Whether other users of this computer can read a file, as far as its mode tells."""
    return os.name == "posix" and bool(path.stat().st_mode & (stat.S_IRGRP | stat.S_IROTH))


def algorithm(key: object) -> str | None:
    """How a public key signs, None for one that does not here."""
    if isinstance(key, Ed25519PublicKey):
        return "Ed25519"
    if isinstance(key, EllipticCurvePublicKey) and isinstance(key.curve, SECP256R1):
        return "ECDSA-P256-SHA256"
    if isinstance(key, RSAPublicKey) and key.key_size >= RSA_BITS:
        return "RSA-PSS-SHA256"
    return None


def signature(key: PrivateKey, message: bytes) -> bytes:
    """The signature of a message."""
    if isinstance(key, Ed25519PrivateKey):
        return key.sign(message)
    if isinstance(key, EllipticCurvePrivateKey):
        return key.sign(message, ECDSA(_SHA256))
    return key.sign(message, _PSS, _SHA256)


def fits(signed: bytes, message: bytes, der: bytes, how: str) -> bool:
    """Whether `signed` is the signature of a message by the key `der` and the algorithm `how`."""
    try:
        key = load_der_public_key(der)
        if algorithm(key) != how:
            return False
        if isinstance(key, Ed25519PublicKey):
            key.verify(signed, message)
        elif isinstance(key, EllipticCurvePublicKey):
            key.verify(signed, message, ECDSA(_SHA256))
        elif isinstance(key, RSAPublicKey):
            key.verify(signed, message, _PSS, _SHA256)
    except (InvalidSignature, *_FLAWS):
        return False
    return True


def der(key: PublicKey) -> bytes:
    """A public key as bytes: SubjectPublicKeyInfo."""
    return key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)


def fingerprint(der: bytes) -> str:
    """SHA-256 of a public key, as `openssl pkey -pubin -outform DER | sha256sum` has it."""
    return hashlib.sha256(der).hexdigest()


def subject(given: x509.Certificate) -> str:
    """The common name of an X.509 certificate's subject, or all of the subject where it has none."""
    names = given.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return str(names[0].value) if names else given.subject.rfc4514_string()


def flaw(given: x509.Certificate, key: bytes, time: str) -> str:
    """Why an X.509 certificate does not stand for a key (DER) at a time (ISO 8601); "" where it does."""
    try:
        of = given.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    except _FLAWS:
        of = b""
    if of != key:
        return "is that of another key"
    begins, ends = given.not_valid_before_utc, given.not_valid_after_utc
    return "" if begins <= datetime.fromisoformat(time) <= ends else f"is valid from {begins} to {ends} only"
