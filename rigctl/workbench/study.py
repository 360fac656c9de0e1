"""What an experiment tells the workbench of itself: its reduced data, its models, its catalogue.

Everything is stacked into vectors of n data, one per (run, series) that was measured; a series is one component of
one channel. The workbench works on these vectors and on derivatives with respect to parameters, whatever they mean.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from rigctl.analysis.correlated_groups import CorrelatedGroups, Factor
from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Series:
    """One component of one channel, in its own unit: accel_v, "2 nu quadrature", V."""

    channel: str
    component: str
    unit: str

    @property
    def name(self) -> str:
        """Channel and component."""
        return f"{self.channel} {self.component}"


@dataclass(frozen=True)
class NoisePool:
    """Data that share one estimate of their noise.

    `dof` degrees of freedom stand behind the sigmas of these data, 0 when they are no more than relative weights
    whose scale must come from the scatter; `stated`: by whoever measured. `order` names the covariate (of runs) along
    which this noise may be correlated from run to run, within one `Observations.group`; None for independent runs.
    `of_these`: the sigmas were told by the scatter of these data, not by others beside them. `resolution` is the
    step, in the data's unit, to which they were rounded: below what rounding leaves no scatter tells their noise.
    """

    name: str
    dof: float
    order: str | None = None
    stated: bool = False
    of_these: bool = False
    resolution: float = 0.0

    @property
    def least_sigma(self) -> float:
        """The standard deviation of rounding: errors are alike over one step."""
        return self.resolution / math.sqrt(12.0)


@dataclass(frozen=True)
class SharedOffset:
    """Data that share an unknown offset where they share a value of the column `name`: a batch, a station.

    `level_of` (n,) numbers the values; `share` is the offsets' standard deviation in units of the total one. The
    correlation itself is among the `Observations.factors`.
    """

    name: str
    level_of: IntArray
    share: float


SIGNAL = "signal"
"""Among covariates, with a power: the signal itself, as a curve of the response goes with it."""

OF_SIGNAL = f"{SIGNAL}*"
"""Before a covariate's name: in proportion to the signal, as a gain that follows it."""


@dataclass(frozen=True)
class Observations:
    """What was measured, reduced: n data in runs and series.

    Shapes: `value`, `sigma` (standard uncertainty, or relative weight; in the series' unit), `series_of`, `run_of`,
    `pool_of`, `group_of` (which data's noise may be correlated at all: one sensor's) are all (n,), the latter four
    indices. `covariates` are columns over the runs, (runs,), NaN where unknown: set-points, temperature, time, the
    recording's own extra columns. One of words has its `levels`, and its values are places among these. `block_of`
    (runs,) numbers the blocks that are held out together: mountings, else stretches of time. `angle` and `frequency`
    name the covariates, in degrees and hertz, in which the experiment's signals are periodic or go as powers; None
    when it has none. `factors` are Cholesky factors of correlations that are known beforehand: which data (k,), and
    the lower triangle (k, k), its rows of unit length. `indicators` are columns over the runs, 1 in a group of runs
    (a session) and 0 elsewhere: what is left may differ by it, and is then described by it. `templates` are, by
    series and covariate, columns (n,) over all data: what one standard deviation of the covariate does to them where
    more than its mean over a run counts. Among the shapes of the series they take the place of the covariate itself.
    `excluded` are readings that were marked invalid where they were recorded, and why: no datum is of them.
    """

    run_ids: tuple[str, ...]
    series: tuple[Series, ...]
    pools: tuple[NoisePool, ...]
    value: FloatArray
    sigma: FloatArray
    series_of: IntArray
    run_of: IntArray
    pool_of: IntArray
    group_of: IntArray
    block_of: IntArray
    covariates: Mapping[str, FloatArray] = field(default_factory=dict)
    angle: str | None = None
    frequency: str | None = None
    levels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    factors: tuple[Factor, ...] = ()
    offsets: tuple[SharedOffset, ...] = ()
    indicators: Mapping[str, FloatArray] = field(default_factory=dict)
    templates: Mapping[tuple[int, str], FloatArray] = field(default_factory=dict)
    excluded: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def correlated(self) -> CorrelatedGroups:
        """The `factors`, to be applied to columns of all data."""
        return CorrelatedGroups(self.factors, len(self.value))

    def of_runs(self, name: str) -> FloatArray:
        """A covariate at every datum, shape (n,)."""
        column = self.covariates[name] if name in self.covariates else self.indicators[name]
        return column[self.run_of]


