"""Blind trials: what is drawn, recorded and scored follows from the seed, and a bundle does not tell the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import blind_world
from benchmarks.blind_noise import SHAPES, coloured
from benchmarks.blind_sampler import Design, sample_world
from benchmarks.blind_sizes import yardstick
from benchmarks.blind_trials import Asked, clopper_pearson, score, study
from benchmarks.blind_world import Foreign, Truth, draw, record, sample
from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.core.workers import HERE
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.study import Term
from simulators.worlds.bench_settings import isa_twin

SMALL = Design(
    axes=("X",),
    configurations=("flag",),
    angles_deg=(-20.0, -1.0, 1.0),
    frequencies_hz=(0.5, 0.6),
    approaches=(1, -1),
    dwell_s=4.0,
)


@pytest.fixture(autouse=True)
def sized(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes as if every unit were one sigma: working them out takes a while."""
    names = (*blind_world.UNITS, *blind_world.UNKNOWN, blind_world.LINE)
    monkeypatch.setattr(blind_world, "unit_sizes", lambda _: dict.fromkeys(names, (1.0, 1.0)))


def trial(seed: int, kind: Any, **options: Any) -> blind_world.Trial:
    return draw(seed, kind, SMALL, **options)


def test_a_seed_draws_the_same_trial_and_the_same_bits() -> None:
    one, again, other = trial(3, "two"), trial(3, "two"), trial(4, "two")
    assert one == again
    assert one.truth != other.truth
    assert one.nature != other.nature
    first, second = sample(one), sample(again)
    for run in first.records:
        for name, column in first.columns[run.run_id].items():
            assert column.tobytes() == second.columns[run.run_id][name].tobytes()


@pytest.mark.parametrize(("kind", "hidden"), [("none", 0), ("one", 1), ("two", 2), ("three", 3), ("unknown", 0)])
def test_as_many_effects_are_hidden_as_the_kind_says(kind: Any, hidden: int) -> None:
    for seed in range(5):
        truth = trial(seed, kind, sigma=(6.0, 9.0)).truth
        assert len(truth.effects) == hidden
        assert (truth.unknown is None) is (kind != "unknown")
        assert all(6.0 <= size <= 9.0 for size in truth.sigma.values())
        assert not set(truth.effects) & set(blind_world.ABSORBED)


def test_the_truth_lies_beside_the_bundle_and_not_in_it(tmp_path: Path) -> None:
    made = trial(5, "three")
    beside = record(made, tmp_path / "bundle")
    assert json.loads(beside.read_text())["effects"] == made.truth.effects
    text = "".join(path.read_text() for path in (tmp_path / "bundle").rglob("*") if path.suffix in (".toml", ".csv"))
    secrets = [*made.truth.effects, *(repr(v) for sizes in made.truth.effects.values() for v in sizes.values())]
    secrets += [repr(made.nature.sensors["X"].flag.gain_v_per_m_s2), "truth", "sigma", "hidden"]
    for secret in secrets:
        assert secret not in text
    assert len(read_bundle(tmp_path / "bundle").runs(valid_only=True)) == 12


def test_a_size_in_sigma_is_what_the_effect_does_beyond_the_fits_freedom() -> None:
    design = replace(SMALL, angles_deg=(-20.0, -10.0, -1.0, 1.0, 10.0, 20.0))
    measure = yardstick(isa_twin(1), design)
    recoil, kept_of_recoil = measure.sigmas({"bench-recoil": {"c": 1e-6}})
    assert kept_of_recoil < 1e-4
    one, kept = measure.sigmas({"quadratic": {"K2": 1e-3}})
    two, _ = measure.sigmas({"quadratic": {"K2": 2e-3}})
    assert kept > 0.5
    assert two == pytest.approx(2.0 * one, rel=1e-3)
    assert one > recoil


@pytest.mark.parametrize("name", blind_world.UNKNOWN)
def test_each_unknown_changes_the_samples_in_proportion_to_its_scale(name: str) -> None:
    def change(scale: float) -> float:
        truth = Truth(1, "unknown", unknown=name, unknown_scale=scale)
        changed = sample_world(isa_twin(1), SMALL, blind_world._perturbation(truth), noisy=False)
        plain = sample_world(isa_twin(1), SMALL, noisy=False)
        squares = [
            float(np.sum((a.columns["accel_v"] - b.columns["accel_v"]) ** 2))
            for a, b in zip(changed, plain, strict=True)
        ]
        return float(np.sqrt(sum(squares)))

    assert change(10.0) > 0.0
    assert change(20.0) == pytest.approx(2.0 * change(10.0), rel=1e-2)


