"""The file of a signature, `FILE.sig` beside FILE: JSON that a person can read, and that none can change unseen.

Signed are all its fields but the signature itself, FILE's hash among them. The file has one form only: what is
written in another way than here is refused, so that each of its bytes counts.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path

from rigctl.core.bounds import KEY_BYTES, read_regular
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.whole_file import writing

FORMAT = "rigctl-signature 1"
_FIELDS = ("format", "sha256", "algorithm", "public_key", "x509", "name", "time", "signature")


@dataclass(frozen=True)
class Signature:
    """Who signed a file of the hash `sha256`, when, and with which key.

    `time` is the signer's clock, UTC, ISO 8601; `public_key` and `x509` are DER, `x509` empty for none.
    `signature` is of `message`, empty before it is signed.
    """

    sha256: str
    algorithm: str
    public_key: bytes
    x509: bytes
    name: str
    time: str
    signature: bytes = b""

    @property
    def message(self) -> bytes:
        """What is signed: the file without its last line of fields."""
        return _json({name: value for name, value in self._fields.items() if name != "signature"})

    @property
    def data(self) -> bytes:
        """The file."""
        return _json(self._fields) + b"\n"

    @property
    def _fields(self) -> dict[str, str]:
        values = (self.sha256, self.algorithm, self.public_key, self.x509, self.name, self.time, self.signature)
        texts = (each if isinstance(each, str) else base64.b64encode(each).decode() for each in values)
        return dict(zip(_FIELDS, (FORMAT, *texts), strict=True))


@dataclass(frozen=True)
class Signer:
    """Who signed a certificate: `key_sha256` is the key's fingerprint.

    `x509`: the name is that of an X.509 certificate, whose issuer nobody has checked. `trusted`: the key was compared
    with one that the reader trusts, and is that one.
    """

    name: str
    time: str
    algorithm: str
    key_sha256: str
    x509: bool
    trusted: bool


def beside(path: Path) -> Path:
    """Where the signature of a file is."""
    return path.with_name(f"{path.name}.sig")


def write(made: Signature, path: Path) -> None:
    """Write a signature to a new file; `ConfigError` where there is one, `DataError` where it cannot be written."""
    with writing(path):
        try:
            with path.open("xb") as file:
                file.write(made.data)
        except FileExistsError:
            raise ConfigError(f"{path}: there already; move it away to sign anew") from None


def read(path: Path) -> Signature:
    """The signature in a file, whether it is right or not; `DataError` for what was not written by `write`."""
    try:
        data = read_regular(path, KEY_BYTES)
        found = _of_fields(json.loads(data))
        unchanged = found.data == data
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise DataError(f"{path}: no signature of this program ({FORMAT}); ask for the original") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error
    if not unchanged:
        raise DataError(f"{path}: not as this program writes a signature: changed since; ask for the original")
    return found


def _of_fields(fields: dict[str, str]) -> Signature:
    written, *texts = (fields[name] for name in _FIELDS)
    sha256, algorithm, public_key, x509, name, time, signature = texts
    if written != FORMAT or not all(isinstance(each, str) for each in texts):
        raise ValueError
    keys = (base64.b64decode(public_key), base64.b64decode(x509))
    return Signature(sha256, algorithm, *keys, name, time, base64.b64decode(signature))


def _json(fields: dict[str, str]) -> bytes:
    return json.dumps(fields, indent=1, ensure_ascii=False).encode()
