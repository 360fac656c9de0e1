"""Weights that turn samples into amplitudes: exact on lines, the adjoint of the filter chain, deaf to gaps' edges."""

import numpy as np
import pytest
from scipy import signal

from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.grid import grid_of, thinned, thinning_gain
from rigctl.experiments.inflight.observe.published import DROPPED_S, Streamed, published_weights
from rigctl.experiments.inflight.observe.series import NEEDED
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.observe.weights import (
    DRIFT_CYCLES,
    amplitudes,
    drift_weights,
    level_weights,
    response,
    spread,
    weights,
)

STEP_S = 2.0
T_S = np.arange(29750) * STEP_S
LINES_HZ = [2 / 5950, 7.3 / 5950, 14.6 / 5950]


@pytest.mark.parametrize("lines_hz", [LINES_HZ, [2.31 / 5950, 7.77 / 5950, 0.011]])
def test_weights_are_the_adjoint_of_the_published_chain(lines_hz):
    """Of lines with whole periods in the record and of others, whose means are not nil."""
    rng = np.random.default_rng(1)
    series = 3e-8 + np.cumsum(rng.standard_normal(len(T_S)))
    corners = (("highpass", 0.5 * min(lines_hz)), ("lowpass", 2.0 * max(lines_hz)))
    sections = np.vstack([signal.butter(2, hz, kind, fs=1.0 / STEP_S, output="sos") for kind, hz in corners])
    dropped = round(DROPPED_S / STEP_S)
    lines = templates(T_S, lines_hz)
    design = signal.sosfilt(sections, lines - lines.mean(axis=1, keepdims=True), axis=1)[:, dropped:]
    filtered = signal.sosfilt(sections, series - series.mean())[dropped:]
    expected, *_ = np.linalg.lstsq(design.T, filtered, rcond=None)
    # Sections in double precision know their poles, 1e-3 from 1, to 1e-10 of that.
    assert weights(T_S, lines_hz) @ series == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("step_s", [0.25, 2.0, 8.0])
@pytest.mark.parametrize("orbits", [2, 3.7])
def test_amplitudes_summed_while_samples_come_are_those_of_the_rows(step_s, orbits):
    """In pieces of any length; the highest line at 8 s is too near to half the rate for a low-pass."""
    rng = np.random.default_rng(4)
    lines_hz = [[1 / 5950, 2 / 5950, 0.031], [3 / 5950, 2 / 5950]]
    count = round(orbits * 5950 / step_s)
    groups = [published_weights(1.3e4, step_s, count, each) for each in lines_hz]
    series = 4.0 + rng.standard_normal((3, count, 2))
    sums, at = Streamed(groups, 700, (3, 2)), 0
    while at < count:
        piece = series[:, at : at + rng.integers(1, 701)]
        sums.add(at, piece)
        at += piece.shape[1]
    for group, found in zip(groups, sums.parts(), strict=True):
        rows = group.rows()
        scale = np.linalg.norm(rows, axis=1)[:, None]
        assert found / scale == pytest.approx(rows @ series / scale, abs=1e-9)
        assert group.squares() == pytest.approx(np.sum(rows**2, axis=1), rel=1e-12)
        assert group.rows(slice(1, 3)) / scale[1:3] == pytest.approx(rows[1:3] / scale[1:3], abs=1e-9)
    assert sums.means() == pytest.approx(series.mean(axis=1), rel=1e-12)


def test_rows_are_orthogonal_to_a_constant_and_say_what_lines_are():
    rows, lines = weights(T_S, LINES_HZ), templates(T_S, LINES_HZ)
    assert np.abs(rows.sum(axis=1)).max() < 1e-13 * np.abs(rows).sum(axis=1).min()
    assert rows @ lines.T == pytest.approx(np.eye(len(lines)), abs=1e-11)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 29750])
def test_templates_are_cosines_and_sines(count):
    at_s = 6e5 + T_S[:count]
    angles = [2 * np.pi * f_hz * at_s for f_hz in LINES_HZ]
    expected = np.concatenate([[np.cos(angle), np.sin(angle)] for angle in angles])
    # Of phases of up to a few thousand radians.
    assert templates(at_s, LINES_HZ) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("missing", [0.0, 0.1, 0.4])
def test_lines_come_out_whatever_is_missing(missing):
    present = bursts(missing)
    amplitude = [1.0 - 2.0j, 0.5 + 0.1j, -3.0 + 0.0j]
    series = 7.0 + sum(
        z.real * np.cos(2 * np.pi * f * T_S) - z.imag * np.sin(2 * np.pi * f * T_S)
        for z, f in zip(amplitude, LINES_HZ, strict=True)
    )
    found = amplitudes(weights(T_S, LINES_HZ, present), np.where(present, series, 1e6)[:, None])[:, 0]
    assert found == pytest.approx(amplitude, abs=1e-8)


def test_read_out_noise_does_not_enter_through_the_edges_of_gaps():
    """Noise growing as f^2, differenced twice, next to what abrupt edges would make of it."""
    t_s, lines_hz = np.arange(4 * 5950) / 4.0, [8 / 5950, 20 / 5950]
    present = bursts(0.1)[: len(t_s)]
    rows = weights(t_s, lines_hz, present)
    design = np.vstack([templates(t_s, lines_hz), np.ones_like(t_s)])[:, present]
    abrupt = np.zeros((4, len(t_s)))
    abrupt[:, present] = np.linalg.solve(design @ design.T, design)[:4]
    rng = np.random.default_rng(2)
    noise = np.diff(rng.standard_normal((40, len(t_s) + 2)), 2, axis=1)
    assert np.std(rows @ noise.T) < 0.2 * np.std(abrupt @ noise.T)


