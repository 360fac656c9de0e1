"""On a virtual clock a resumed campaign is the undisturbed one: every condition, sample and answer, bit for bit."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import runner
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
YES = runner.Options(unattended=True, seed=5)
STEPS = ((Store, "add_event"), (RunWriter, "stream"), (RunWriter, "finish"))
"""What a campaign does to its store; it is killed just before or just after one of these calls."""

SENSING = (
    'experiment = "sensing-axis"\nrig = "rig.toml"\n[model]\neffects = ["roll-gravity", "resonance"]\n[procedure]\n'
)
SEARCH = "amplitude_mm = 5.0\ncoarse_s = 4.0\n[targets]\ntheta0_sigma_arcsec = 20.0\nnoise_m_s2_rthz = 1e-5\n"
SCAN = (
    'name = "scan"\naxes = ["X"]\nconfigurations = ["flag"]\nfrequencies_hz = [0.6]\n'
    "amplitude_mm = 5.0\ndwell_s = 4.0\n"
)
PLATFORM = 'experiment = "rotating-platform"\nrig = "rig.toml"\n[procedure]\nname = "bias-rejection"\n'
TURNED = "modulation_period_s = 60.0\nperiods = 1\n"

KINDS = {
    "null search": (
        "isa-rig.toml",
        SENSING + 'name = "null-search"\naxes = ["X"]\nconfigurations = ["pendulum"]\nfrequencies_hz = [0.3, 0.6]\n'
        "noise_check_s = 10.0\n" + SEARCH,
        "",
    ),
    "one axis": (
        "one-axis.rig.toml",
        SENSING + 'name = "six-mountings"\naxes = ["Y"]\nconfigurations = ["pendulum", "flag"]\n'
        "frequencies_hz = [0.25, 0.5]\nnoise_check_s = 0.0\n" + SEARCH,
        "",
    ),
    "scan": ("hidden-effect-rig.toml", SENSING + SCAN + "angles_deg = [-30.0, -1.0]\napproaches = [1, -1]\n", ""),
    "scan in two temperatures": (
        "hidden-effect-rig.toml",
        SENSING
        + SCAN.replace("frequencies_hz = [0.6]\n", "")
        + "".join(
            f"[[procedure.runs]]\nangle_deg = {angle}\nfrequency_hz = 0.6\ntemperature_c = {room}\n"
            for angle, room in ((-2.0, 20.0), (2.0, 20.0), (-2.0, 23.0), (2.0, 23.0))
        ),
        "",
    ),
    "further campaign": (
        "isa-rig.toml",
        SENSING + SCAN + "angles_deg = [-10.0]\n",
        SENSING + SCAN + 'mounting = "same"\nangles_deg = [1.0, 5.0]\n',
    ),
    "quick check": (
        "all-instruments.rig.toml",
        SENSING.replace('[model]\neffects = ["roll-gravity", "resonance"]\n', "")
        + 'name = "quick-check"\naxes = ["X"]\nconfigurations = ["pendulum"]\nfrequencies_hz = [0.6]\n'
        "amplitude_mm = 5.0\n",
        "",
    ),
    "bias rejection": (
        "bias-rejection-rig.toml",
        PLATFORM + "[[procedure.runs]]\npattern = 'flip'\nduration_s = 20.0\n"
        "[[procedure.runs]]\npattern = 'scan'\nstep_deg = 90.0\ndwell_s = 20.0\n"
        f"[[procedure.runs]]\npattern = 'c'\n{TURNED}v_z_v = [0.0, 1.0]\n"
        f"[[procedure.runs]]\npattern = 'a'\n{TURNED}external = 'sine'\nv_z_v = 0.5\nexternal_period_s = 100.0\n",
        "",
    ),
    "frequency response": (
        "frequency-response-rig.toml",
        'experiment = "frequency-response"\nrig = "rig.toml"\n[procedure]\nfrequencies_hz = [2.0, 8.0]\n'
        "accelerations_m_s2 = [0.5]\ndwell_s = 2.0\n",
        "",
    ),
    "in flight": (
        "microscope-rig.toml",
        'experiment = "inflight-calibration"\nrig = "rig.toml"\n[procedure]\nsessions = ["dx", "dz"]\norbits = 6.0\n',
        "",
    ),
}
"""Rig, campaign, and one that goes on in its store."""

REMEMBERING = {
    "isa-rig.toml": "bias-drift.rate = 1e-7\nnull-drift.rate = 1e-9\nthermal-bias.bT = 1e-3\n"
    "cable-hysteresis.h = 1e-5\nmains-pickup = { amplitude = 1e-3, frequency = 50.0 }\n",
    "hidden-effect-rig.toml": "bias-drift.rate = 1e-7\nnull-drift.rate = 1e-9\nthermal-bias.bT = 1e-3\n",
    "bias-rejection-rig.toml": "recovery = { e = 1e-6, t_r = 40.0 }\nrecovery-signed = { e = 1e-6, t_r = 40.0 }\n"
    "platform-repeatability = { stop = 1e-5, backlash = 1e-5 }\ntide = { amplitude = 1e-6, period = 5000.0 }\n"
    "filter-ringing = { cutoff = 0.2, r_cos = 0.1 }\npendulum-reaction.d = 1e-3\nthermal-bias.b1 = 1e-5\n"
    "clock-skew = { delay = 0.01, drift = 1e-6 }\nline = { amplitude = 1e-6, frequency = 0.3 }\n",
}
"""Effects of nature that go by the clock, or by what moved before; written below `[world.effects]`."""

Call = Callable[..., Any]


@contextmanager
def stepped(at_step: Callable[[Call], Any]) -> Iterator[None]:
    """Every call of `STEPS` goes through `at_step`, which makes it."""
    originals = {(owner, name): getattr(owner, name) for owner, name in STEPS}

    def through(original: Call) -> Call:
        return lambda *arguments, **options: at_step(lambda: original(*arguments, **options))

    for (owner, name), original in originals.items():
        setattr(owner, name, through(original))
    try:
        yield
    finally:
        for (owner, name), original in originals.items():
            setattr(owner, name, original)


def killed(action: Callable[[], None], step: int, *, after: bool) -> None:
    """`action` in a process that is killed just before or after this step of it."""
    child = os.fork()
    if child:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
        return
    steps = iter(range(step))

    def counted(call: Call) -> Any:
        last = next(steps, None) is None
        if last and not after:
            os.kill(os.getpid(), signal.SIGKILL)
        found = call()
        if last:
            os.kill(os.getpid(), signal.SIGKILL)
        return found

    try:
        with stepped(counted):
            action()
    finally:
        os._exit(1)


class Bench:
    """A directory with the files of a kind of campaign."""

    def __init__(self, directory: Path, kind: str) -> None:
        directory.mkdir()
        rig, campaign, further = KINDS[kind]
        self.store, self.further = directory / "x", further
        world = (CAMPAIGNS / rig).read_text()
        if rig in REMEMBERING:
            world += f"\n[world.effects]\n{REMEMBERING[rig]}"
        for name, text in (("rig", world), ("campaign", campaign), ("further", further)):
            (directory / f"{name}.toml").write_text(text)
        self.directory = directory

    def first(self) -> None:
        campaign = read_campaign(self.directory / "campaign.toml")
        runner.start(campaign, read_rig(self.directory / "rig.toml"), self.store, YES)

    def last(self) -> None:
        """What is killed: the further campaign of a kind that has one."""
        if self.further:
            runner.extend(self.store, read_campaign(self.directory / "further.toml"), YES)
        else:
            self.first()

    def prepared(self) -> Bench:
        if self.further:
            self.first()
        return self

    def contents(self) -> tuple[list[Any], list[Any]]:
        """Runs with their samples, and answers, without what tells that there was an interruption."""
        with Store.open(self.store, readonly=True) as store:
            runs = [
                (
                    run.key,
                    json.dumps(run.conditions),
                    run.valid,
                    {name: column.tobytes() for name, column in store.samples(run.run_id).items()},
                )
                for run in store.runs()
            ]
            return runs, [(event.rig_time_s, event.data) for event in store.events("once")]


def test_a_noise_check_after_a_restart_is_made_on_the_package(tmp_path: Path) -> None:
    undisturbed = Bench(tmp_path / "undisturbed", "null search")
    undisturbed.first()
    bench = Bench(tmp_path / "killed", "null search")
    killed(bench.first, 2, after=True)
    with Store.open(bench.store, readonly=True) as store:
        assert [event.data["key"] for event in store.events("once")][-1] == "X pendulum 1 level 1"
    runner.resume(bench.store, YES)
    assert bench.contents() == undisturbed.contents()


@pytest.mark.parametrize("kind", KINDS)
def test_a_campaign_killed_at_any_place_ends_in_the_same_bits(tmp_path: Path, kind: str) -> None:
    undisturbed = Bench(tmp_path / "undisturbed", kind).prepared()
    steps = []

    def counted(call: Call) -> Any:
        steps.append(1)
        return call()

    with stepped(counted):
        undisturbed.last()
    whole = undisturbed.contents()
    random = np.random.default_rng(list(kind.encode()))
    for trial in range(2):  # one half of the campaign, then the other
        first, last = (len(steps) - 2) * np.array([trial, trial + 1]) // 2  # the last one tells that all is done
        step, after = int(random.integers(first, last)), bool(trial % 2)
        bench = Bench(tmp_path / f"killed-{trial}", kind).prepared()
        killed(bench.last, step, after=after)
        runner.resume(bench.store, YES)
        assert bench.contents() == whole, f"killed {'after' if after else 'before'} step {step} of {len(steps)}"
