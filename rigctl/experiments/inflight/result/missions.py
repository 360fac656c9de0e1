"""Sessions of the test in a Monte Carlo study: reduced while simulated, corrected with each draw's calibration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.analysis.kept import Packed
from rigctl.core.arrays import FloatArray
from rigctl.core.threads import one_thread
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.equivalence import TestRun, TestSums
from rigctl.experiments.inflight.observe.sessions import Session
from rigctl.experiments.inflight.observe.weights import taper
from rigctl.experiments.inflight.result.equivalence import GRAVITY_M_S2, Calibrated, equivalence, sensitivities
from rigctl.experiments.inflight.result.published import published

TEST_CHUNK = 2048
"""Samples at a time: many, as what all draws share is made once for each."""


@one_thread
def reduced_tests(
    session: Session,
    duration_s: float,
    telemetry: Iterable[FloatArray],
    columns: Sequence[str],
    draws: tuple[int, ...],
    going_on: Callable[[], None],
) -> Packed:
    """Some draws of a session of the test, as their telemetry comes, (samples, columns, draws) at a time.

    Samples are all there, and no pulses are looked for. `going_on` raises when nobody waits any more. Arrays by draw,
    as `TestRun` has them, and `draws`.
    """
    step_s = session.sample_period_s
    count = round(duration_s / step_s)
    t_s = step_s * np.arange(count, dtype=np.float64)
    sums = TestSums(session, t_s, taper(np.ones(count, dtype=bool), step_s), len(draws), count * step_s)
    at, held = 0, np.empty((0, len(columns), len(draws)))
    for chunk in telemetry:
        going_on()
        # Rates are differences: the last sample waits for the next chunk, and the one before it goes along.
        held = np.concatenate([held, chunk])
        inner = slice(min(at, 1), len(held) - 1)
        sums.add(at, inner, _by_draw(held, columns))
        at += inner.stop - inner.start
        held = held[-2:].copy()
    sums.add(at, slice(1, 2), _by_draw(held, columns))
    runs = sums.runs([str(draw) for draw in draws])
    arrays = {name: np.stack([getattr(run, name) for run in runs]) for name in ("amplitudes", "beside", "spread")}
    return Packed({"orbits": runs[0].orbits}, {**arrays, "draws": np.array(draws)})


def _by_draw(samples: FloatArray, columns: Sequence[str]) -> list[dict[str, FloatArray]]:
    apart = np.ascontiguousarray(samples.transpose(2, 1, 0))
    return [dict(zip(columns, each, strict=True)) for each in apart]


def run_of(unit: Packed, session: Session, draw: int) -> TestRun:
    """One draw's session, from what `reduced_tests` left."""
    place = unit.arrays["draws"].tolist().index(draw)
    amplitudes, beside, spread = (unit.arrays[name][place] for name in ("amplitudes", "beside", "spread"))
    return TestRun(session.name, session, unit.head["orbits"], 0.0, amplitudes, beside, spread)


def tested(
    runs: Sequence[TestRun], calibrated: Calibrated, level_m_s2: float, exact: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """By session delta before and after correction, with its sigmas, and by parameter what it does at the test's
    frequency: as it is in truth before, by the error of its estimate after; `per_unit_m_s2` of either."""
    told: dict[str, dict[str, Any]] = {}
    for run in runs:
        counted = replace(run.about(level_m_s2), run_id=run.session.name)
        found = equivalence([counted], calibrated)[counted.run_id]
        # Of delta and of what is in quadrature with it: a driver of table 1 has no phase.
        drivers = GRAVITY_M_S2 * np.linalg.norm(sensitivities(counted, calibrated.values), axis=0)
        told[run.session.name] = {
            **{key: found[key] for key in ("f_ep_hz", "orbits", "noise_dof", "delta", "quadrature", "uncorrected")},
            "rows": {
                name: {
                    "per_unit_m_s2": float(drivers[place]),
                    "before_m_s2": float(drivers[place] * abs(exact[name])),
                    "after_m_s2": float(drivers[place] * abs(calibrated.values[place] - exact[name])),
                }
                for place, name in enumerate(NAMES)
            },
        }
    return told


def summary(tests: Sequence[Mapping[str, Any]], truth: float) -> dict[str, Any]:
    """Of one session of all draws, beside what is printed in tables 1 and 3.

    `pull` is of delta, less its truth and over its sigma; its rms should be `expected_rms`, because amplitudes beside
    the line tell the noise and they are few. Drivers are means over the draws, contributions worst and mean.
    """
    error = np.array([each["delta"]["value"] - truth for each in tests])
    pulls = error / [each["delta"]["sigma"] for each in tests]
    dof = min(each["noise_dof"] for each in tests)
    uncorrected = np.array([each["uncorrected"]["value"] - truth for each in tests])
    return {
        "f_ep_hz": tests[0]["f_ep_hz"],
        "orbits": tests[0]["orbits"],
        "pull": {
            "mean": float(np.mean(pulls)),
            "rms": float(np.sqrt(np.mean(pulls**2))),
            # Of Student's t.
            "expected_rms": math.sqrt(dof / (dof - 2.0)),
        },
        "error": {"mean": float(np.mean(error)), "rms": float(np.sqrt(np.mean(error**2)))},
        **{
            key: float(np.sqrt(np.mean([each["delta"][key] ** 2 for each in tests])))
            for key in ("sigma_noise", "sigma_calibration")
        },
        "uncorrected": {"mean": float(np.mean(uncorrected)), "rms": float(np.sqrt(np.mean(uncorrected**2)))},
        "rows": _rows(tests),
    }


def _rows(tests: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    def mean(name: str, key: str) -> float:
        return float(np.mean([each["rows"][name][key] for each in tests]))

    made = {}
    for name in NAMES:
        printed, driver = published().rows[name], mean(name, "per_unit_m_s2")
        if beside := _TIMES_OFF_CENTRING.get(name):
            # Its driver is a gradient times an off-centring: that is at its bound too.
            driver *= OFF_CENTRING_M * mean(beside, "per_unit_m_s2") / mean(beside, "before_m_s2")
        made[name] = {
            "per_unit_m_s2": driver,
            "at_bound_m_s2": driver * printed.bound,
            "printed_per_unit_m_s2": printed.per_unit_m_s2,
            "printed_before_m_s2": printed.before_m_s2,
            "worst_m_s2": max(each["rows"][name]["after_m_s2"] for each in tests),
            "mean_m_s2": mean(name, "after_m_s2"),
        }
    return made


OFF_CENTRING_M = 20e-6
"""At which table 1 gives the rows of a_c12 and a_c13."""

_TIMES_OFF_CENTRING = {"ac12_rad": "ac11_dy_m", "ac13_rad": "ac11_dz_m"}
