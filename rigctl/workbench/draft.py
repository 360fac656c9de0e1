"""A plug-in drafted from what no known effect describes: its physics is left to name.

Where in the chain it acts is asked of the data: what was described (a covariate, a harmonic of the angle) is tried at
every point, as something added and as a factor of the signal there, and the form that explains most is written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np

from rigctl.core.errors import DataError
from rigctl.core.experiments import experiment_named
from rigctl.core.units import known_unit, power, ratio, unit_of_column
from rigctl.workbench.findings import Diagnosis, Unexplained
from rigctl.workbench.study import OF_SIGNAL, SIGNAL, Observations
from rigctl.workbench.study_base import StudyBase
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.workbench import Workbench

ID = "drafted"
_TRIED = "tried-form"

_UNIT_OF_POINT = {"_m_s2": "m/s2", "_1_s2": "1/s2", "_rad": "rad", "_v": "V", "_m": "m"}


@dataclass(frozen=True)
class Form:
    """One way in which what was described may act: `added` is an expression of `run`, {k} stands for the size."""

    point: str
    added: str
    unit: str
    parameters: tuple[str, ...]


def drafted(workbench: Workbench, found: Diagnosis) -> str:
    """The text of a plug-in with one effect; `DataError` where nothing is unexplained, or no form explains it."""
    unexplained = found.unexplained
    if unexplained is None or "covariate" not in unexplained.details:
        raise DataError(f"{workbench.store.path}: nothing is left that the runs' conditions describe")
    experiment = experiment_named(workbench.store.header.experiment)
    scope = "channel" if "channel" in experiment.scopes else "recording"
    study = workbench.study
    forms_of = type(study)
    if not issubclass(forms_of, StudyBase):
        raise DataError(f"experiment '{study.experiment}' says nothing of drafts; draft the effect by hand")
    given = study.model(found.terms).observations
    units = {point: _unit_of_point(point, given, unexplained) for point in experiment.points}
    forms = list(_forms(units, forms_of, unexplained, _reference(given, unexplained)))
    # At size 1: a score does not depend on the size at which it is asked.
    texts = [_text(f"{_TRIED}-{number}", each, 1.0, scope, unexplained) for number, each in enumerate(forms)]
    # Tried as a file, the way the finished plug-in will be used: what cannot be loaded is never drafted.
    with TemporaryDirectory() as directory:
        file = Path(directory) / "forms.py"
        file.write_text(_HEAD + "".join(texts), encoding="utf-8")
        extended = workbench.study_with_files([file])
        scored = Attempt(extended, (*found.terms, *found.suggested)).scored
    tried = {
        each.candidate.term.effect: each for each in scored if each.candidate.term.effect.startswith(f"{_TRIED}-")
    }
    if not tried:
        raise DataError(f"{workbench.store.path}: no form of it changes these data; draft it by hand")
    best = max(tried, key=lambda name: _evidence(tried[name], len(given.value)))
    form = forms[int(best.rpartition("-")[2])]
    size = float(np.max(np.abs(tried[best].score.estimate)))
    # Another drafted effect may be among the plug-ins that are given.
    name = next(each for each in _names() if each not in study.effects())
    return _docstring(unexplained) + _HEAD + _text(name, form, float(f"{size:.2g}"), scope, unexplained)


def _names() -> Iterator[str]:
    yield ID
    yield from (f"{ID}-{number}" for number in count(2))


def _evidence(scored: Scored, data: int) -> float:
    # A form with cosine and sine pays for its second parameter (Schwarz).
    return 0.5 * scored.score.statistic - 0.5 * scored.score.dimension * float(np.log(data))


def _reference(given: Observations, unexplained: Unexplained) -> float:
    """The mean of the covariate, to three digits: a fixed value from which it is counted."""
    values = given.covariates.get(_covariate(unexplained)[0], np.zeros(1))
    return float(f"{np.nanmean(values):.3g}")


def _covariate(unexplained: Unexplained) -> tuple[str, str]:
    """Its name and power; whether it is a factor of the signal is asked of the data."""
    name, _, degree = str(unexplained.details["covariate"]).removeprefix(OF_SIGNAL).partition("^")
    return name, degree


def _unit_of_point(point: str, given: Observations, unexplained: Unexplained) -> str:
    """As the point's name says; one without a unit in its name is what was measured itself."""
    measured = next((series.unit for series in given.series if series.channel == unexplained.channel), "")
    unit = next((unit for suffix, unit in _UNIT_OF_POINT.items() if point.endswith(suffix)), measured)
    return unit if known_unit(unit) else "1"


def _forms(
    units: Mapping[str, str], study: type[StudyBase[Any]], unexplained: Unexplained, reference: float
) -> Iterator[Form]:
    """At every point with its unit, with and without the harmonic of the angle."""
    name, degree = _covariate(unexplained)
    if name == SIGNAL:
        for point, unit in units.items():
            yield Form(point, f"k * run.signal**{degree}", ratio("1", power(unit, float(degree) - 1.0)), ("k",))
        return
    factor, counted = "", ""
    if name:
        here = study.expressions.get(name, f'run.column("{name}")')
        away = f"({here} - {reference:g})"
        factor = f"{away}**{degree} * " if degree else f"{away} * "
        counted = power(unit_of_column(name), float(degree or 1))
    harmonic = int(unexplained.details["harmonic_of_angle"])
    for point, unit in units.items():
        for base in study.drafts:
            size_unit = "1" if base == "run.signal" else unit
            size_unit = ratio(size_unit, counted) if counted else size_unit
            yield Form(point, f"k * {factor}{base}", size_unit, ("k",))
            if harmonic:
                angle = f"{harmonic} * run.theta" if harmonic > 1 else "run.theta"
                turning = f"(k_cos * np.cos({angle}) + k_sin * np.sin({angle}))"
                yield Form(point, f"{turning} * {factor}{base}", size_unit, ("k_cos", "k_sin"))


_HEAD = """import numpy as np

from rigctl.effects import effect
"""


def _docstring(unexplained: Unexplained) -> str:
    described = fill(f"Drafted from: {unexplained.description}.", width=110)
    return f'"""{described}\n\nName the physics, then the id, the source and the sizes.\n"""\n\n'


def _text(name: str, form: Form, size: float, scope: str, unexplained: Unexplained) -> str:
    return f'''

@effect(
    "{name}",
    on="{form.point}",
    parameters={{{", ".join(f'"{each}": "{form.unit}"' for each in form.parameters)}}},
    typical={{{", ".join(f'"{each}": {size:g}' for each in form.parameters)}}},
    source="not named yet",
    scope="{scope}",
)
def {name.replace("-", "_")}(run, {", ".join(form.parameters)}):
    """To be named: acts on {unexplained.channel}."""
    return {form.added}
'''
