"""Two accelerometers on a rotating platform: from a store to acceleration told from the accelerometers' own bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.analysis.kept import Progress
from rigctl.analysis.measurement_result import MeasurementResult, Quantity, checked
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import DataError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.rotating_platform.observe.recorded import chains
from rigctl.experiments.rotating_platform.observe.store_reduction import reduction
from rigctl.experiments.rotating_platform.result.alignment import Fitted
from rigctl.experiments.rotating_platform.result.bench_runs import flips, scans
from rigctl.experiments.rotating_platform.result.chain_noise import chain_noise, noise_records
from rigctl.experiments.rotating_platform.result.contradictions import gain_contradictions
from rigctl.experiments.rotating_platform.result.result import NOT_TESTED, RESULTS, PlatformResult, platform_result
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.misfit import of_misfit
from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Their cells, run by run."""
    return reduction(source, progress=progress).left_out


def study(source: RunSource, plugins: Sequence[Plugin]) -> PlatformStudy:
    """A recording's modulated runs as the workbench sees them."""
    return PlatformStudy(source, plugins)


def result(workbench: Workbench) -> dict[str, Any]:
    """Tilt gain, accelerations, wobbles; of every run means and precision; scans, flips and noise records."""
    store, believed = workbench.store, chains(workbench.store.header)
    told = analyse(workbench)
    scanned, _ = scans(store, believed, told.chain_noise)
    turned = flips(store, believed)
    return {
        **told.as_json(),
        "scans": [each.as_json() for each in scanned],
        "flips": {channel: flipped.as_json() for channel, flipped in turned.items()},
    }


METHOD = (
    "Modulation by half turns of the platform, demodulated period by period (Lenoir, Christophe, Reynaud 2013, "
    "Measurement 46, 1411)"
)
UNITS = {"tilt_gain": "1", "accel_z": "m/s2", "accel_y": "m/s2", "wobble_a": "rad", "wobble_b": "rad"}


def measurement_result(workbench: Workbench) -> MeasurementResult:
    """Tilt gain, accelerations and wobbles, where they are known, with their budget; errors as `analyse`."""
    told = analyse(workbench).budget
    first = told.first
    rows = zip(first.outputs, first.values, strict=True)
    quantities = tuple(Quantity(name, float(value), UNITS[name]) for name, value in rows)
    remarks = (
        f"Budget: {told.check.reason}.",
        f"No modulation shows these effects: {', '.join(NOT_TESTED)}.",
    )
    return checked(MeasurementResult(quantities, tuple(told.sources), METHOD, remarks))


def analyse(workbench: Workbench) -> PlatformResult:
    """Fit a store's runs with its current model, and go through them one by one; `DataError`, `ProcedureError`."""
    studied = workbench.study
    if not isinstance(studied, PlatformStudy):
        raise DataError(f"{workbench.store.path}: '{workbench.store.header.experiment}' recordings have no platform")
    version = workbench.current
    attempt = Attempt(studied, version.terms)
    header = workbench.store.header
    records, silent = noise_records(workbench.store)
    left_out = {**studied.left_out, **silent}
    fitted, noises = results_of(attempt), chain_noise(header, records)
    gain = fitted.quantity("tilt_gain")
    warnings = [*of_misfit(attempt, version.version), *gain_contradictions(gain.value, gain.sigma)]
    return platform_result(studied.recorded, header, fitted, left_out, noises, records, warnings)


def results_of(attempt: Attempt) -> Fitted:
    """The results among the parameters of a model, with their covariance."""
    names = [each.name for each in attempt.model.parameters]
    places = [names.index(name) for name in RESULTS]
    covariance = attempt.uncertainty.covariance[np.ix_(places, places)]
    return Fitted(RESULTS, attempt.result.values[places], covariance)
