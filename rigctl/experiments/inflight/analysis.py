"""In-flight calibration of a drag-free differential accelerometer: from a store to its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rigctl.analysis.kept import Progress
from rigctl.campaign.recording import RunSource
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.observe.sessions import QUADRATIC
from rigctl.experiments.inflight.observe.store_reduction import reduction
from rigctl.experiments.inflight.result.monte_carlo import DRAW, Draw, tables

# What fits and tells results is imported where it is used: reducing samples needs none of it.
if TYPE_CHECKING:
    from rigctl.analysis.measurement_result import MeasurementResult
    from rigctl.experiments.inflight.study import InflightStudy
    from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Their lines, run by run."""
    return reduction(source, progress=progress).left_out


def study(source: RunSource, plugins: Sequence[Plugin]) -> InflightStudy:
    """A recording's runs as the workbench sees them."""
    from rigctl.experiments.inflight.study import InflightStudy

    return InflightStudy(source, plugins)


@dataclass(frozen=True)
class InflightResult:
    """`numbers` as `rigctl result --json` has them: of one calibration, or of all draws of a Monte Carlo study."""

    numbers: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return dict(self.numbers)


def result(workbench: Workbench) -> dict[str, Any]:
    """The ten parameters of one calibration; of a Monte Carlo study the paper's tables 2 and 3; `DataError`."""
    return analyse(workbench).as_json()


def measurement_result(workbench: Workbench) -> MeasurementResult:
    """The ten parameters with what no session sees, and delta where it was tested; of a study mean errors."""
    from rigctl.experiments.inflight.result.measurement import calibration_measured, study_measured
    from rigctl.workbench.fit_measurement import fit_measurement

    draws = [Draw.from_json(document.data) for document in workbench.store.documents(DRAW)]
    if draws:
        return study_measured(draws)
    sessions = {run.run_id: str(run.conditions["session"]) for run in workbench.store.runs(valid_only=True)}
    return calibration_measured(fit_measurement(workbench), analyse(workbench).numbers, sessions)


def analyse(workbench: Workbench) -> InflightResult:
    """A calibration fitted with its current model, or all draws of a Monte Carlo study; `DataError`."""
    draws = [Draw.from_json(document.data) for document in workbench.store.documents(DRAW)]
    if draws:
        return InflightResult(tables(draws, workbench.store.header.constants))
    from rigctl.experiments.inflight.effects_in_test import corrected
    from rigctl.experiments.inflight.observe.equivalence_runs import runs_of_test
    from rigctl.experiments.inflight.result.budget import calibration_budget
    from rigctl.experiments.inflight.result.equivalence import calibrated_of, doubts, equivalence
    from rigctl.experiments.inflight.result.result import calibration, systematic
    from rigctl.experiments.inflight.study import InflightStudy
    from rigctl.experiments.inflight.study_data import usual_temperatures_k
    from rigctl.experiments.inflight.study_model import InflightModel
    from rigctl.workbench.study_base import own_model
    from rigctl.workbench.verdict.attempt import Attempt
    from rigctl.workbench.verdict.misfit import of_misfit

    studied = workbench.study
    assert isinstance(studied, InflightStudy)
    version = workbench.current
    attempt = Attempt(studied, version.terms)
    estimates = attempt.estimates()
    values, covariance = attempt.result.values, attempt.uncertainty.covariance
    beyond = systematic(values, covariance, studied.source.header.constants)
    numbers = {
        "version": version.version,
        **calibration(studied, estimates, beyond),
        "budget": calibration_budget(studied, attempt).as_json(),
    }
    test = runs_of_test(studied.source)
    numbers["remarks"] = [*of_misfit(attempt, version.version), *numbers["remarks"], *test.left_out.values()]
    if test.runs:
        model, level = own_model(attempt.model, InflightModel), calibrated_level(studied)
        effects = model.by_effect(values)
        usual_k = usual_temperatures_k(studied.data.reduced.runs)
        runs, told = corrected([run.about(level) for run in test.runs], studied.source, effects, usual_k)
        known = {effect.id for (effect, _), is_told in zip(effects, told, strict=True) if is_told}
        places = [place for place, owner in enumerate(model.owners) if owner in known]
        calibrated = calibrated_of(values, covariance, beyond, places)
        numbers["ep"] = equivalence(runs, calibrated)
        numbers["remarks"] += doubts(runs, calibrated, [each.id for each, _ in effects if each.id not in known])
    return InflightResult(numbers)


def calibrated_level(study: InflightStudy) -> float:
    """The level of m_dx [m/s2] while the mean of both masses was held and nothing injected, or as little as there is:
    where the calibrated slopes are those of the sensors."""
    held = [run for run in study.data.reduced.runs if run.session.name not in QUADRATIC]
    quietest = min(held or study.data.reduced.runs, key=lambda run: run.whole.amplitudes.mean_square)
    return quietest.whole.amplitudes.apart
