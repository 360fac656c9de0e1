"""`rigctl sign`, and `rigctl verify` of what is signed: every byte counts, and keys are what they are said to be."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa, x25519
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from rigctl.certificate import issue, keys, sealed, signature
from rigctl.certificate.issue import NotVerified
from rigctl.certificate.sections import UNSIGNED
from rigctl.certificate.signature import Signature
from rigctl.certificate.signing import sign, signer_of
from rigctl.cli import certificate as command
from rigctl.cli.application import app
from rigctl.core.errors import DataError
from tests.certificate.test_pdf import PONTIUS, PRINTER, browser

NAME = "Ada Lovelace, Lab Ω"
TIME = "2026-11-27T12:00:00.000+00:00"
MADE = {
    "Ed25519": ed25519.Ed25519PrivateKey.generate,
    "ECDSA-P256-SHA256": lambda: ec.generate_private_key(ec.SECP256R1()),
    "RSA-PSS-SHA256": lambda: rsa.generate_private_key(65537, 2048),
}


def pem(key: Any, passphrase: bytes | None = None) -> bytes:
    secret = serialization.BestAvailableEncryption(passphrase) if passphrase else serialization.NoEncryption()
    return key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, secret)


def public(key: Any, encoding: Any = serialization.Encoding.PEM) -> bytes:
    return key.public_key().public_bytes(encoding, serialization.PublicFormat.SubjectPublicKeyInfo)


def certified(key: Any, name: str = NAME, *, begins_days: float = -1.0, ends_days: float = 1.0) -> bytes:
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        .not_valid_before(now + timedelta(days=begins_days))
        .not_valid_after(now + timedelta(days=ends_days))
        .sign(key, None)
    )
    return made.public_bytes(serialization.Encoding.PEM)


@pytest.fixture(scope="module")
def issued(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with a store and its certificate in the three forms."""
    directory = tmp_path_factory.mktemp("issued")
    with pytest.MonkeyPatch.context() as patch:
        browser(patch, directory, PRINTER.format(python=sys.executable))
        commands = [["import", str(PONTIUS), "--store", str(directory / "x.rig.sqlite")]]
        commands += [["certificate", commands[0][-1], "--out", str(directory / f"t{form}")] for form in issue.FORMS]
        for words in commands:
            done = CliRunner().invoke(app, words)
            assert done.exit_code == 0, done.output
    return directory


@pytest.fixture
def signed(desk: Any, issued: Path) -> Any:
    """A desk with the certificates, and a key `k.pem`."""
    shutil.copytree(issued, desk.directory, dirs_exist_ok=True)
    key = ed25519.Ed25519PrivateKey.generate()
    (desk.directory / "k.pem").write_bytes(pem(key))
    (desk.directory / "k.pem").chmod(0o600)
    (desk.directory / "pub.pem").write_bytes(public(key))
    desk.key = key
    return desk


def write(desk: Any, name: str, data: bytes, mode: int = 0o600) -> str:
    (desk.directory / name).write_bytes(data)
    (desk.directory / name).chmod(mode)
    return name


@pytest.mark.parametrize(("form", "algorithm"), [*zip(issue.FORMS, MADE, strict=True)])
def test_a_certificate_is_signed_and_verified(signed: Any, form: str, algorithm: str) -> None:
    key, cert = MADE[algorithm](), signed.directory / f"t{form}"
    write(signed, "k.pem", pem(key))
    write(signed, "pub.pem", public(key))
    before = cert.read_bytes()
    assert UNSIGNED.encode() in before or form == ".pdf"
    unsigned = signed.rigctl("verify", cert, signed.store)
    assert (unsigned.status, f"unsigned: there is no t{form}.sig" in unsigned.out) == (0, True)

    made = signed.rigctl("sign", cert, "--key", "k.pem", "--name", NAME, "--json")
    assert (made.status, made.err) == (0, "")
    assert cert.read_bytes() == before

    compared = signed.rigctl("verify", cert, signed.store, "--trust", "pub.pem", "--json").json["signature"]
    der = public(key, serialization.Encoding.DER)
    assert compared == {
        "name": NAME,
        "time": made.json["time"],
        "algorithm": algorithm,
        "key_sha256": hashlib.sha256(der).hexdigest(),
        "x509": False,
        "trusted": True,
    }
    assert abs(datetime.fromisoformat(compared["time"]) - datetime.now(UTC)) < timedelta(minutes=1)
    alone = signed.rigctl("verify", cert, signed.store)
    assert alone.status == 0
    for fact in (
        NAME,
        "signer's own word",
        compared["time"],
        compared["key_sha256"],
        "none that you trust (--trust)",
    ):
        assert fact in alone.out


