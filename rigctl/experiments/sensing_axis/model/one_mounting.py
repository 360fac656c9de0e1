"""The model of one mounting, fitted to the runs there are so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.fit import RecordingFit, fit_recording
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.files.package import HeadSettings, Package

ROLL = "roll-gravity"


def fit_mounting(
    runs: Sequence[RunObservables],
    package: Package,
    heads: Mapping[str, HeadSettings],
    g_m_s2: float,
    effects: Sequence[Effect],
) -> RecordingFit:
    """Fit the runs of a mounting. At one frequency roll is a shift of the null: it enters with the second one."""
    one_frequency = len({round(run.frequency_hz, 2) for run in runs}) == 1
    separable = tuple(effect for effect in effects if effect.id != ROLL or not one_frequency)
    return fit_recording(RecordingModel(runs, package, heads, g_m_s2, separable))