@dataclass(frozen=True)
class Term:
    """An effect as part of a model: its id, and what of it was found by scanning (a head, a frequency, a period)."""

    effect: str
    choice: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """As a model version keeps it."""
        return {"effect": self.effect, "choice": dict(self.choice)}

    @property
    def key(self) -> str:
        """The same for equal terms alone: a choice cannot be hashed."""
        return json.dumps(self.as_json(), sort_keys=True)


class Model(Protocol):
    """Baseline and terms, as a function of parameters; `observations` are the data it predicts."""

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """What the baseline was extended with."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Of the baseline and then of the terms: names as in `rigctl fit --json`, starts, priors."""

    @property
    def units(self) -> Sequence[str]:
        """Of each parameter."""

    @property
    def owners(self) -> Sequence[str]:
        """To which each parameter belongs: an effect's id, or "" for the baseline."""

    @property
    def local(self) -> Sequence[bool]:
        """Of each parameter, whether it belongs to one mounting and says nothing of another recording."""

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""


@runtime_checkable
class ExactlyLinear(Protocol):
    """A model that knows which of its parameters no effect of second order goes with."""

    @property
    def exactly_linear(self) -> frozenset[str]:
        """Names of parameters in which predictions are linear by definition."""


class Made(Protocol):
    """Columns of each of some choices, made when they are asked for."""

    def of(self, place: int) -> FloatArray:
        """Those of one choice, (n, d)."""


@dataclass(frozen=True)
class Candidate:
    """A term that might be added: how the data would change with its parameters, starting from none of it.

    `columns` (n, d), or those of several choices of which this is one, at `place`. `typical` (d,) are plausible
    sizes. `scanned` more parameters of the term are fixed by the choice, and fitted or placed once it is in a model.
    `whole` gives what is spanned, (n, k), where columns by themselves mean nothing: of differences from one word, a
    column for every word, which with the model's spans the same.
    """

    term: Term
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: FloatArray | Made
    typical: FloatArray
    place: int = 0
    scanned: int = 0
    whole: Callable[[], FloatArray] | None = None

    @property
    def derivative(self) -> FloatArray:
        """At the current fit with the term's parameters at zero, in their own units, shape (n, d).

        What the choice fixes (the frequency of a line) is no parameter here.
        """
        return self.columns if isinstance(self.columns, np.ndarray) else self.columns.of(self.place)


@dataclass(frozen=True)
class NotTestable:
    """An effect that these data cannot be asked about, and why, in a sentence."""

    effect: str
    reason: str


@dataclass(frozen=True)
class Line:
    """A steady line in the samples that belongs to no harmonic of the drive: the term that would describe it.

    `p_value` is that of the power under noise, corrected for the frequencies tried; `held_out_error_ratio` after over
    before on the spectrum of held-out runs. `parameters` as in `rigctl diagnose --json`. A line that is `in_data`
    changes what models are fitted to, as effects do.
    """

    term: Term
    channel: str
    frequency_hz: float
    amplitude: float
    sigma: float
    unit: str
    p_value: float
    held_out_error_ratio: float
    parameters: Mapping[str, Mapping[str, Any]]
    in_data: bool = False


class Study(Protocol):
    """An experiment's recording, as the workbench sees it."""

    @property
    def experiment(self) -> str:
        """Its id, as in recording.toml."""

    def effects(self) -> Mapping[str, str]:
        """Every effect that can be added, in the order of the catalogue: id and the physics in a sentence."""

    def model(self, terms: Sequence[Term]) -> Model:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks, at the fitted `values`; a scanned one appears once per choice."""

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what is left of the samples; empty where the recording has no samples to look at."""

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """What the experiment is for, for the error ladder: by name, JSON with `value`, `sigma` and `unit`."""