def test_the_file_can_be_checked_without_this_program(signed: Any) -> None:
    cert = signed.directory / "t.html"
    assert signed.rigctl("sign", cert, "--key", "k.pem", "--name", NAME).status == 0
    text = (signed.directory / "t.html.sig").read_text(encoding="utf-8")
    said = json.loads(text)
    assert (said["sha256"], said["name"]) == (hashlib.sha256(cert.read_bytes()).hexdigest(), NAME)
    assert NAME in text
    # As docs/commands.md says: the file without its line of the signature.
    *others, last, end = text.splitlines()
    assert last.startswith(' "signature": ')
    message = "\n".join([*others[:-1], others[-1].removesuffix(","), end])
    signed.key.public_key().verify(base64.b64decode(said["signature"]), message.encode())


@pytest.fixture(scope="module")
def one(issued: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Signature]:
    """A signed certificate and its signature, with an X.509 certificate in it."""
    directory = tmp_path_factory.mktemp("one")
    shutil.copy(issued / "t.xml", directory)
    key = ed25519.Ed25519PrivateKey.generate()
    (directory / "x509.pem").write_bytes(certified(key, begins_days=-1000, ends_days=1000))
    sign(directory / "t.xml", key, datetime.now(UTC).isoformat(), given=directory / "x509.pem")
    return directory / "t.xml", signature.read(directory / "t.xml.sig")


read_once = cache(issue.read)
"""Its certificate does not change."""


def refused(cert: Path, data: bytes) -> bool:
    place = signature.beside(cert)
    kept = place.read_bytes()
    place.write_bytes(data)
    try:
        signer_of(cert, read_once(cert), None)
    except (NotVerified, DataError):
        return True
    finally:
        place.write_bytes(kept)
    return False


def test_what_was_not_changed_is_not_refused(one: tuple[Path, Signature]) -> None:
    assert not refused(one[0], one[1].data)


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_every_byte_of_a_signature_counts(one: tuple[Path, Signature], data: st.DataObject) -> None:
    cert, made = one
    place = data.draw(st.integers(0, len(made.data) - 1))
    old = made.data[place : place + 1]
    new = data.draw(st.one_of(st.just(b""), st.binary(min_size=1, max_size=2).filter(lambda each: each != old)))
    changed = made.data[:place] + new + made.data[place + 1 :]
    if changed != made.data:
        assert refused(cert, changed)


@settings(deadline=None, max_examples=50)
@given(st.sampled_from([each.name for each in fields(Signature)]), st.data())
def test_no_field_can_be_written_anew(one: tuple[Path, Signature], name: str, data: st.DataObject) -> None:
    cert, made = one
    old = getattr(made, name)
    texts = st.text(st.characters(codec="utf-8")) if isinstance(old, str) else st.binary()
    new = data.draw(texts.filter(lambda each: each != old))
    assert refused(cert, replace(made, **{name: new}).data)


@pytest.mark.parametrize("name", [each.name for each in fields(Signature)])
def test_no_field_can_be_that_of_another_signature(one: tuple[Path, Signature], issued: Path, name: str) -> None:
    """Of another file by another key: well formed, each of them."""
    cert, made = one
    key = ec.generate_private_key(ec.SECP256R1())
    other = issued / "other.html"
    shutil.copy(issued / "t.html", other)
    try:
        sign(other, key, TIME, name="Eve")
        taken = getattr(signature.read(signature.beside(other)), name)
    finally:
        signature.beside(other).unlink()
    assert refused(cert, replace(made, **{name: taken}).data)


def _as_eve(made: Signature, key: Any, **changed: Any) -> Signature:
    """Signed anew by another key, so that the signature itself is right."""
    der = keys.der(key.public_key())
    mine = replace(made, public_key=der, algorithm="Ed25519", **changed)
    return replace(mine, signature=keys.signature(key, mine.message))


def test_anothers_x509_certificate_or_name_cannot_be_used(one: tuple[Path, Signature]) -> None:
    cert, made = one
    eve = ed25519.Ed25519PrivateKey.generate()
    der = x509.load_pem_x509_certificate(certified(eve, "Eve")).public_bytes(serialization.Encoding.DER)
    assert refused(cert, _as_eve(made, eve).data)
    assert refused(cert, _as_eve(made, eve, x509=der, name=NAME).data)
    assert refused(cert, _as_eve(made, eve, x509=der, name="Eve", time="2020-01-01T00:00:00+00:00").data)
    assert refused(cert, _as_eve(made, eve, x509=b"none", name="Eve").data)
    # Nothing but trust tells these from the laboratory's own.
    assert not refused(cert, _as_eve(made, eve, x509=der, name="Eve").data)
    assert not refused(cert, _as_eve(made, eve, x509=b"").data)


