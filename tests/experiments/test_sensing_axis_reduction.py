"""Any recording becomes observables: once, kept, and never with a traceback."""

import numpy as np
import pytest

from rigctl.analysis.lines import find_lines
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, LaserInfo, Recording, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.experiments.sensing_axis.observe.reduction import reduce_run
from rigctl.experiments.sensing_axis.observe.store_reduction import line_scan, recipe, reduction

HEADER = Header(
    "sensing-axis",
    channels={"accel_v": ChannelInfo("V")},
    lasers={"laser_1_mm": LaserInfo("x", 5.0), "laser_2_mm": LaserInfo("y", 5.0)},
)


def reduced(source):
    return list(reduction(source).runs)


def samples_of(rng, *, frequency_hz=0.5, duration_s=40.0, rate_hz=50.0, noise_v=1e-3, phase=None):
    t_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    turn = 2 * np.pi * frequency_hz * t_s + (rng.uniform(0, 2 * np.pi) if phase is None else phase)
    x_mm = 5.0 * np.sin(turn)
    return {
        "t_s": t_s,
        "stage_x_mm": x_mm,
        "accel_v": 0.2 * np.sin(turn) + 0.1 + noise_v * rng.normal(size=t_s.size),
        "laser_1_mm": x_mm + 1e-4 * rng.normal(size=t_s.size),
        "laser_2_mm": 0.01 * x_mm + 1e-4 * rng.normal(size=t_s.size),
    }


def record(run_id, frequency_hz=0.5, **conditions):
    given = {"axis": "X", "configuration": "flag", "mounting": 1, "theta_deg": 0.1, "frequency_hz": frequency_hz}
    return RunRecord(run_id, run_id, "import", {**given, **conditions})


def recording(runs):
    """A recording in memory of (record, samples)."""
    columns = {r.run_id: samples for r, samples in runs}
    return Recording(HEADER, tuple(r for r, _ in runs), columns, ImportReport(len(runs)))


def stored(path, source):
    store = Store.create(path, source.header)
    for r in source.runs():
        with store.begin_run(r.key, r.step, r.conditions, r.run_id) as writer:
            writer.append(source.samples(r.run_id))
            writer.finish()
    return store


def night(seed=1, runs=6):
    rng = np.random.default_rng(seed)
    nus = [0.3, 0.5, 0.6]
    return recording([(record(f"r{i}", nus[i % 3]), samples_of(rng, frequency_hz=nus[i % 3])) for i in range(runs)])


def same(a, b):
    assert a.run_id == b.run_id
    assert a.frequency_hz == b.frequency_hz
    np.testing.assert_array_equal(a.motion_m, b.motion_m)
    assert a.lasers_m.keys() == b.lasers_m.keys()
    for one, other in [(a.accel_v, b.accel_v), *((a.lasers_m[n], b.lasers_m[n]) for n in a.lasers_m)]:
        np.testing.assert_array_equal(one.value, other.value)
        np.testing.assert_array_equal(one.sigma, other.sigma)
        np.testing.assert_array_equal(one.dof, other.dof)


class Spy:
    """Counts the runs whose samples are read."""

    def __init__(self, store, monkeypatch):
        self.read = []
        given = store.samples
        monkeypatch.setattr(store, "samples", lambda run_id: (self.read.append(run_id), given(run_id))[1])


