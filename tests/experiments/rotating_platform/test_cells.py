"""Runs as cells: whole and spoilt records, in chunks of any length, against the fits of their samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from benchmarks.platform_sampler import SampledRun, sampled
from rigctl.analysis.kept import Packed
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.model.motion import motion_of
from rigctl.experiments.rotating_platform.observe import cutter as module
from rigctl.experiments.rotating_platform.observe.cells import BEFORE, FAULTS, Cells
from rigctl.experiments.rotating_platform.observe.cutter import CellStream, cells_of
from rigctl.experiments.rotating_platform.observe.estimates import estimates, outside_guard
from rigctl.experiments.rotating_platform.observe.estimators import weights
from rigctl.experiments.rotating_platform.observe.patterns import named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import Chains, chains
from rigctl.experiments.rotating_platform.observe.reducer import Reducer
from simulators.worlds.platform_settings import PlatformSettings

Columns = dict[str, FloatArray]


@pytest.fixture(scope="module")
def recorded() -> tuple[Columns, Chains]:
    nature = PlatformSettings(kind="rotating-platform", seed=3)
    found = sampled(nature, [SampledRun("c", 60.0, 12, v_z_v=1.0)])
    return found.samples("r01"), chains(found.header)


def cut(samples: Columns, believed: Chains, step: int = 1 << 30) -> Cells:
    size = samples["t_s"].size
    parts = [{name: values[a : a + step] for name, values in samples.items()} for a in range(0, size, step)]
    return cells_of(parts, believed, 60.0, 10.0)


def faults(found: Cells) -> dict[str, int]:
    return dict(zip(FAULTS, found.faults.max(axis=1).sum(axis=0).tolist(), strict=True))


def test_the_outputs_are_those_of_the_samples(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    found = cut(samples, believed)
    reducer = Reducer(found, "z")
    fit = weights(named_pattern("c", 60.0).sampled(10.0), "joint-ls")
    m_z = (samples["q_a_v"] / believed.gain_v_per_m_s2["z"]).reshape(12, 600)
    wanted = fit @ m_z.T
    assert np.allclose(reducer.readings()[:48].reshape(4, 12), wanted, rtol=0.0, atol=1e-15)


def test_what_a_cell_holds_of_a_modulated_column_is_exact(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    found = cut(samples, believed)
    theta = np.deg2rad(samples["theta_deg"]).reshape(12, 600)
    fit = weights(named_pattern("c", 60.0).sampled(10.0), "joint-ls")
    reduced = Reducer(found, "z").of(found.geometry[:, :1], found.ramps[:, :1])[:48, 0]
    assert np.allclose(reduced.reshape(4, 12), fit @ np.cos(theta).T, atol=1e-13)
    assert reduced[:12] == pytest.approx(np.ones(12), abs=1e-9)


@pytest.mark.parametrize("step", [333, 1000, 7200])
def test_it_does_not_matter_how_the_record_was_cut(
    recorded: tuple[Columns, Chains], step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples, believed = recorded
    whole = cut(samples, believed)
    monkeypatch.setattr(module, "_BLOCK", 1500)
    parts = cut(samples, believed, step)
    for each in fields(Cells):
        assert np.allclose(getattr(parts, each.name), getattr(whole, each.name), rtol=1e-12, atol=1e-12), each.name


def test_turns_that_end_elsewhere_within_a_sample_are_of_different_kinds(recorded: tuple[Columns, Chains]) -> None:
    """Pattern c of a minute: its turns end at 8.417, 23.417, 41.583 and 56.583 s."""
    found = cut(*recorded)
    assert sorted(found.turn_kinds.tolist()) == [[-1, 234], [-1, 566], [1, 84], [1, 416]]
    assert [each for each in found.followed if each[0]] == sorted(map(tuple, found.turn_kinds.tolist()))
    for (way, end), course in zip(found.turn_kinds.tolist(), found.turns, strict=True):
        law = motion_of(course, found.turn_before, 10.0)
        ends_s = {84: 8.416876, 234: 23.416876, 416: 41.583124, 566: 56.583124}[end]
        assert law.last_s == pytest.approx(ends_s - end / 10.0, abs=1e-5)
        assert np.sign(course[-1]) == way
    own = found.direction != 0.0
    named = np.array(found.followed)[found.kind]
    assert np.array_equal(named[own, 0], found.direction[own])
    assert (found.kind[~own] == found.followed.index((0, 0))).all()


def test_turns_are_counted(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    found = cut(samples, believed)
    first = found.period * 600 + found.first
    ends = np.flatnonzero((samples["moving"][:-1] > 0.0) & (samples["moving"][1:] == 0.0)) + 1
    assert np.array_equal(found.turn_number, np.searchsorted(ends, first, side="right"))
    assert found.turn_number.max() == 48
    begins_turning = cut({name: values[100:] for name, values in samples.items()}, believed)
    assert begins_turning.turn_number[0] == 0


def test_cells_come_back_from_their_bytes(recorded: tuple[Columns, Chains]) -> None:
    found = cut(*recorded)
    again = Cells.unpacked(Packed.from_bytes(found.packed().to_bytes(compressed=True)))
    for each in fields(Cells):
        assert np.array_equal(getattr(again, each.name), getattr(found, each.name)), each.name


def test_the_first_dwell_follows_no_turn_and_the_last_half_second_is_its_own(
    recorded: tuple[Columns, Chains],
) -> None:
    found = cut(*recorded)
    assert np.isinf(found.since_s[found.bin < 0]).all()
    assert found.bin[0] < 0
    last = found.bin == BEFORE
    assert set(found.count[last].tolist()) == {5.0}
    assert set(found.sign[last].tolist()) == {-1, 1}


def test_lost_rows_are_a_gap_in_their_period_alone(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    keep = np.ones(7200, dtype=bool)
    keep[1300:1312] = False
    found = cut({name: values[keep] for name, values in samples.items()}, believed)
    assert faults(found) == {"gap": 12, "saturated": 0, "angle": 0, "shifted": 0}
    assert np.flatnonzero(found.faults.any(axis=(1, 2))).tolist() == [2]
    reducer, whole = Reducer(found, "z"), Reducer(cut(samples, believed), "z")
    others = np.arange(48) % 12 != 2
    assert np.allclose(reducer.readings()[:48][others], whole.readings()[:48][others], rtol=1e-12, atol=1e-16)
    assert reducer.inflation()[2] > 1.001
    # What was commanded goes on while samples are lost.
    assert np.allclose(found.state[:, 0], 1.0 / 825.0)


def turn_edges(samples: Columns) -> tuple[int, int]:
    """Where the third turn of a run begins and ends."""
    edges = np.flatnonzero(np.diff(samples["moving"])) + 1
    return int(edges[4]), int(edges[5])


@pytest.mark.parametrize("ends", [(0, 20), (-20, 20), (-20, 0), (0, 0)], ids=["start", "beyond", "end", "whole"])
def test_an_angle_that_is_lost_about_a_turn_leaves_the_recorded_flag(
    recorded: tuple[Columns, Chains], ends: tuple[int, int]
) -> None:
    samples, believed = recorded
    begin, end = turn_edges(samples)
    lost = {
        (0, 20): slice(begin, begin + 20),
        (-20, 20): slice(begin - 20, end + 20),
        (-20, 0): slice(end - 20, end),
        (0, 0): slice(begin, end),
    }[ends]
    found = cut({**samples, "theta_deg": _put(samples["theta_deg"], lost, np.nan)}, believed)
    whole = cut(samples, believed)
    assert not found.faults.any()
    assert found.off_stop == 0
    for name in ("sums", "since", "to_go", "sign", "direction", "geometry"):
        assert np.allclose(getattr(found, name), getattr(whole, name), rtol=0.0, atol=1e-9), name
    # A turn that was not seen whole is not among the mean ones.
    courses, wanted = (each.turns[np.lexsort(each.turn_kinds.T)] for each in (found, whole))
    assert np.allclose(courses, wanted, rtol=0.0, atol=1e-4)


def test_a_dwell_whose_angle_is_lost_throughout_is_a_gap(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    edges = np.flatnonzero(np.diff(samples["moving"])) + 1
    begin, end = int(edges[5]), int(edges[6])
    found = cut({**samples, "theta_deg": _put(samples["theta_deg"], slice(begin - 10, end), np.nan)}, believed)
    assert faults(found)["gap"] == end - begin
    assert np.flatnonzero(found.faults.any(axis=(1, 2))).tolist() == [begin // 600]


def test_readings_between_rest_and_a_turn_whose_flag_is_lost_are_not_used(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    begin, _ = turn_edges(samples)
    found = cut({**samples, "moving": _put(samples["moving"], slice(begin - 10, begin + 20), np.nan)}, believed)
    moved = _put(samples["q_a_v"], slice(begin - 10, begin + 20), 5.0)
    other = cut(
        {**samples, "q_a_v": moved, "moving": _put(samples["moving"], slice(begin - 10, begin + 20), np.nan)},
        believed,
    )
    assert np.array_equal(found.sums, other.sums)
    assert faults(found)["gap"] == 30


@pytest.mark.parametrize(("before", "after"), [(15, -20), (5, 5), (-20, 15)], ids=["start", "whole", "end"])
def test_rows_lost_about_turns_are_gaps_and_no_other_clock(
    recorded: tuple[Columns, Chains], before: int, after: int
) -> None:
    samples, believed = recorded
    edges = np.flatnonzero(np.diff(samples["moving"])) + 1
    keep = np.ones(7200, dtype=bool)
    # Always of the same dwell, and in the later periods alone: so do turns look late.
    for begin, end in zip(edges[::2][25::4].tolist(), edges[1::2][25::4].tolist(), strict=True):
        keep[begin - before : end + after] = False
    found = cut({name: values[keep] for name, values in samples.items()}, believed)
    assert found.drift_s == 0.0
    with_gap = np.unique(np.flatnonzero(~keep & (samples["moving"] == 0.0)) // 600)
    gap = found.faults[:, :, FAULTS.index("gap")]
    assert np.flatnonzero(gap.any(axis=1)).tolist() == with_gap.tolist()


@pytest.mark.parametrize(
    ("spoil", "wanted"),
    [
        (lambda s: {**s, "q_a_v": _put(s["q_a_v"], slice(2050, 2054), 10.0)}, {"saturated": 4}),
        (lambda s: {**s, "q_b_v": _put(s["q_b_v"], slice(2050, 2054), np.nan)}, {"gap": 4}),
        (lambda s: {**s, "theta_deg": _put(s["theta_deg"], slice(684, 784), 180.3)}, {"angle": 100}),
    ],
    ids=["saturated", "no value", "stopped elsewhere"],
)
def test_faults_are_counted(
    recorded: tuple[Columns, Chains], spoil: Callable[[Columns], Columns], wanted: dict[str, int]
) -> None:
    samples, believed = recorded
    nothing = dict.fromkeys(FAULTS, 0)
    assert faults(cut(spoil(samples), believed)) == nothing | wanted


def test_saturation_while_moving_is_no_fault(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    moving = samples["moving"] == 1.0
    found = cut({**samples, "q_a_v": np.where(moving, 10.0, samples["q_a_v"])}, believed)
    assert not found.faults.any()


def test_a_clock_that_runs_otherwise_is_seen(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    own_s = samples["t_s"] * (1.0 - 1e-3)
    place = np.clip(np.rint(own_s * 10.0 - 0.5).astype(int), 0, 7199)
    late = {n: samples[n][place] for n in ("moving", "theta_deg", "q_a_v", "q_b_v")}
    found = cut({**samples, **late}, believed)
    assert found.drift_s == pytest.approx(0.66, abs=0.1)
    assert faults(found)["shifted"] > 0


def test_a_mask_that_is_too_short_is_said() -> None:
    nature = PlatformSettings(kind="rotating-platform", seed=3)
    runs = [SampledRun("c", 60.0, 4), SampledRun("c", 60.0, 4, mask_short_s=0.5)]
    found = sampled(nature, runs)
    exact, short = (cut(found.samples(run), chains(found.header)) for run in ("r01", "r02"))
    assert exact.off_stop == 0
    assert not np.any(exact.state[:, 3:])
    assert short.off_stop == 4 * 4 * 5
    assert np.abs(short.state[:, 4]).max() > 1e-2


def test_the_noise_of_an_encoder_is_no_motion() -> None:
    nature = PlatformSettings(kind="rotating-platform", seed=3)
    found = sampled(nature, [SampledRun("c", 60.0, 4), SampledRun("c", 60.0, 4, mask_short_s=0.5)])
    for run, off_stop in (("r01", 0), ("r02", 4 * 4 * 5)):
        given = {name: np.asarray(values, dtype=np.float64) for name, values in found.samples(run).items()}
        given["theta_deg"] += np.rad2deg(np.random.default_rng(5).normal(0.0, 5e-6, given["theta_deg"].size))
        seen = cut(given, chains(found.header))
        # The first sample after a turn has hardly moved: a millionth of a turn may be less than the noise.
        assert off_stop - 4 * 4 <= seen.off_stop <= off_stop
        assert np.any(seen.state[:, 3:]) == (off_stop > 0)


def test_a_record_without_a_whole_period_is_refused(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    with pytest.raises(DataError, match="599 samples hold no whole period of 60 s"):
        cut({name: values[:599] for name, values in samples.items()}, believed)


def _put(values: Any, where: slice, what: float) -> Any:
    changed = values.copy()
    changed[where] = what
    return changed


@pytest.mark.parametrize("step", [1, 333, 5000])
def test_periods_that_come_one_by_one_are_those_of_the_whole_run(recorded: tuple[Columns, Chains], step: int) -> None:
    samples, believed = recorded
    pattern = named_pattern("c", 60.0).sampled(10.0)
    stream, parts = CellStream(believed, 60.0, 10.0), []
    for at in range(0, 7200, step):
        stream.take({name: values[at : at + step] for name, values in samples.items()})
        parts.append(stream.cells())
    stream.end()
    parts.append(stream.cells())
    live = [estimates(each, outside_guard(each, 0.0, 0.0), pattern) for each in parts if each is not None]
    whole = cut(samples, believed)
    wanted = estimates(whole, outside_guard(whole, 0.0, 0.0), pattern)
    assert np.array_equal(np.concatenate([each.accel_mean for each in live]), wanted.accel_mean)
    assert np.array_equal(np.concatenate([each.bias_slope for each in live]), wanted.bias_slope)


def test_an_encoder_may_begin_anew_after_a_whole_turn(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    forward = np.cumsum(np.abs(np.diff(samples["theta_deg"], prepend=samples["theta_deg"][0])))
    going_on = cut({**samples, "theta_deg": forward}, believed)
    wrapped = {**samples, "theta_deg": (forward + 1e-4 * np.cos(np.arange(forward.size))) % 360.0}
    for step in (1 << 30, 777):
        found = cut(wrapped, believed, step)
        assert np.array_equal(found.direction, going_on.direction)
        assert np.array_equal(found.turn_kinds, going_on.turn_kinds)
        assert np.allclose(found.turns, going_on.turns, rtol=0.0, atol=1e-5)


def test_a_column_of_the_laboratory_is_kept_with_the_cells(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    size = samples["t_s"].size
    found = cut({**samples, "supply_v": np.linspace(14.0, 15.0, size)}, believed, 1000)
    assert found.own == ("supply_v",)
    assert np.allclose(found.state[:, -1], 14.0 + found.time_s / samples["t_s"].max(), atol=1e-3)
    again = Cells.unpacked(found.packed())
    assert again.own == found.own


def test_a_run_that_begins_in_a_turn_knows_its_direction(recorded: tuple[Columns, Chains]) -> None:
    samples, believed = recorded
    rest = samples["moving"] == 0.0
    # In the middle of the first turn.
    begin = int(np.argmin(rest)) + int(np.argmax(rest[int(np.argmin(rest)) :])) // 2
    whole, late = (cut({name: values[at:] for name, values in samples.items()}, believed) for at in (0, begin))
    assert late.direction[0] == whole.direction[np.argmax(whole.direction != 0.0)] != 0.0


# What a parabola through three cells of up to 8 s cannot have; with no change within cells both are 5 % off.
@pytest.mark.parametrize(("fading_s", "share"), [(5.0, 0.01), (20.0, 0.002)])
def test_what_fades_within_cells_is_reduced_as_its_samples_are(fading_s: float, share: float) -> None:
    pattern = named_pattern("a", 60.0).sampled(5.0)
    rests = np.tile(pattern.sign != 0.0, 8)
    at = np.arange(rests.size)
    since_s = (at - np.maximum.accumulate(np.where(rests, 0, at))) / 5.0
    fading = np.where(rests, np.tile(pattern.sign, 8) * np.exp(-since_s / fading_s), 0.0)
    columns = {
        "t_s": at / 5.0,
        "theta_deg": np.where(np.tile(pattern.sign, 8) < 0, 180.0, 0.0),
        "q_a_v": fading,
        "q_b_v": fading,
        "moving": (~rests).astype(float),
    }
    unit = {"z": 1.0, "y": 1.0}
    found = cells_of([columns], Chains(unit, unit, {}, dict.fromkeys(unit, 10.0), 9.81), 60.0, 5.0)
    reducer = Reducer(found, "z")
    by_samples, by_cells = reducer.readings(), reducer.of(found.sums[:, :1, 3] / found.count[:, None])[:, 0]
    assert np.linalg.norm(by_cells - by_samples) < share * np.linalg.norm(by_samples)
