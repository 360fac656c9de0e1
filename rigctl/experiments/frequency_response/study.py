"""The frequency response as the workbench sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from rigctl.campaign.recording import Header, why_none
from rigctl.campaign.stated import heads_of, uncertainties_of
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.effects.trial import columns_of
from rigctl.experiments.frequency_response.columns import ACCEL, STAGE, is_head
from rigctl.experiments.frequency_response.imagined import imagined, options
from rigctl.experiments.frequency_response.model import Bench, Recorded, ResponseModel, recorded
from rigctl.experiments.frequency_response.observables import reduction
from rigctl.workbench.placed import Placed, placed
from rigctl.workbench.study import Candidate, Model, Proposal, Term
from rigctl.workbench.study_base import CatalogueStudy, own_model, parameters_as_json


def bench_of(header: Header) -> Bench:
    """What rig file, or imported recording, say of gravity, heads and uncertainties."""
    certified = uncertainties_of(header)
    heads = {name: head for name, head in heads_of(header).items() if is_head(name)}
    # Where a head has a clock of its own, the phase of the displacement is the encoder's.
    own = [name for name in heads if name in header.channels and header.channels[name].clock is not None]
    timed = [STAGE if name in own else name for name in heads]
    late_s = [certified.get(name, {}).get("latency_s", 0.0) for name in timed]
    # Heads are triggered alike: what one is late the others are.
    displacement_u_s = math.sqrt(sum(each**2 for each in late_s) / max(len(late_s), 1))
    return Bench(
        g_m_s2=float(header.constants.get("g_m_s2", Bench.g_m_s2)),
        delay_u_s=math.hypot(certified.get(ACCEL, {}).get("latency_s", 0.0), displacement_u_s),
        gain_u=certified.get(ACCEL, {}).get("scale", 0.0),
        frequency_u=certified.get(ACCEL, {}).get("clock", 0.0),
        pitch_u_rad_m=certified.get("stage", {}).get("pitch_rad_per_m", 0.0),
        heads_u={name: head.u_scale for name, head in heads.items()},
        tilts_rad={name: head.tilt_rad for name, head in heads.items()},
    )


class ResponseStudy(CatalogueStudy[Recorded]):
    """A recording of the frequency response."""

    experiment = "frequency-response"
    expressions: ClassVar[Mapping[str, str]] = {
        "temperature_c": "run.temperature",
        "start_s": "run.start",
        "direction": "run.direction",
        "acceleration_m_s2": "run.acceleration",
    }
    drafts: ClassVar[Sequence[str]] = ("1.0", "run.signal", "run.x", "run.v", "run.a", "run.signal**3")

    def reduced_source(self) -> Recorded:
        """All runs; `DataError` without any."""
        bench = bench_of(self.source.header)
        runs, left_out = reduction(self.source, bench.tilts_rad)
        if not runs:
            raise DataError(f"no valid run could be reduced: {why_none(self.source, left_out)}")
        return recorded(runs, bench)

    def model(self, terms: Sequence[Term]) -> ResponseModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        found: list[Placed] = []
        baseline = ResponseModel(self.data)
        for effect in self.chosen(terms):
            if reason := self.untestable(effect, baseline):
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
            found.append(placed(effect, Term(effect.id), (), found))
        return ResponseModel(self.data, found)

    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why these runs cannot be asked about an effect; None when they can."""
        del model
        run = self.data.shaken
        if lacking := [name for name in columns_of(effect) if not np.isfinite(run.columns.get(name, np.nan)).all()]:
            return f"there is no column {lacking[0]} of numbers"
        if "temperature" in effect.needs and not np.ptp(run.temperature) > 0.0:
            return "no temperature is recorded that changes; write temperature_c"
        if "time" in effect.needs and not np.ptp(run.start) > 0.0:
            return "the runs do not say when they began; write start_s"
        return None

    def candidates_for(self, effects: Sequence[Effect], model: Model, values: FloatArray) -> list[list[Candidate]]:
        """One for each effect."""
        here, found = own_model(model, ResponseModel), []
        for effect in effects:
            one = placed(effect, Term(effect.id), (), here.placed)
            wider = ResponseModel(here.data, (*here.placed, one))
            start = np.concatenate([values, np.zeros(len(one.parameters))])
            derivative = wider.jacobian(start, len(values))
            names = tuple(each.name for each in one.parameters)
            units = tuple(each.unit for each in one.parameters)
            typical = np.array([each.typical for each in one.parameters])
            found.append([Candidate(one.term, names, units, derivative, typical)])
        return found

    def options(self) -> list[Proposal]:
        """Runs that could be made next; see `imagined.options`."""
        return options(self.data.runs)

    def extended(self, proposals: Sequence[Proposal]) -> ResponseStudy:
        """This recording and runs that could be made next."""
        return self.with_data(recorded([*self.data.runs, *imagined(proposals, self.data.runs)], self.data.bench))

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The parameters of the model."""
        return parameters_as_json(model, values, covariance)