class TestKept:
    def test_a_second_look_reads_no_samples_and_is_the_same_bit_for_bit(self, tmp_path, monkeypatch):
        source = night()
        with stored(tmp_path / "a.rig.sqlite", source) as store:
            first = reduced(store)
            spy = Spy(store, monkeypatch)
            again = reduced(store)
        assert spy.read == []
        for a, b, c in zip(first, again, reduced(source), strict=True):
            same(a, b)
            same(a, c)

    def test_only_what_is_new_is_reduced(self, tmp_path, monkeypatch):
        source = night()
        with stored(
            tmp_path / "a.rig.sqlite", recording([(r, source.samples(r.run_id)) for r in source.runs()[:5]])
        ) as store:
            reduced(store)
            last = source.runs()[5]
            with store.begin_run(last.key, last.step, last.conditions, last.run_id) as writer:
                writer.append(source.samples(last.run_id))
                writer.finish()
            spy = Spy(store, monkeypatch)
            runs = reduced(store)
        assert spy.read == ["r5"]
        for a, b in zip(runs, reduced(source), strict=True):
            same(a, b)

    def test_a_run_marked_invalid_leaves_the_noise_too_without_its_samples_being_read(self, tmp_path, monkeypatch):
        rng = np.random.default_rng(3)
        good = night()
        loud = (record("loud"), samples_of(rng, noise_v=1.0))
        runs = [(r, good.samples(r.run_id)) for r in good.runs()]
        with stored(tmp_path / "a.rig.sqlite", recording([*runs, loud])) as store:
            before = reduced(store)
            store.mark("loud", False, "somebody slammed the door")
            spy = Spy(store, monkeypatch)
            after = reduced(store)
        assert spy.read == []
        assert before[1].accel_v.sigma[1] > 10 * after[1].accel_v.sigma[1]
        for a, b in zip(after, reduced(good), strict=True):
            same(a, b)

    def test_a_store_open_for_reading_is_reduced_and_left_alone(self, tmp_path):
        path = tmp_path / "a.rig.sqlite"
        stored(path, night()).close()
        with Store.open(path, readonly=True) as store:
            assert len(reduced(store)) == 6
            assert store.reduced_names(str(recipe(()))) == set()

    def test_lines_are_kept_apart(self, tmp_path, monkeypatch):
        with stored(tmp_path / "a.rig.sqlite", night()) as store:
            reduced(store)
            with_line = reduction(store, (3.17,)).runs
            spy = Spy(store, monkeypatch)
            assert reduction(store, (3.17,)).runs[0].accel_v.lines.shape == (1,)
            assert reduced(store)[0].accel_v.lines.shape == (0,)
        assert spy.read == []
        assert len(with_line) == 6


