"""The hash of a certificate: what it changes with, and what it does not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.certificate.basis import Basis, basis_of, differences
from rigctl.workbench.model import versions
from rigctl.workbench.model.versions import PluginFile
from rigctl.workbench.study import Term

SAG = Term("sag")


def _made(path: Path, level_v: float = 0.5, constants: Mapping[str, float] | None = None) -> Store:
    header = Header("sensing-axis", started="2026-01-01T00:00:00+00:00", constants=constants or {"g_m_s2": 9.807})
    store = Store.create(path, header)
    for number in range(3):
        run = store.begin_run(f"run {number}", "", {"theta_deg": float(number)})
        run.append({"t_s": np.arange(4.0), "accel_v": np.full(4, level_v)})
        run.finish()
    return store


def _basis(store: Store, plugin: str = "a" * 64) -> Basis:
    version = replace(versions.versions(store)[0], terms=(SAG,), plugins={"sag": PluginFile("sag.py", plugin)})
    return basis_of(store, version)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return _made(tmp_path / "x.rig.sqlite")


def _mark(store: Store, path: Path) -> Basis:
    store.mark(store.runs()[1].run_id, False, "knocked")
    return _basis(store)


CHANGES: dict[str, tuple[Callable[[Store, Path], Basis], str]] = {
    "mark": (_mark, "was marked invalid since (knocked)"),
    "plug-in": (lambda store, path: _basis(store, "b" * 64), "plug-in of sag is another now"),
    "constant": (lambda store, path: _basis(_made(path, constants={"g_m_s2": 9.808})), "constants changed"),
    "samples": (lambda store, path: _basis(_made(path, level_v=np.nextafter(0.5, 1.0))), "has other samples"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_the_hash_changes_with_what_a_result_rests_on_and_verify_names_it(
    what: str, store: Store, tmp_path: Path
) -> None:
    change, told = CHANGES[what]
    then = _basis(store)
    now = change(store, tmp_path / "other.rig.sqlite")
    assert now.sha256 != then.sha256
    found = differences(then, now)
    assert all(told in each for each in found), found
    assert found


def test_the_hash_does_not_change_with_what_is_worked_out_later_nor_with_the_file_name(
    store: Store, tmp_path: Path
) -> None:
    then = _basis(store)
    for kind in (versions.VERSION, versions.FIT, versions.DIAGNOSIS, versions.ACCOUNT):
        store.add_document(kind, _document(kind))
    assert _basis(store).sha256 == then.sha256
    assert _basis(_made(tmp_path / "copy.rig.sqlite")).sha256 == then.sha256


def test_what_a_study_rests_on_is_hashed(store: Store) -> None:
    then = _basis(store)
    store.add_document("draw", {"seed": 1})
    assert differences(then, _basis(store)) == ["document 1 has come since"]


def test_a_basis_is_read_back_as_it_was_written(store: Store) -> None:
    then = _basis(store)
    assert Basis.from_json(then.as_json()) == then


def _document(kind: str) -> dict[str, Any]:
    terms = {"terms": [SAG.as_json()], "parent": 1, "added": "sag", "removed": None, "plugins": {}}
    return terms if kind == versions.VERSION else {"anything": 1}
