"""Any recording becomes observables: once, kept, and never with a traceback."""

import numpy as np

from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, LaserInfo, Recording, RunRecord
from rigctl.campaign.store import Store
from rigctl.experiments.sensing_axis.store_reduction import recipe, reduced, reduction

HEADER = Header(
    "sensing-axis",
    channels={"accel_v": ChannelInfo("V")},
    lasers={"laser_1_mm": LaserInfo("x", 5.0), "laser_2_mm": LaserInfo("y", 5.0)},
)


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
            assert store.reduced_names("runs " + recipe(())) == set()

    def test_lines_are_kept_apart(self, tmp_path, monkeypatch):
        with stored(tmp_path / "a.rig.sqlite", night()) as store:
            reduced(store)
            with_line = reduction(store, (3.17,)).runs
            spy = Spy(store, monkeypatch)
            assert reduction(store, (3.17,)).runs[0].accel_v.lines.shape == (1,)
            assert reduced(store)[0].accel_v.lines.shape == (0,)
        assert spy.read == []
        assert len(with_line) == 6