@pytest.mark.parametrize("form", issue.FORMS)
def test_a_file_that_was_changed_after_signing_is_refused_though_its_own_hash_fits(signed: Any, form: str) -> None:
    cert = signed.directory / f"t{form}"
    assert signed.rigctl("sign", cert, "--key", "k.pem", "--name", NAME).status == 0
    data = cert.read_bytes()
    old, new = (b"842", b"843") if form == ".pdf" else (b"UNSIGNED", b"SIGNED")
    changed = data.replace(old, new, 1)
    cert.write_bytes(changed)
    signed.rigctl("verify", cert, signed.store).refused(1, "changed after it was issued")
    head, mark, tail = changed.rpartition(sealed.MARK)
    cert.write_bytes(sealed.sealed(head + mark + b"0" * 64 + tail[64:]))
    signed.rigctl("verify", cert, signed.store).refused(1, f"t{form}", "the signature is of another file")
    signature.beside(cert).unlink()
    assert signed.rigctl("verify", cert, signed.store).status == 0


def test_a_signature_does_not_make_a_certificate_true_of_a_store(signed: Any) -> None:
    cert = signed.directory / "t.html"
    assert signed.rigctl("sign", cert, "--key", "k.pem", "--name", NAME).status == 0
    assert signed.rigctl("mark", signed.store, "readings", "dropped", "--invalid").status == 0
    signed.rigctl("verify", cert, signed.store, "--trust", "pub.pem").refused(1, "was marked invalid since")


def test_the_key_is_compared_with_the_one_that_is_trusted(signed: Any) -> None:
    cert = signed.directory / "t.html"
    signed.rigctl("verify", cert, signed.store, "--trust", "pub.pem").refused(1, "unsigned", "t.html.sig", "pub.pem")
    write(signed, "x509.pem", certified(signed.key))
    made = signed.rigctl("sign", cert, "--key", "k.pem", "--certificate", "x509.pem")
    assert made.out.startswith(f"signed by {NAME} (X.509, issuer not checked) on 20")
    for trusted in ("pub.pem", "x509.pem"):
        ended = signed.rigctl("verify", cert, signed.store, "--trust", trusted)
        assert (ended.status, ended.out.endswith(f"which is that of {trusted}\n")) == (0, True)
    other = ed25519.Ed25519PrivateKey.generate()
    write(signed, "other.pem", public(other))
    write(signed, "namesake.pem", certified(other))
    for foreign in ("other.pem", "namesake.pem"):
        both = [hashlib.sha256(public(each, serialization.Encoding.DER)).hexdigest() for each in (signed.key, other)]
        signed.rigctl("verify", cert, signed.store, "--trust", foreign).refused(1, "another key", foreign, *both)
    signed.rigctl("verify", cert, signed.store, "--trust", "k.pem").refused(2, "k.pem", "neither a public key")
    signed.rigctl("verify", cert, signed.store, "--trust", "none.pem").refused(2, "none.pem", "cannot be read")


