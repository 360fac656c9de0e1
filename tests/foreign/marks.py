"""Every recording with every check as a case, those marked that fail today."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import pytest

from tests.foreign.sessions import CHECKS


def cases(
    names: Iterable[str],
    stops: Mapping[str, str],
    wrong: Mapping[str, Mapping[str, str]],
    slow: Collection[str] = (),
) -> list[Any]:
    """All checks of one recording after another: a worker that is given neighbours takes a session once.

    ``stops`` are recordings that some command does not get through, ``wrong`` checks that fail, each with what
    happens; both are strict: who mends it takes the entry away. ``slow`` ones are left to ``make foreign``.
    """
    found = []
    for name in names:
        for check in CHECKS:
            reason = stops.get(name) or wrong.get(name, {}).get(check)
            marks = [pytest.mark.xfail(strict=True, reason=reason)] if reason else []
            if name in slow and "RIGCTL_FOREIGN" not in os.environ:
                marks = [pytest.mark.skip(reason="slow: make foreign")]
            marks.append(pytest.mark.timeout(600))  # up to a minute's work on a computer that may be busy
            found.append(pytest.param(name, check, marks=marks, id=f"{name}-{check}"))
    return found