class TestForeign:
    def test_sampling_rates_and_lengths_may_differ(self):
        rng = np.random.default_rng(21)
        runs = [
            (record(f"r{i}"), samples_of(rng, rate_hz=rate, duration_s=duration))
            for i, (rate, duration) in enumerate([(50.0, 40.0), (37.3, 33.3), (200.0, 12.7), (25.0, 61.0)])
        ]
        for run in reduced(recording(runs)):
            assert run.accel_v.value[1] == pytest.approx(0.2, abs=5 * run.accel_v.sigma[1])
            assert run.lasers_m["laser_1_mm"].value[1] == pytest.approx(5e-3, abs=1e-6)
            assert (run.accel_v.dof[1:] > 10).all()

    def test_gaps_and_uneven_times_are_fitted_as_given(self):
        rng = np.random.default_rng(22)
        samples = samples_of(rng)
        kept = np.ones(samples["t_s"].size, bool)
        kept[300:420] = False
        gap = {name: column[kept] for name, column in samples.items()}
        t_s = np.arange(2000) * 0.02 + rng.uniform(-0.008, 0.008, 2000)
        turn = 2 * np.pi * 0.5 * t_s
        uneven = {
            "t_s": t_s,
            "stage_x_mm": 5.0 * np.sin(turn),
            "accel_v": 0.2 * np.sin(turn) + 1e-3 * rng.normal(size=2000),
        }
        first, second = reduced(recording([(record("gap"), gap), (record("uneven"), uneven)]))
        for run in (first, second):
            assert run.accel_v.value[1] == pytest.approx(0.2, abs=5 * run.accel_v.sigma[1])
            assert run.accel_v.sigma[1] == pytest.approx(1e-3 * np.sqrt(2 / 2000), rel=0.5)
        assert second.lasers_m == {}

    def test_a_frequency_written_wrongly_is_taken_from_the_encoder(self):
        rng = np.random.default_rng(23)
        (run,) = reduced(recording([(record("r", 0.55), samples_of(rng, frequency_hz=0.5))]))
        assert run.frequency_hz == pytest.approx(0.5, abs=1e-5)

    def test_what_cannot_be_reduced_is_left_out_with_a_sentence(self):
        rng = np.random.default_rng(24)
        still = samples_of(rng)
        still["stage_x_mm"] = 1e-4 * rng.normal(size=still["t_s"].size)
        short = {name: column[:20] for name, column in samples_of(rng).items()}
        blind = samples_of(rng)
        blind["accel_v"][:1500] = np.nan
        lost = samples_of(rng)
        del lost["accel_v"]
        elsewhere = samples_of(rng, frequency_hz=2.0)
        bad = {"still": still, "short": short, "blind": blind, "lost": lost, "elsewhere": elsewhere}
        runs = [(record(name), samples) for name, samples in bad.items()]
        static = (record("static", 0.0), samples_of(rng))
        found = reduction(recording([*runs, static, (record("good"), samples_of(rng))]))
        assert [run.run_id for run in found.runs] == ["good"]
        assert found.left_out.keys() == {*bad, "static"}
        for run_id, why in found.left_out.items():
            assert why.startswith(f"run {run_id}: ")
            assert "\n" not in why

    def test_a_blind_head_is_left_out_and_a_blinking_one_is_not(self):
        rng = np.random.default_rng(25)
        samples = samples_of(rng)
        samples["laser_1_mm"][:] = np.nan
        samples["laser_2_mm"][rng.random(2000) < 0.2] = np.nan
        (run,) = reduced(recording([(record("r"), samples)]))
        assert run.lasers_m.keys() == {"laser_2_mm"}
        assert run.lasers_m["laser_2_mm"].value[1] == pytest.approx(5e-5, abs=1e-7)

    @pytest.mark.parametrize("column", [np.zeros, np.ones, lambda n: np.round(np.sin(np.arange(n) * np.pi / 50), 1)])
    def test_a_channel_without_noise_of_its_own_has_a_sigma(self, column):
        samples = samples_of(np.random.default_rng(26))
        samples["accel_v"] = column(2000)
        (run,) = reduced(recording([(record("r"), samples)]))
        assert np.isfinite(run.accel_v.sigma).all()
        assert (run.accel_v.sigma > 0.0).all()

    def test_steps_of_a_coarse_converter_count_as_noise(self):
        samples = samples_of(np.random.default_rng(27), noise_v=0.0, phase=0.3)
        samples["accel_v"] = np.round(samples["accel_v"], 2)
        (run,) = reduced(recording([(record("r"), samples)]))
        assert run.accel_v.value[1] == pytest.approx(0.2, abs=5 * run.accel_v.sigma[1])
        assert run.accel_v.sigma[1] > 1e-4

    def test_extra_columns_are_covariates(self):
        samples = samples_of(np.random.default_rng(28))
        given = record(
            "r", pressure_hpa=1013.2, operator="somebody", amplitude_mm=float("nan"), humidity=float("nan")
        )
        (run,) = reduced(recording([(given, samples)]))
        assert run.extra["pressure_hpa"] == 1013.2
        assert np.isnan(run.extra["humidity"])
        assert run.extra.keys() == {"pressure_hpa", "humidity"}


def test_pulls_of_all_harmonics_are_students():
    """60 runs in one pool beside a bump: value over sigma, with the degrees of freedom that are said."""
    pulls, dof = [], []
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        nus = [0.3, 0.5, 0.6]
        runs = [(record(f"r{i}", nus[i % 3]), samples_of(rng, frequency_hz=nus[i % 3])) for i in range(12)]
        for _, samples in runs:
            samples["accel_v"] = bumpy(rng, 2000, 0.02)
        for run in reduced(recording(runs)):
            value = run.accel_v.value[1:]
            pulls += [*(value.real / run.accel_v.sigma[1:]), *(value.imag / run.accel_v.sigma[1:])]
            dof += [*run.accel_v.dof[1:]]
    pulls = np.array(pulls)
    assert abs(pulls.mean()) < 4 / np.sqrt(pulls.size)
    # 8 pools of one sigma each: their own scatter adds to that of the pulls.
    expected = np.mean(np.array(dof) / (np.array(dof) - 2))
    assert pulls.var() == pytest.approx(expected, abs=4 * np.sqrt(2 / pulls.size + 2 / (8 * 3 * np.mean(dof))) + 0.08)


