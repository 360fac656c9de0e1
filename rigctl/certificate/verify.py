"""Is a certificate still true of a store? What it rests on is hashed again, and compared. Who signed it?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from rigctl.certificate import signature
from rigctl.certificate.basis import Basis, basis_of, differences, told
from rigctl.certificate.issue import Issued, NotVerified, read
from rigctl.certificate.signature import Signer
from rigctl.core.errors import DataError
from rigctl.core.extra import SIGN, needed
from rigctl.workbench.model import versions


@dataclass(frozen=True)
class Verified:
    """A certificate that is true of a store; `later` versions of its model came after the certificate.

    `signature` is None where there is none beside it.
    """

    number: str
    sha256: str
    signature: Signer | None
    later: int


def verify(path: Path, store_path: Path, trust: Path | None = None) -> Verified:
    """Compare a certificate with a store, and who signed it with the key in the file `trust`.

    `NotVerified` says what differs; `DataError` when a file cannot be read, `ConfigError` for a key that is none.
    """
    issued = read(path)
    signer = _signer(path, issued, trust)
    content = issued.content
    with Store.open(store_path, readonly=True) as store:
        then = _basis(path, content)
        known = versions.versions(store)
        number = int(then.model["version"])
        if number > len(known):
            raise NotVerified(f"{path}: not of {store_path}: model version {number} is not there")
        now = basis_of(store, known[number - 1])
    if found := differences(then, now):
        raise NotVerified(f"{path}: not true of {store_path} as it is: {told(found)}")
    if content["basis_sha256"] != now.sha256:
        raise NotVerified(f"{path}: the hash over what it rests on is not that of its parts; ask for the original")
    return Verified(str(content["number"]), now.sha256, signer, len(known) - number)


def _signer(path: Path, issued: Issued, trust: Path | None) -> Signer | None:
    place = signature.beside(path)
    if place.exists():
        needed("cryptography", SIGN)
        from rigctl.certificate.signing import signer_of

        return signer_of(path, issued, trust)
    if trust is not None:
        raise NotVerified(f"{path}: unsigned: no {place.name} is beside it to compare with {trust}; ask for it")
    return None


def _basis(path: Path, content: Mapping[str, Any]) -> Basis:
    try:
        return Basis.from_json(content["basis"])
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: what it rests on cannot be read ({error}); ask for the original") from error