def test_what_noise_does_to_a_line_is_told_with_what_enters_at_the_edge():
    """Noise growing as f^2 over white noise, in the published chain: more than the density at the line says."""
    step_s, white, draws = 0.25, 1e-3, 400
    rows = weights(np.arange(4 * 11900) * step_s, [16 / 11900])

    def density(f_hz):
        return 2.0 * step_s * (white**2 + (2.0 * np.sin(np.pi * f_hz * step_s)) ** 4)

    rng = np.random.default_rng(3)
    found = np.empty((draws, len(rows)))
    for number in range(draws):
        steps = rng.standard_normal(rows.shape[1] + 2)
        found[number] = rows @ (np.diff(steps, 2) + white * rng.standard_normal(rows.shape[1]))
    told = np.array([response(row, step_s, density) for row in rows])
    at_line = np.sqrt(density(16 / 11900) * np.sum(rows**2, axis=1) / (2.0 * step_s))
    assert np.std(found, axis=0) == pytest.approx(told, rel=5.0 / np.sqrt(2.0 * draws))
    assert max(told / at_line) > 1.5


def test_too_little_is_refused():
    with pytest.raises(DataError, match="too few to fit lines"):
        weights(T_S, LINES_HZ, np.arange(len(T_S)) < 0.2 * len(T_S))


def test_lines_too_close_are_refused():
    with pytest.raises(DataError, match="cannot tell the lines apart"):
        weights(T_S, [1e-3, 1e-3 + 1e-9])


def bursts(share):
    rng = np.random.default_rng(5)
    present = np.ones(len(T_S), dtype=bool)
    while np.mean(~present) < share:
        start = rng.integers(len(T_S))
        present[start : start + rng.integers(1, 50)] = False
    return present


@pytest.mark.parametrize("step_s", [0.25, 2.5])
def test_beside_a_gap_a_moved_masss_line_stays_what_it_is(step_s):
    """An average of what is left of a bell is one of another time: 1e-9 m/s2 of a line of 3e-8, a thousand sigma."""
    f_hz, duration_s = 9e-3, 6000.0
    t_s = np.arange(round(duration_s / step_s)) * step_s
    samples = {"t_s": t_s, **{name: np.cos(2 * np.pi * f_hz * t_s) for name in NEEDED}}
    for begin_s, long_s in ((900.0, 40.0), (2411.0, 5.0), (4000.0, 90.0)):
        samples["m1_x"] = np.where((t_s > begin_s) & (t_s < begin_s + long_s), np.nan, samples["m1_x"])
    made = thinned(grid_of("run", samples))
    expected = thinning_gain(np.array([f_hz]), step_s, made.step_s)[0] * np.cos(2 * np.pi * f_hz * made.t_s)
    assert made.columns["m1_x"][made.present] == pytest.approx(expected[made.present], abs=1e-9)
    assert made.present.mean() > 1.0 - (40.0 + 5.0 + 90.0 + 3 * 20.0) / duration_s


@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_slope_and_bend_of_a_stretch_with_gaps_are_told_beside_its_lines(missing):
    present = bursts(missing)
    rows = drift_weights(T_S, LINES_HZ, present)
    x = 2.0 * (T_S - T_S[0]) / (T_S[-1] - T_S[0]) - 1.0
    for f_hz in LINES_HZ:
        assert rows @ (present * (7.0 + np.cos(2 * np.pi * f_hz * T_S + 0.4))) == pytest.approx(np.zeros(2), abs=1e-9)
    assert rows @ (5.0 * np.sqrt(3.0) * x * present) == pytest.approx([5.0, 0.0], abs=1e-9)
    # In lines that are fitted beside it a slope leaves nothing.
    if missing:
        assert np.abs(weights(T_S, LINES_HZ, present) @ (5.0 * x * present)).max() < 1e-9


def test_what_flicker_noise_makes_of_a_slope_and_of_a_bend_is_what_its_density_at_one_frequency_says():
    present = bursts(0.02)
    rows = drift_weights(T_S, LINES_HZ, present)
    power = np.abs(np.fft.rfft(rows, 64 * len(T_S), axis=1)[:, 1:]) ** 2
    width_hz = 1.0 / (64 * len(T_S) * STEP_S)
    f_hz = width_hz * np.arange(1, power.shape[1] + 1)
    made = np.sqrt(power @ (width_hz / f_hz))
    slow_hz = DRIFT_CYCLES / (len(T_S) * STEP_S)
    told = np.sqrt(1.0 / slow_hz) * spread(np.repeat(np.sum(rows[0] ** 2), 2), STEP_S)[0]
    assert made == pytest.approx([told, told], rel=0.05)


@pytest.mark.parametrize("lines_hz", [LINES_HZ, [1e-4, 3.7e-4, 0.1234, 0.2499]])
def test_weights_of_a_level_are_those_of_least_squares_beside_the_lines(lines_hz):
    """In closed form; the last line is hardly slower than half the rate of the samples."""
    at_s = 6000.0 + T_S
    design = np.vstack([np.ones_like(at_s), templates(at_s, lines_hz)])
    expected = np.linalg.solve(design @ design.T, design)[0]
    assert level_weights(at_s, lines_hz) == pytest.approx(expected, rel=1e-9, abs=1e-12 / len(at_s))