def test_a_passphrase_comes_from_file_environment_or_terminal(signed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cert = signed.directory / "t.html"
    write(signed, "k.pem", pem(signed.key, b"correct horse"))
    words = ["sign", cert, "--key", "k.pem", "--name", NAME]
    monkeypatch.delenv(command.VARIABLE, raising=False)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    signed.rigctl(*words).refused(2, "k.pem: encrypted", command.VARIABLE, "--passphrase-file")
    write(signed, "wrong.txt", b"battery staple\n")
    signed.rigctl(*words, "--passphrase-file", "wrong.txt").refused(2, "k.pem", "passphrase does not open")
    write(signed, "empty.txt", b"\n")
    signed.rigctl(*words, "--passphrase-file", "empty.txt").refused(2, "k.pem", "passphrase does not open")
    assert not signature.beside(cert).exists()

    asked: list[str] = []

    def typed(prompt: str) -> str:
        asked.append(prompt)
        return "correct horse"

    def at_terminal() -> None:
        monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
        monkeypatch.setattr(command.getpass, "getpass", typed)

    ways: list[tuple[Callable[[], object], list[str]]] = [
        (lambda: write(signed, "p.txt", b"correct horse\r\nmore\n"), ["--passphrase-file", "p.txt"]),
        (at_terminal, []),
        (lambda: monkeypatch.setenv(command.VARIABLE, "correct horse"), []),
    ]
    for prepare, options in ways:
        prepare()
        ended = signed.rigctl(*words, *options)
        assert (ended.status, ended.err) == (0, "")
        signature.beside(cert).unlink()
    assert asked == ["passphrase of k.pem: "]

    def left(prompt: str) -> str:
        raise EOFError

    monkeypatch.delenv(command.VARIABLE)
    monkeypatch.setattr(command.getpass, "getpass", left)
    signed.rigctl(*words).refused(130, "no passphrase was typed")


def test_without_the_extra_one_line_says_what_brings_it(signed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cert = signed.directory / "t.html"
    words = ["sign", cert, "--key", "k.pem", "--name", NAME]
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "cryptography", None)
        signed.rigctl(*words).refused(2, "pip install 'rigctl[sign]'")
        assert signed.rigctl("verify", cert, signed.store).status == 0
    assert signed.rigctl(*words).status == 0
    monkeypatch.setitem(sys.modules, "cryptography", None)
    signed.rigctl("verify", cert, signed.store).refused(2, "pip install 'rigctl[sign]'")


def test_what_is_signed_is_not_overwritten(signed: Any) -> None:
    cert = signed.directory / "t.html"
    words = ["sign", cert, "--key", "k.pem", "--name", NAME]
    assert signed.rigctl(*words).status == 0
    kept = cert.read_bytes(), signature.beside(cert).read_bytes()
    signed.rigctl(*words).refused(2, "t.html.sig: there already")
    signed.rigctl("certificate", signed.store, "--out", cert).refused(2, "t.html.sig signs what is there")
    assert (cert.read_bytes(), signature.beside(cert).read_bytes()) == kept


def test_only_certificates_of_this_program_as_issued_are_signed(signed: Any) -> None:
    words = ["--key", "k.pem", "--name", NAME]
    page = signed.directory / "page.html"
    page.write_text("<html></html>")
    signed.rigctl("sign", page, *words).refused(2, "page.html: no certificate of this program")
    page.write_bytes((signed.directory / "t.html").read_bytes().replace(b"UNSIGNED", b"SIGNED", 1))
    signed.rigctl("sign", page, *words).refused(1, "page.html: changed after it was issued")
    signed.rigctl("sign", "none.html", *words).refused(2, "none.html: cannot be read")
    assert not signature.beside(page).exists()


NO_KEYS = {
    "no text": (lambda: b"\x00\xff", "no private key in PEM"),
    "a public key": (lambda: public(ed25519.Ed25519PrivateKey.generate()), "no private key in PEM"),
    "half a key": (lambda: pem(ed25519.Ed25519PrivateKey.generate())[:80], "no private key in PEM"),
    "P-384": (lambda: pem(ec.generate_private_key(ec.SECP384R1())), "no key of a kind that signs here"),
    "X25519": (lambda: pem(x25519.X25519PrivateKey.generate()), "no key of a kind that signs here"),
    "short RSA": (lambda: pem(rsa.generate_private_key(65537, 1024)), "no key of a kind that signs here"),
}


@pytest.mark.parametrize("what", NO_KEYS)
def test_a_key_that_does_not_do_gives_one_line(signed: Any, what: str) -> None:
    made, said = NO_KEYS[what]
    write(signed, "bad.pem", made())
    cert = signed.directory / "t.html"
    signed.rigctl("sign", cert, "--key", "bad.pem", "--name", NAME).refused(2, "bad.pem", said)
    assert not signature.beside(cert).exists()


def test_who_signs_is_said_truly_or_refused(signed: Any) -> None:
    words = ["sign", signed.directory / "t.html", "--key", "k.pem"]
    signed.rigctl(*words).refused(2, "give --name, or --certificate")
    signed.rigctl(*words, "--name", "a\nb").refused(2, "in one line")
    write(signed, "other.pem", certified(ed25519.Ed25519PrivateKey.generate()))
    signed.rigctl(*words, "--certificate", "other.pem").refused(2, "other.pem: is that of another key")
    write(signed, "over.pem", certified(signed.key, begins_days=-9, ends_days=-2))
    signed.rigctl(*words, "--certificate", "over.pem").refused(2, "over.pem: is valid from")
    signed.rigctl(*words, "--certificate", "pub.pem").refused(2, "pub.pem: no X.509 certificate")
    write(signed, "x509.pem", certified(signed.key))
    assert signed.rigctl(*words, "--certificate", "x509.pem", "--name", NAME).status == 2
    assert not (signed.directory / "t.html.sig").exists()


def test_a_key_that_others_can_read_is_warned_of(signed: Any) -> None:
    write(signed, "k.pem", pem(signed.key), mode=0o640)
    ended = signed.rigctl("sign", signed.directory / "t.html", "--key", "k.pem", "--name", NAME)
    assert (ended.status, ended.err) == (0, "warning: k.pem can be read by others; chmod 600 it\n")


@pytest.mark.parametrize("text", ["", "{}", "[]", "[" * 5000, '{"format": 1}', "\x00", "x" * 70_000])
def test_a_file_that_is_no_signature_gives_one_line(signed: Any, text: str) -> None:
    (signed.directory / "t.html.sig").write_text(text)
    signed.rigctl("verify", signed.directory / "t.html", signed.store).refused(2, "t.html.sig")
