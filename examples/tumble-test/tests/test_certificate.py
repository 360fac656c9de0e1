"""Every number of the certificate of a tumble test, page and DCC, recomputed from its fit."""

from __future__ import annotations

from typing import Any

import pytest

from rigctl.composition import opened_workbench
from rigctl.files.certificate_file import CertificateDetails
from tests.certificate import recomputed


def test_the_numbers_of_its_certificate(begin: Any, rigctl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    store = begin("one-axis")()
    page, dcc = recomputed.issued(store, CertificateDetails(), monkeypatch)
    told = rigctl("result", store)
    with opened_workbench(store, ()) as bench:
        account = recomputed.of_fit(told, bench.attempt(bench.current))
    assert recomputed.check(page, dcc, account) > 40
