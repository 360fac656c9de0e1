"""What follows a condition from cell to cell, as all observables see it: a bias, an acceleration, a gain.

A bias that steps with every turn moves means, slopes and what is left after turns, each by its own part. Asked
about one by one, none of them need stand out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns, turned
from rigctl.experiments.rotating_platform.observe.observables import READ, SERIES, TURN_CYCLES
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.workbench.study import OF_SIGNAL


def templates(
    chain: Mapping[str, PlatformRuns],
    shared: FloatArray,
    reduced: Callable[[Mapping[str, FloatArray]], FloatArray],
) -> dict[tuple[int, str], FloatArray]:
    """`Observations.templates`: columns for one standard deviation of each condition over the kept samples.

    `chain` are all cells by channel, `shared` the baseline's gain of the tilt and accelerations along Z and Y,
    `reduced` what gives the observables of means over the cells, (cells, k).
    """
    gain, z0, y0 = shared.tolist()
    found: dict[tuple[int, str], FloatArray] = {}
    for channel in CHANNELS:
        run = chain[channel]
        along = turned(run.at(a_z=gain * run.c_z + z0, a_y=y0 + run.c_y), 0.0).along
        # Of a signal of usual size.
        share = along / np.sqrt(np.mean(along**2))
        weight = np.concatenate([each.count for each in run.cells])
        bias, acceleration = (_number(channel, component) for component in ("bias mean", "accel mean"))
        named: list[tuple[int, str]] = []
        columns: list[FloatArray] = []
        for name, values in _followed(run).items():
            if not np.isfinite(values).all() or not np.ptp(values) > 0.0:
                continue
            away = values - np.average(values, weights=weight)
            away = away / np.sqrt(np.average(away**2, weights=weight))
            named += [(bias, name), (acceleration, name), (acceleration, OF_SIGNAL + name)]
            columns += [away, away * run.cos, away * share]
        if named:
            # All at once: one column after the other takes three times as long.
            found.update(zip(named, reduced({channel: np.stack(columns, axis=1)}).T.copy(), strict=True))
    return found


def _followed(run: PlatformRuns) -> Mapping[str, FloatArray]:
    counts = {"turns": run.turns, "turns_in_run": run.turns_in_run}
    return {
        "time_s": run.t,
        "within_run_s": run.within,
        "temperature_c": run.temperature,
        "turns": run.turns,
        **{f"{name}_modulo_{cycle}": count % cycle for name, count in counts.items() for cycle in TURN_CYCLES},
        **run.columns,
    }


def _number(channel: str, component: str) -> int:
    return next(
        number for number, each in enumerate(SERIES) if (each.channel, each.component) == (READ[channel], component)
    )
