"""Which addresses a simulator on this machine serves: what answers there is no instrument."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rigctl.campaign.session.addresses import Claim, claims_of
from rigctl.campaign.session.locks import held, is_held, lock_directory


@contextmanager
def announced(addresses: Iterable[str]) -> Iterator[None]:
    """Let every program of this machine know that these are served by a simulator, until it ends however it ends."""
    with ExitStack() as stack:
        for address in addresses:
            for claim in _alone(address):
                stack.enter_context(held(_mark(claim), f"{address} is served by another simulator", shared=True))
        yield


def is_served(address: str) -> bool:
    """True when a simulator on this machine serves this address."""
    return any(is_held(_mark(claim)) for claim in _alone(address))


def _alone(address: str) -> list[Claim]:
    return [claim for claim in claims_of(address) if not claim.shared]


def _mark(claim: Claim) -> Path:
    digest = hashlib.sha256(claim.name.encode()).hexdigest()[:16]
    return lock_directory() / f"rigctl-served-{digest}.lock"
