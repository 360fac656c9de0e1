"""The tumble test as the workbench sees it: data, models, candidates, result, what to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from rigctl.analysis.kept import Progress
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.effects.trial import columns_of
from rigctl.workbench.fit_result import analyse as analyse
from rigctl.workbench.fit_result import result as result
from rigctl.workbench.placed import Placed, placed
from rigctl.workbench.study import Candidate, Model, Proposal, Term
from rigctl.workbench.study_base import CatalogueStudy, own_model, parameters_as_json
from tumble_test.model import OF_A_SENSOR, Bench, Recorded, TumbleModel, recorded
from tumble_test.observables import Reduced, reduction
from tumble_test.positions import OUTS

G_N = 9.80665
"""The standard acceleration, exactly: the unit g of results. Gravity at the place is [constants.g_m_s2]."""

_ANGLE, _SQUARE = (1e6, "urad"), (1e6 * G_N, "ug/g2")
SHEETS = ((G_N, "V/g"), (1e6 / G_N, "ug"), _ANGLE, _ANGLE, _SQUARE, (1e6 * G_N**2, "ug/g3"), _SQUARE, _SQUARE)
"""What the coefficients OF_A_SENSOR are multiplied by, from SI, and their units on data sheets."""

REMOUNT_S, RUN_S = 900.0, 40.0
CLOCKINGS_DEG = (0.0, 90.0, 180.0, 270.0)
ANGLES_DEG = tuple(30.0 * place for place in range(12))
_NOTHING = 0.05
"""Of its sigma: an effect is not asked about by whose typical size no datum moves more."""


class TumbleStudy(CatalogueStudy[Recorded]):
    """A recording of a tumble test."""

    experiment = "tumble-test"

    def reduced_source(self) -> Recorded:
        """All positions; `DataError` without any."""
        runs, left_out = reduction(self.source)
        if not runs:
            raise DataError(f"no valid run could be reduced: {next(iter(left_out.values()), 'there is none')}")
        known = self.source.header.constants
        return recorded(runs, Bench(**{name: known[name] for name in Bench._fields if name in known}))

    def model(self, terms: Sequence[Term]) -> TumbleModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        found: list[Placed] = []
        for effect in self.chosen(terms):
            if reason := self.untestable(effect, self._baseline):
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
            found.append(placed(effect, Term(effect.id), self.data.sensors, found))
        return TumbleModel(self.data, found, self._baseline.held)

    @cached_property
    def _baseline(self) -> TumbleModel:
        return TumbleModel(self.data)

    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why these positions cannot be asked about an effect; None when they can."""
        del model
        run = self.data.run
        if lacking := [name for name in columns_of(effect) if not np.isfinite(run.columns.get(name, np.nan)).all()]:
            return f"there is no column {lacking[0]} of numbers"
        if "temperature" in effect.needs and not np.ptp(run.temperature) > 0.0:
            return "no temperature is recorded that changes; write temperature_c"
        if "approach" in effect.needs and not np.ptp(run.approach) > 0.0:
            return "all positions were reached from the same side, or none says from which; write approach"
        if "time" in effect.needs and not np.isfinite(run.t).all():
            return "the runs do not say when they began; write start_s"
        return None

    def candidates_for(self, effects: Sequence[Effect], model: Model, values: FloatArray) -> list[list[Candidate]]:
        """One for each effect."""
        here, found = own_model(model, TumbleModel), []
        for effect in effects:
            one = placed(effect, Term(effect.id), here.data.sensors, here.placed)
            wider = TumbleModel(here.data, (*here.placed, one), here.held)
            derivative = wider.jacobian(np.concatenate([values, np.zeros(len(one.parameters))]), len(values))
            typical = np.array([each.typical for each in one.parameters])
            moved = np.abs(derivative * typical) > _NOTHING * here.observations.sigma[:, None]
            seen = derivative * np.any(moved, axis=0)
            names, units = zip(*((each.name, each.unit) for each in one.parameters), strict=True)
            found.append([Candidate(one.term, names, units, seen, typical)])
        return found

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The coefficients of each sensor in the units of data sheets, without those that are held."""
        known = parameters_as_json(model, values, covariance, len(OF_A_SENSOR) * len(self.data.sensors))
        held, found = {each.name for each in model.parameters if each.fixed}, {}
        for number, (name, each) in enumerate(known.items()):
            factor, unit = SHEETS[number // len(self.data.sensors)]
            if name not in held:
                found[name] = {"value": factor * each["value"], "sigma": factor * each["sigma"], "unit": unit}
        return found

    def options(self) -> list[Proposal]:
        """A position in the mounting that is there, or in one with another axis out, or clocked otherwise."""
        last, found = self.data.seats[-1][:2], []
        for out, clocking_deg in product(OUTS, CLOCKINGS_DEG):
            there = (out, clocking_deg) == last
            sitting, sitting_s = ("", 0.0) if there else (f"{out} {clocking_deg:g}", REMOUNT_S)
            for angle_deg, approach in product(ANGLES_DEG, (1, -1) if there else (1,)):
                settings = {"out": out, "clocking_deg": clocking_deg, "angle_deg": angle_deg, "approach": approach}
                found.append(Proposal(settings, RUN_S, sitting, sitting_s))
        return found

    def extended(self, proposals: Sequence[Proposal]) -> TumbleStudy:
        """This recording and positions that could be measured next."""
        here = self.data
        return self.with_data(recorded([*here.runs, *_imagined(proposals, here.runs)], here.bench, here.measured))


def _imagined(proposals: Sequence[Proposal], runs: Sequence[Reduced]) -> list[Reduced]:
    """Positions as if they had been measured; each other mounting is a new one."""
    last, found = runs[-1], []
    numbers, first = {last.seat[:2]: last.seat[2]}, max(run.seat[2] for run in runs)
    sweep = max(np.nan_to_num([run.number("sweep") for run in runs])) + 1.0
    sigma_v = {name: float(np.median([r.sigma_v[name] for r in runs if name in r.sigma_v])) for name in last.sigma_v}
    for place, each in enumerate(proposals, start=1):
        number = numbers.setdefault((each.settings["out"], each.settings["clocking_deg"]), first + len(numbers))
        conditions = {**last.conditions, **each.settings, "mounting": number, "sweep": sweep}
        found.append(Reduced(f"next {place}", conditions, dict.fromkeys(sigma_v, 0.0), sigma_v, last.duration_s))
    return found


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Which runs no number can be had of, and why."""
    del progress
    return reduction(source)[1]


study = TumbleStudy
