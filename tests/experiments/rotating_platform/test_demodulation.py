import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.demodulation import FAULTS, Demodulator, PeriodSums, sums_of
from rigctl.experiments.rotating_platform.observe.dwell_sums import dwell_sums, line_sums
from rigctl.experiments.rotating_platform.observe.estimates import estimates
from rigctl.experiments.rotating_platform.observe.estimators import ESTIMATORS, OUTPUTS, weights
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, custom_pattern, named_pattern

NAMES = sorted(ROTATIONS)


def recording(samples, channels=2, seed=1):
    rng = np.random.default_rng(seed)
    level = np.array([1.5, -0.7])[:channels, None]
    return list(level + 0.1 * rng.normal(size=(channels, samples)))


def by_weights(sampled, channels, estimator):
    """The outputs by their definition, shape (4, periods, channels)."""
    table = np.stack(channels)[:, : channels[0].size // sampled.samples * sampled.samples]
    return np.einsum("ok,cpk->opc", weights(sampled, estimator), table.reshape(len(table), -1, sampled.samples))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(("period_s", "rate_hz"), [(60.0, 10.0), (300.0, 40.0)])
def test_a_stream_gives_what_the_weights_do(name, estimator, period_s, rate_hz):
    sampled = named_pattern(name, period_s).sampled(rate_hz)
    channels = recording(3 * sampled.samples + 100)
    found = estimates(sampled, sums_of(sampled, channels), estimator)
    for output, expected in zip(OUTPUTS, by_weights(sampled, channels, estimator), strict=True):
        assert found.output(output) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert not found.refitted.any()
    assert not found.invalid.any()
    assert not found.faults.any()


@settings(deadline=None, max_examples=50)
@given(
    name=st.sampled_from(NAMES),
    cuts=st.lists(st.integers(0, 3000), max_size=8),
    lost=st.lists(st.integers(0, 2999), max_size=20),
    clipped=st.lists(st.integers(0, 2999), max_size=5),
    off=st.none() | st.integers(0, 2999),
    full_scale=st.none() | st.just(5.0),
)
def test_how_a_recording_is_cut_does_not_matter(name, cuts, lost, clipped, off, full_scale):
    sampled = named_pattern(name, 60.0).sampled(10.0)
    channels = recording(3000)
    channels[0][lost] = np.nan
    channels[1][clipped] = -5.0
    off_stop = None if off is None else np.arange(3000) == off
    whole = sums_of(sampled, channels, full_scale=full_scale, off_stop=off_stop)
    stream = Demodulator(sampled, 2, full_scale=full_scale)
    parts = []
    for start, stop in zip([0, *sorted(cuts)], [*sorted(cuts), 3000], strict=True):
        part = None if off_stop is None else off_stop[start:stop]
        parts.append(stream.feed([row[start:stop] for row in channels], off_stop=part))
    found = PeriodSums.joined(parts)
    assert found.values == pytest.approx(whole.values, rel=1e-12, abs=1e-9)
    assert (found.faults == whole.faults).all()
    assert stream.open_samples == 0


@pytest.mark.parametrize("length", [1, 5, 4095, 4096, 2**16 + 3, 2**17, 2**17 + 1, 2**18 + 4097])
def test_rows_short_and_long_have_their_sums(length):
    rows = np.random.default_rng(1).normal(size=(3, length)) + 0.5
    found = dwell_sums(rows.ravel(), 0, length, length, 10.0)
    index = np.arange(length)
    assert found.level == pytest.approx(rows.sum(axis=1), rel=1e-11, abs=1e-9)
    assert found.ramp == pytest.approx(rows @ index, rel=1e-9, abs=1e-6)
    assert not found.faulty.any()
    assert line_sums(rows[1], 10.0) == (pytest.approx(found.level[1]), pytest.approx(found.ramp[1]), False)


@pytest.mark.parametrize("length", [7, 5000, 2**17 + 5])
@pytest.mark.parametrize("unusable", [np.nan, np.inf, -np.inf, 3.0, -3.0, -1e300])
def test_a_row_with_an_unusable_sample_says_so(length, unusable):
    rows = np.zeros((3, length))
    rows[1, length // 2] = rows[2, -1] = unusable
    assert dwell_sums(rows.ravel(), 0, length, length, 3.0).faulty.tolist() == [False, True, True]
    assert [line_sums(row, 3.0)[2] for row in rows] == [False, True, True]


def test_saturation_is_not_hidden_by_a_gap_in_another_period():
    rows = np.zeros((4, 100))
    rows[0, 0], rows[3, 50] = np.nan, 10.0
    assert dwell_sums(rows.ravel(), 0, 100, 100, 10.0).faulty.tolist() == [True, False, False, True]


def test_a_dwell_is_a_part_of_its_period():
    samples = np.random.default_rng(2).normal(size=5 * 3000 + 17)
    found = dwell_sums(samples, 700, 2900, 3000)
    rows = samples[:15000].reshape(5, 3000)[:, 700:2900]
    assert found.level == pytest.approx(rows.sum(axis=1), abs=1e-10)
    assert found.ramp == pytest.approx(rows @ np.arange(2200), abs=1e-7)


def test_a_period_with_faults_is_refitted_to_what_is_left_and_counted():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    t, c = np.tile(sampled.time_s, 3), np.tile(sampled.sign.astype(float), 3)
    truth = (3e-4, 2e-6, -1.2e-3, 5e-6)
    clean = c * (truth[0] + truth[1] * t) + truth[2] + truth[3] * t
    channel = clean.copy()
    channel[600 + 250 : 600 + 300] = np.nan
    channel[600 + 310 : 600 + 315] = 10.0
    off_stop = np.zeros(1800, dtype=bool)
    off_stop[1200 + 500 : 1200 + 600] = True
    sums = sums_of(sampled, [channel], full_scale=10.0, off_stop=off_stop)
    found = estimates(sampled, sums)
    assert found.faults[:, 0].tolist() == [[0, 0, 0], [50, 5, 0], [0, 0, 100]]
    assert found.refitted[:, 0].tolist() == [False, True, True]
    for output, value in zip(OUTPUTS, truth, strict=True):
        assert found.output(output)[1:, 0] == pytest.approx([value, value], rel=1e-6, abs=1e-13)
    # The period without faults is projected: b mixes the slopes.
    assert found.accel_slope[0, 0] == pytest.approx(truth[1] + 0.9 * truth[3], rel=1e-4)
    assert FAULTS == ("gap", "saturated", "angle")


def test_a_sample_with_several_faults_is_counted_once():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    channel = np.zeros(600)
    channel[:3] = np.nan, 10.0, 1.0
    off_stop = np.arange(600) < 3
    assert sums_of(sampled, [channel], full_scale=10.0, off_stop=off_stop).faults[0, 0].tolist() == [1, 1, 1]


def test_a_fault_while_the_platform_moves_is_none():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    channel = np.zeros(600)
    channel[sampled.sign == 0] = np.nan
    channel[150] = 10.0
    found = sums_of(sampled, [channel], full_scale=10.0, off_stop=sampled.sign == 0)
    assert not found.faults.any()
    assert found.values[0, 0, :, 0].tolist() == [200.0, 200.0]


@pytest.mark.parametrize(("left", "valid"), [(199, False), (200, True)])
def test_a_period_with_less_than_half_its_samples_is_invalid(left, valid):
    sampled = named_pattern("c_tm", 60.0).sampled(10.0)
    channel = np.ones(600)
    kept = np.flatnonzero(sampled.sign)
    channel[kept[left:]] = np.nan
    found = estimates(sampled, sums_of(sampled, [channel, np.ones(600)]))
    assert found.invalid.tolist() == [[not valid, False]]
    assert found.refitted.tolist() == [[valid, False]]
    assert np.isnan(found.accel_mean[0, 0]) == (not valid)
    assert found.bias_mean[0, 1] == pytest.approx(1.0)


def test_a_period_that_lost_all_samples_of_one_sign_is_invalid():
    sampled = custom_pattern(60.0, [(1, 0.0, 10.0), (-1, 15.0, 55.0)], 5.0).sampled(10.0)
    channel = np.ones(600)
    channel[:100] = np.nan
    found = estimates(sampled, sums_of(sampled, [channel]))
    assert found.invalid.all()
    assert np.isnan(found.accel_mean).all()


@settings(deadline=None, max_examples=30)
@given(
    truth=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    lost=st.sets(st.integers(0, 299), max_size=90),
    name=st.sampled_from(NAMES),
)
def test_the_refit_is_exact_whatever_is_missing(truth, lost, name):
    sampled = named_pattern(name, 60.0).sampled(5.0)
    t, c = sampled.time_s, sampled.sign
    channel = c * (truth[0] + truth[1] * t) + truth[2] + truth[3] * t
    channel[list(lost)] = np.nan
    found = estimates(sampled, sums_of(sampled, [channel]), "joint-ls")
    if not found.invalid.any():
        values = [found.output(output)[0, 0] for output in OUTPUTS]
        assert values == pytest.approx(truth, abs=1e-9)


def test_lost_samples_may_be_skipped():
    sampled = named_pattern("c", 60.0).sampled(10.0)
    channels = recording(1800)
    holes = [row.copy() for row in channels]
    for row in holes:
        row[500:700] = np.nan
    stream = Demodulator(sampled, 2)
    parts = [stream.feed([row[:500] for row in channels]), stream.skip(200)]
    parts.append(stream.feed([row[700:] for row in channels]))
    found, expected = PeriodSums.joined(parts), sums_of(sampled, holes)
    assert found.values == pytest.approx(expected.values, rel=1e-12)
    assert (found.faults == expected.faults).all()
    assert found.faults[:2, 0, 0].sum() == np.count_nonzero(np.tile(sampled.sign, 2)[500:700])


def test_the_angle_as_recorded_may_count_instead_of_the_table():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    late = np.roll(sampled.sign, 2)
    channel = 1e-3 * late + 5e-4
    sums = sums_of(sampled, [np.tile(channel, 2)], sign=np.tile(late, 2))
    found = estimates(sampled, sums, "joint-ls")
    assert found.accel_mean[:, 0] == pytest.approx([1e-3, 1e-3], rel=1e-9)
    assert found.bias_mean[:, 0] == pytest.approx([5e-4, 5e-4], rel=1e-9)
    assert estimates(sampled, sums_of(sampled, [channel])).accel_mean[0, 0] != pytest.approx(1e-3, rel=1e-3)
    stream = Demodulator(sampled, 1)
    parts = [
        stream.feed([np.tile(channel, 2)[at : at + 170]], sign=np.tile(late, 2)[at : at + 170])
        for at in range(0, 1200, 170)
    ]
    assert PeriodSums.joined(parts).values == pytest.approx(sums.values, rel=1e-12, abs=1e-12)


def test_arrays_of_another_kind_are_taken_too():
    sampled = named_pattern("c", 60.0).sampled(10.0)
    columns = np.stack(recording(1500), axis=1).astype(np.float32)
    found = sums_of(sampled, list(columns.T))
    assert found.values == pytest.approx(sums_of(sampled, list(columns.T.astype(float))).values, rel=1e-12)


def test_what_is_kept_between_calls_does_not_grow():
    sampled = named_pattern("c", 60.0).sampled(200.0)
    chunk = recording(300_000)
    stream = Demodulator(sampled, 2, full_scale=10.0)
    stream.feed(chunk)
    tracemalloc.start()
    try:
        for _ in range(10):
            stream.feed(chunk)
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 100_000
    assert peak < 5_000_000


def test_a_record_without_a_whole_period_is_refused():
    sampled = named_pattern("c", 60.0).sampled(10.0)
    with pytest.raises(
        DataError, match="599 samples at 10 Hz are no whole period of pattern c of 60 s, which has 600"
    ):
        sums_of(sampled, [np.zeros(599)])


def test_channels_that_do_not_fit_together_are_refused():
    sampled = named_pattern("c", 60.0).sampled(10.0)
    stream = Demodulator(sampled, 2)
    with pytest.raises(DataError, match="1 arrays for 2 channels"):
        stream.feed([np.zeros(5)])
    with pytest.raises(DataError, match=r"shapes \[\(4,\), \(5,\)\]"):
        stream.feed([np.zeros(5), np.zeros(4)])
    with pytest.raises(DataError, match="pass rows of one length"):
        stream.feed([np.zeros(5), np.zeros(5)], off_stop=np.zeros(4, dtype=bool))