@runtime_checkable
class HasBreaks(Protocol):
    """A study with effects that break the level, as noise that is correlated along an order seems to."""

    def breaks_level(self, effect: str, order: str) -> bool:
        """Whether an effect, by id, does so along `order`."""


@runtime_checkable
class SearchesSamples(Protocol):
    """A study that looks through all samples for what the data made of them do not show, and keeps what it finds."""

    def search_samples(self) -> None:
        """Do it now, while what was measured is at hand: whatever is asked next needs it."""


@runtime_checkable
class DeclaresInseparable(Protocol):
    """A study that knows beforehand which effects no data of its kind can tell from the baseline."""

    def inseparable(self) -> Mapping[str, tuple[str, ...]]:
        """By effect, the parameters of the baseline that take it up."""


@runtime_checkable
class DependsOnUnrecorded(Study, Protocol):
    """A study with effects that it cannot be asked about where a quantity they depend on was not recorded."""

    def unrecorded(self, model: Model, values: FloatArray) -> FloatArray:
        """What they could do to the data, whatever that quantity did; columns (n, k), none where all is recorded."""


@runtime_checkable
class ScansBetween(Study, Protocol):
    """A study whose scans have more to choose from than the values that are tried first."""

    def neighbours(self, term: Term) -> Mapping[str, tuple[float, float]]:
        """Between which positive values the scan leaves open what a choice really is, by name."""

    def candidate(self, model: Model, values: FloatArray, term: Term) -> Candidate:
        """An effect that `model` lacks with any values of its choice, at the fitted `values`."""


@runtime_checkable
class ScansWithin(Study, Protocol):
    """A study whose scans are of places that data may leave open: a delay, a time constant."""

    def within(self, term: Term) -> Mapping[str, tuple[float, float]]:
        """Between which positive values such a place is looked for, by the name in the term's choice."""


@runtime_checkable
class HoldsPlaces(Study, Protocol):
    """A study with parameters that a fit holds where they were found, such as the place of a step."""

    def placed(self, model: Model, terms: Sequence[Term], whiten: Callable[[FloatArray], FloatArray]) -> Model:
        """The model of these terms with such places where they fit best in noise that `whiten` makes independent, in
        which it tells how well they are known."""


@dataclass(frozen=True)
class Proposal:
    """A run, or a reading, that could be made next: `settings` by name, with units in the names.

    `takes_s` is rig time, turning, settling and arming included; NaN where nobody knows, so that one is like another.
    Runs of one `sitting` (a room's temperature) are made one after the other, after what takes `sitting_s` once.
    """

    settings: Mapping[str, Any]
    takes_s: float = float("nan")
    sitting: str = ""
    sitting_s: float = 0.0


Allowed = Callable[[Proposal], bool]
"""Whether the rig that measured can carry a proposal out."""


@runtime_checkable
class Plannable(Study, Protocol):
    """A study that can say what could be measured next, and what its models would predict there."""

    def options(self) -> Sequence[Proposal]:
        """What could be measured next."""

    def extended(self, proposals: Sequence[Proposal]) -> Study:
        """This study as if these runs had been made too, with noise as in the runs there are.

        Existing runs come first, then one run per proposal. Measured values of the latter mean nothing: only
        derivatives, sigmas and conditions do. Models keep their parameters' names.
        """


CourseKind = Literal[
    "repeats against time", "alternation of the room", "alternation of set-points", "more of the same"
]


@dataclass(frozen=True)
class Course:
    """Runs in this order and at the times in their settings (`start_s`): what is slow shows by when it is measured.

    Their `takes_s` has the waiting before each in it.
    """

    kind: CourseKind
    runs: tuple[Proposal, ...]


@runtime_checkable
class Scheduled(Plannable, Protocol):
    """A study that can say in which order, and when, runs could be made to tell effects from slow noise."""

    def courses(self) -> Sequence[Course]:
        """What there is to choose from, with "more of the same" to compare with."""
