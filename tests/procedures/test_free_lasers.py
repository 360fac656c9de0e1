"""Heads that an LK-G3001 stores on its own clock: their sines are where nature has them, to microseconds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from procedures.sensing_axis.bench import SetPoint
from procedures.sensing_axis.wiring import channels
from rigctl.campaign.recording import OWN_CLOCK, time_column
from rigctl.campaign.store.entries import RUN_REPEATED
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import LimitError
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run

HEADS = ("laser_1_mm", "laser_2_mm", "laser_3_mm")
WITHIN_RAD = 0.2e-3
"""Of the drive's phase: how well channels have to be aligned."""


@pytest.fixture
def twin(make_twin: Callable[..., Any]) -> Any:
    made = make_twin()
    made.session.operator.remount("X", "pendulum", 1)
    made.session.operator.level(0.0)
    return made


@pytest.mark.parametrize("frequency_hz", [0.3, 0.6, 2.0])
def test_amplitude_and_phase_of_every_head_are_natures(twin: Any, frequency_hz: float) -> None:
    point = SetPoint("X", "pendulum", 1, 0.4, frequency_hz, 4.0, 20.0, 100.0)
    record = twin.bench.run(twin.session, "run", point, before=lambda: None)
    samples = twin.store.samples(record.run_id)
    known, _ = channels(twin.rig)
    (run,) = observables([reduce_run(record.run_id, record.conditions, samples, channels=known)])
    first_s = record.conditions["start_s"] + twin.bench.readout.first_sample_after_s
    stage = sine(samples["t_s"], samples["stage_x_mm"], run.frequency_hz)
    for head in HEADS:
        assert known[head].clock == OWN_CLOCK
        own_s, seen, found = samples[time_column(head)], samples[head], run.lasers_m[head]
        clock = found.clock
        assert clock is not None
        # Its clock is fast by 40 ppm, the edges are those of the meter.
        assert abs(clock.rate + 40e-6) < 5.0 * clock.rate_u
        rig_s = first_s + own_s + clock.offset_s + clock.rate * (own_s - own_s.mean())
        # What nature shows this head at these times, but for its noise and the last digit.
        true_mm = twin.rig.simulation.bench.displacement_mm(head)(rig_s)
        true, recorded = (sine(rig_s - first_s, each, run.frequency_hz) for each in (true_mm, seen))
        noise_mm = 1e3 * float(found.sigma[1])
        assert abs(recorded - true) < 6.0 * noise_mm + WITHIN_RAD * abs(true)
        # In phase with the encoder, signed.
        in_phase = (true * stage.conjugate() / abs(stage)).real
        assert 1e3 * found.value[1].real == pytest.approx(in_phase, abs=6.0 * noise_mm)
        assert 1e3 * abs(found.value[1].imag) < noise_mm


def sine(t_s: FloatArray, values: FloatArray, frequency_hz: float) -> complex:
    """Complex amplitude, by least squares beside a mean and a drift."""
    angle = 2.0 * math.pi * frequency_hz * t_s
    waves = np.stack([np.ones_like(t_s), t_s - t_s.mean(), np.cos(angle), np.sin(angle)], axis=1)
    found = np.linalg.lstsq(waves, values, rcond=None)[0]
    return complex(found[2], -found[3])


def test_a_head_that_sees_little_is_as_uncertain_as_it_is(twin: Any) -> None:
    """Over several runs: the offsets of one controller's two heads differ by their uncertainties."""
    pulls = []
    for number in range(6):
        point = SetPoint("X", "pendulum", 1, 0.1 * number, 0.6, 4.0, 10.0, 100.0)
        record = twin.bench.run(twin.session, f"run {number}", point, before=lambda: None)
        known, _ = channels(twin.rig)
        samples = twin.store.samples(record.run_id)
        (run,) = observables([reduce_run(record.run_id, record.conditions, samples, channels=known)])
        one, other = (run.lasers_m[head].clock for head in ("laser_1_mm", "laser_2_mm"))
        assert one is not None
        assert other is not None
        assert one.offset_u_s < 2e-6
        pulls.append((one.offset_s - other.offset_s) / math.hypot(one.offset_u_s, other.offset_u_s))
    # Chi-square of six at 1e-5.
    assert np.sum(np.square(pulls)) < 33.1


def test_a_start_that_was_answered_too_late_to_align_the_heads_is_measured_again(
    twin: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It began somewhere between trigger and answer: half a period later, a small amplitude has the other sign."""
    start, late_s = twin.bench.readout.start, [0.03]

    def answered_late(samples: int, period_s: float) -> float:
        started_s: float = start(samples, period_s)
        twin.session.clock.sleep_s(late_s.pop() if late_s else 0.0)
        return started_s

    monkeypatch.setattr(twin.bench.readout, "start", answered_late)
    point = SetPoint("X", "pendulum", 1, 0.4, 0.6, 4.0, 20.0, 100.0)
    record = twin.bench.run(twin.session, "run", point, before=lambda: None)
    assert record.valid
    (repeated,) = twin.store.events(RUN_REPEATED)
    assert "0.03 s to be answered" in str(repeated.data)


def test_a_drive_too_fast_for_what_is_known_of_the_times_is_refused_before_anything_moves(twin: Any) -> None:
    slow, fast = (SetPoint("X", "pendulum", 1, 0.4, frequency_hz, 0.5, 10.0, 100.0) for frequency_hz in (4.0, 4.5))
    twin.bench.check(slow, lasers=True)
    twin.bench.check(fast, lasers=False)
    with pytest.raises(LimitError, match=r"lasers_a: its times are known to 0.02 s .start_u_s., which at 4.5 Hz"):
        twin.bench.check(fast, lasers=True)