def bumpy(rng, samples, period_s):
    f = np.fft.rfftfreq(8 * samples, period_s)
    density = 1e-6 * (1.0 + 9.0 / (1.0 + ((f - 0.2) / 0.0233) ** 2) ** 2)
    z = (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)) * np.sqrt(density * 8 * samples / (4 * period_s))
    z[0] = 0.0
    return np.fft.irfft(z, 8 * samples)[:samples]


def test_a_line_is_found_kept_and_fitted(tmp_path):
    rng = np.random.default_rng(31)
    runs = []
    for i in range(24):
        nu = [0.3, 0.5, 0.6][i % 3]
        samples = samples_of(rng, frequency_hz=nu)
        samples["accel_v"] = samples["accel_v"] + 3e-4 * np.cos(
            2 * np.pi * 3.17 * samples["t_s"] + rng.uniform(0, 6.3)
        )
        runs.append((record(f"r{i}", nu), samples))
    with stored(tmp_path / "a.rig.sqlite", recording(runs)) as store:
        reduced(store)
        (line,) = find_lines(line_scan(store))
        assert line.frequency_hz == pytest.approx(3.17, abs=0.005)
        assert line.amplitude == pytest.approx(3e-4, abs=5 * line.sigma)
        fitted = reduction(store, (line.frequency_hz,)).runs
        assert find_lines(line_scan(store, (line.frequency_hz,))) == []
        assert np.mean([abs(run.accel_v.lines[0]) for run in fitted]) == pytest.approx(3e-4, rel=0.1)
        store.mark("r3", False, "for the test")
        again = line_scan(store)
    fresh = line_scan(recording([each for each in runs if each[0].run_id != "r3"]))
    assert again.runs == fresh.runs
    for key, sums in fresh.groups.items():
        np.testing.assert_allclose(again.groups[key], sums, rtol=1e-6, atol=1e-6)


def test_latencies_are_taken_out_of_the_phases_and_samples_stay_as_they_are():
    """Aperture, filter and latches: 2 mrad and more at 0.6 Hz, of which less than 0.2 mrad is left."""
    late_s = {"stage_x_mm": 2e-4, "accel_v": -5e-4, "laser_1_mm": 3e-3, "laser_2_mm": -1.5e-3}
    turn = 2 * np.pi * 0.6
    t_s = np.arange(2000) / 50.0
    scale = {"stage_x_mm": 5.0, "accel_v": 0.2, "laser_1_mm": 5.0, "laser_2_mm": -0.05}
    samples = {name: scale[name] * np.sin(turn * (t_s + late)) for name, late in late_s.items()}
    samples["laser_1_mm"] += 0.1 * np.sin(2 * turn * (t_s + late_s["laser_1_mm"]) + np.pi / 2)
    run = record("r", 0.6)
    channels = {name: ChannelInfo(latency_s=late) for name, late in late_s.items()}
    seen = reduce_run("r", run.conditions, {"t_s": t_s, **samples}, channels=channels).channels
    for name in ("accel_v", "laser_1_mm", "laser_2_mm"):
        off_rad = np.angle(seen[name].value[1] * np.sign(scale[name]))
        assert abs(off_rad) < 0.2e-3
    # cos 2wt goes as 1 - 2 x^2.
    assert abs(np.angle(-seen["laser_1_mm"].value[2])) < 0.2e-3
    unsaid = reduce_run("r", run.conditions, {"t_s": t_s, **samples}).channels
    assert abs(np.angle(unsaid["accel_v"].value[1])) > 2e-3
