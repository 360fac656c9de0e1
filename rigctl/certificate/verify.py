"""Is a certificate still true of a store? What it rests on is hashed again, and compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from rigctl.certificate.basis import Basis, basis_of, differences, told
from rigctl.certificate.issue import read
from rigctl.core.errors import DataError, ProcedureError
from rigctl.workbench.model import versions


class NotVerified(ProcedureError):
    """A certificate that is not that of a store: what differs, in one line."""


@dataclass(frozen=True)
class Verified:
    """A certificate that is true of a store; `later` versions of its model came after the certificate."""

    number: str
    sha256: str
    signed: bool
    later: int


def verify(path: Path, store_path: Path) -> Verified:
    """Compare a certificate with a store; `NotVerified` says what differs, `DataError` when either cannot be read."""
    content, unchanged = read(path)
    if not unchanged:
        raise NotVerified(f"{path}: changed after it was issued: its own hash does not fit; ask for the original")
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
    return Verified(str(content["number"]), now.sha256, content["signed"] is not None, len(known) - number)


def _basis(path: Path, content: Mapping[str, Any]) -> Basis:
    try:
        return Basis.from_json(content["basis"])
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: what it rests on cannot be read ({error}); ask for the original") from error
