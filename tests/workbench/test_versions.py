"""Versions of a model are documents that are never changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rigctl
from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError
from rigctl.workbench.model import versions
from rigctl.workbench.model.versions import ModelVersion, PluginFile
from rigctl.workbench.study import Term

CAMPAIGN = """\
experiment = "sensing-axis"
rig = "rig.toml"
[procedure]
name = "six-mountings"
axes = ["X"]
[model]
effects = ["roll-gravity", "resonance"]
"""
ROLL, HEAD = Term("roll-gravity"), Term("laser-cosine", {"head": "laser_2_mm"})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis"))
    for number in range(3):
        run = made.begin_run(f"run {number}", "", {"theta_deg": float(number)})
        run.append({"t_s": np.arange(4.0)})
        run.finish()
    return made


def test_an_imported_recording_begins_with_the_baseline(store: Store) -> None:
    assert versions.current(store) == ModelVersion(1, None, "", ())


def test_a_campaign_begins_with_its_own_effects(tmp_path: Path) -> None:
    header = Header("sensing-axis", started="2026-11-21T01:00:00Z", campaign_toml=CAMPAIGN)
    with Store.create(tmp_path / "y.rig.sqlite", header) as store:
        first = versions.current(store)
        assert first.effects == ("roll-gravity", "resonance")
        assert versions.remove(store, "resonance").effects == ("roll-gravity",)
        assert versions.versions(store)[0] == first


def test_versions_are_durable_and_numbered_as_they_came(store: Store) -> None:
    assert versions.extend(store, ROLL).version == 2
    second = versions.extend(store, HEAD)
    assert (second.version, second.parent, second.added, second.removed) == (3, 2, "laser-cosine", None)
    third = versions.remove(store, "roll-gravity")
    assert (third.parent, third.added, third.removed, third.terms) == (3, None, "roll-gravity", (HEAD,))
    store.close()
    with Store.open(store.path, readonly=True) as again:
        assert [each.version for each in versions.versions(again)] == [1, 2, 3, 4]
        assert versions.current(again) == third
        assert versions.current(again).time > "2020"


def test_one_effect_may_be_there_with_two_choices_but_not_twice_with_one(store: Store) -> None:
    versions.extend(store, HEAD)
    other = Term("laser-cosine", {"head": "laser_3_mm"})
    assert versions.extend(store, other).terms == (HEAD, other)
    with pytest.raises(ConfigError, match="laser-cosine' is in the model already"):
        versions.extend(store, HEAD)


def test_what_is_not_there_cannot_be_removed_and_nothing_else_is(store: Store) -> None:
    versions.extend(store, ROLL)
    with pytest.raises(ConfigError, match="'yaw' is not in the model, which is roll-gravity"):
        versions.remove_all(store, ["roll-gravity", "yaw"])
    assert versions.current(store).terms == (ROLL,)


def test_a_version_keeps_where_its_plugin_was_and_what_it_held(store: Store, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("one")
    one = PluginFile.of(path)
    version = versions.extend(store, Term("mine"), one)
    version.require([one])
    with pytest.raises(ConfigError, match=rf"{path}.*{one.sha256[:12]}.*pass --plugin {path}"):
        version.require([])
    path.write_text("two")
    with pytest.raises(ConfigError, match="give the file as it was"):
        version.require([PluginFile.of(path)])
    moved = tmp_path / "moved.py"
    moved.write_text("one")
    version.require([PluginFile.of(moved)])
    versions.extend(store, ROLL).require([one])
    versions.remove(store, "mine").require([])
    with pytest.raises(ConfigError, match=r"gone\.py: cannot be read"):
        PluginFile.of(tmp_path / "gone.py")


def test_a_fit_is_kept_for_its_version_and_its_runs(store: Store) -> None:
    first = versions.current(store)
    assert versions.kept_fit(store, [], first) is None
    versions.keep_fit(store, [], first, {"chi2_per_dof": 1.5})
    assert versions.kept_fit(store, [], first) == {"chi2_per_dof": 1.5}
    store.mark("2", valid=False, reason="a truck")
    assert versions.kept_fit(store, [], first) is None
    store.mark("2", valid=True, reason="looked again")
    assert versions.kept_fit(store, [], first) == {"chi2_per_dof": 1.5}
    run = store.begin_run("one more", "", {})
    run.append({"t_s": np.arange(4.0)})
    run.finish()
    assert versions.kept_fit(store, [], first) is None


def test_what_a_diagnosis_held_stays_held_until_the_runs_change(store: Store) -> None:
    version = versions.extend(store, ROLL, fitted=({"rho1": 1e-4, "b": 0.0}, ["b"]))
    assert version.start == {"rho1": 1e-4, "b": 0.0}
    assert versions.still_held(store, version) == {"b"}
    store.mark("2", valid=False, reason="a truck")
    assert versions.still_held(store, version) == frozenset()


def test_a_new_term_puts_every_fit_out_of_date_for_it_tells_of_the_noise(store: Store) -> None:
    first = versions.current(store)
    versions.keep_fit(store, [], first, {"chi2_per_dof": 1.5})
    assert versions.kept_fit(store, [], versions.extend(store, ROLL)) is None
    assert versions.kept_fit(store, [], first) is None


def test_every_package_that_a_fit_depends_on_is_there() -> None:
    assert all(any((Path(rigctl.__file__).parent / name).rglob("*.py")) for name in versions.CODE)


def test_a_fit_of_another_program_is_out_of_date(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    first = versions.current(store)
    versions.keep_fit(store, [], first, {"chi2_per_dof": 1.5})
    monkeypatch.setattr(versions, "_code", lambda: "changed")
    assert versions.kept_fit(store, [], first) is None


def test_a_diagnosis_is_kept_for_its_level(store: Store) -> None:
    first = versions.current(store)
    versions.keep_diagnosis(store, [], first, 0.01, {"verdict": "adequate"})
    assert versions.kept_diagnosis(store, [], first, 0.01) == {"verdict": "adequate"}
    assert versions.kept_diagnosis(store, [], first, 0.05) is None
    store.mark("1", valid=False, reason="a truck")
    assert versions.kept_diagnosis(store, [], first, 0.01) is None
    assert versions.last_diagnosis(store) == {"verdict": "adequate"}


def test_what_was_worked_out_without_a_file_of_effects_is_worked_out_anew_with_it(store: Store) -> None:
    """A report with one's own effect does not show the diagnosis that had not asked it."""
    first, mine = versions.current(store), PluginFile("mine.py", "12ab")
    versions.keep_diagnosis(store, [], first, 0.01, {"verdict": "unknown"})
    versions.keep_fit(store, [], first, {"chi2_per_dof": 1.5})
    versions.keep_account(store, [], [first.terms], {"terms": []})
    assert versions.kept_diagnosis(store, [mine], first, 0.01) is None
    assert versions.kept_fit(store, [mine], first) is None
    assert versions.kept_account(store, [mine], [first.terms]) is None
    versions.keep_diagnosis(store, [mine], first, 0.01, {"verdict": "effect"})
    assert versions.kept_diagnosis(store, [PluginFile("moved.py", "12ab")], first, 0.01) == {"verdict": "effect"}
    assert versions.kept_diagnosis(store, [], first, 0.01) == {"verdict": "unknown"}