def test_a_foreign_recording_lacks_has_and_holds_what_was_asked_for(tmp_path: Path) -> None:
    odd = Foreign(
        colour="flicker", gaps=1.0, lengths=(0.5, 0.9), missing=("start_s", "laser_3_mm"), extra=("humidity_pct",)
    )
    record(draw(6, "none", replace(SMALL, dwell_s=12.0)), tmp_path / "bundle", odd)
    found = read_bundle(tmp_path / "bundle")
    assert all("humidity_pct" in run.conditions and "start_s" not in run.conditions for run in found.records)
    assert all("laser_3_mm" not in columns for columns in found.columns.values())
    assert len({len(columns["t_s"]) for columns in found.columns.values()}) > 3
    assert all("gap" in reason for _, reason in found.report.invalid)
    assert len(found.report.invalid) == 12


@pytest.mark.parametrize(
    ("colour", "exponent"), [("white", 0.0), ("flicker", -1.0), ("f^-1.64", -1.64), ("student-t", 0.0)]
)
def test_noise_has_its_colour_and_its_level(colour: str, exponent: float) -> None:
    noise = coloured(colour, 2**16, 0.1, 1.0, 10.0 if exponent else 0.1, np.random.default_rng(1))
    frequency = np.fft.rfftfreq(len(noise), 0.1)[1:]
    density = 2.0 * 0.1 / len(noise) * np.abs(np.fft.rfft(noise * np.hanning(len(noise))))[1:] ** 2 / 0.375
    low, high = ((frequency > f) & (frequency < 2.0 * f) for f in (0.005, 0.5))
    slope = np.log(density[high].mean() / density[low].mean()) / np.log(100.0)
    assert slope == pytest.approx(exponent, abs=0.15)
    if not exponent:
        assert density.mean() == pytest.approx(1.0, rel=0.1)
    assert set(SHAPES) >= {"ar1", "two-time-scale"}


def rank(effect: str, *equivalent: str) -> Rank:
    return Rank(Term(effect), 1e-9, 1e-8, {}, 0.5, equivalent, 80.0, 1.0, {})


def diagnosis(verdict: Any, said: tuple[str, ...], *ranking: Rank) -> Diagnosis:
    terms = tuple(Term(effect) for effect in said)
    return Diagnosis(verdict, 0.01, (), terms, ranking, (), None, {}, (), 30.0)


def test_answers_are_scored_against_the_truth() -> None:
    truth = Truth(1, "one", effects={"quadratic": {"K2": 1e-3}}, sigma={"quadratic": 9.0})
    right = score(diagnosis("effect", ("quadratic",), rank("quadratic")), truth)
    assert (right["right_first"], right["exact"], right["truth_in_set"], right["detected"]) == (True,) * 4
    rival = score(diagnosis("ambiguous", ("yaw",), rank("yaw", "quadratic")), truth)
    assert (rival["right_first"], rival["exact"], rival["truth_in_set"]) == (True, False, True)
    wrong = score(diagnosis("effect", ("yaw",), rank("yaw")), truth)
    assert (wrong["right_first"], wrong["exact"], wrong["truth_in_set"]) == (False, False, False)
    nothing = score(diagnosis("adequate", ()), Truth(1, "none"))
    assert (nothing["false_alarm"], nothing["right_first"], nothing["exact"]) == (False, None, None)
    other = score(diagnosis("unknown", ()), Truth(1, "unknown", unknown="friction", sigma={"friction": 9.0}))
    assert (other["unknown_said"], other["wrong_name"]) == (True, False)


def test_the_interval_of_a_rate_is_clopper_and_pearsons() -> None:
    assert clopper_pearson(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert clopper_pearson(9, 10) == pytest.approx((0.5550, 0.9975), abs=1e-4)


def _counted(_: Asked, seed: int) -> dict[str, Any]:
    return {"seed": seed, "exact": True}


def test_a_study_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.blind_trials.unit_sizes", lambda _: {})
    asked = Asked("one", (8.0, 20.0), (), None, 0.01, SMALL)
    keep = tmp_path / "kept.jsonl"
    assert len(study(asked, 1, 2, keep, HERE, _counted)) == 2
    assert {row["seed"] for row in study(asked, 1, 4, keep, HERE, _counted)} == {1, 2, 3, 4}
    assert len(keep.read_text().splitlines()) == 4
    study(replace(asked, alpha=0.05), 1, 2, keep, HERE, _counted)
    assert len(keep.read_text().splitlines()) == 6
