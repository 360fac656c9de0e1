"""The readings of a `table` recording: columns over the rows that can be used, and what [table] says of them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rigctl.campaign.recording import READINGS, Header, RunSource, TableFlaw, TableSpec
from rigctl.core.arrays import FloatArray, IntArray, TextArray
from rigctl.core.errors import DataError
from rigctl.core.numbers import MAGNITUDE_MAX, measurable
from rigctl.core.readings import VALID, excluded_rows, row_label, seconds_of_stamps
from rigctl.core.units import unit_of_column
from rigctl.experiments.table.observe.column_order import in_order
from rigctl.experiments.table.observe.constants import known_inputs
from rigctl.experiments.table.observe.expression import Expression
from rigctl.experiments.table.observe.rows import readings_of
from rigctl.experiments.table.observe.syntax import CONSTANTS, flaw, leaves, names, parse
from rigctl.workbench.known_inputs import KnownInputs

_WINDOW_POINTS, _WINDOW_FINENESS = 1 << 16, 16
_WINDOW_LOW, _WINDOW_HIGH = 0.25, 0.5
_VALUES_OF_A_SMALL_CLUSTER = 8
_GUESSED_NOISE = 1e-4
"""Noise where none is declared, relative to the response's standard deviation."""
_NAME = re.compile(r"[^\W\d]\w*")
BLOCKS_MAX = 7
STRETCHES_MAX = 6


@dataclass(frozen=True)
class Column:
    """A column of numbers, shape (n,); NaN where a value is missing.

    Where a `clock` was set to zero means nothing: it is the column that orders the readings, or one of time stamps.
    `place` is its place in the file, which serves for names only: what is found does not depend on it.
    """

    name: str
    values: FloatArray
    unit: str
    clock: bool = False
    place: int = 0

    @cached_property
    def distinct(self) -> FloatArray:
        """Its different values, rising."""
        return np.unique(self.values)

    @property
    def span(self) -> float:
        """From its smallest to its largest value."""
        return float(self.distinct[-1] - self.distinct[0])

    @cached_property
    def mean(self) -> float:
        """Its mean."""
        return float(self.values.mean())

    @cached_property
    def spacing(self) -> float:
        """Median distance of neighbours among its different values."""
        return float(np.median(np.diff(self.distinct)))

    @cached_property
    def standard_deviation(self) -> float:
        """Its standard deviation."""
        return float(self.values.std())

    @cached_property
    def frequency_max(self) -> float:
        """The highest frequency that these values tell from its aliases.

        1 / (2 spacing); where the values form few and small clusters, 1 / (2 distance of the clusters), which is
        read off the spectral window: it falls below `_WINDOW_LOW` and returns to `_WINDOW_HIGH` at the first alias.
        """
        limit = 0.5 / self.spacing
        step = 0.25 / self.span
        count = min(int(2.0 * limit / step), _WINDOW_POINTS)
        # Values on a grid, so fine that phases are known to 0.2 rad at the highest frequency.
        places = np.rint((self.values - self.distinct[0]) * (step * _WINDOW_FINENESS * count))
        spikes = np.bincount(places.astype(np.intp), minlength=_WINDOW_FINENESS * count)
        window = np.abs(np.fft.rfft(spikes)[1 : count + 1] / self.values.size) ** 2
        frequencies = step * np.arange(1, count + 1)
        low = np.flatnonzero(window < _WINDOW_LOW)
        high = np.flatnonzero(window > _WINDOW_HIGH)
        alias = high[high > low[0]] if low.size else high
        if not alias.size:
            return limit
        sampling_frequency = float(frequencies[alias[0]])
        # Large clusters tell fast periods by what varies within each of them.
        crowded = self.distinct.size > _VALUES_OF_A_SMALL_CLUSTER * (self.span * sampling_frequency + 1.0)
        return limit if crowded else min(limit, 0.5 * sampling_frequency)


@dataclass(frozen=True)
class Category:
    """A column of words, shape (n,); "" where one is missing."""

    name: str
    values: TextArray

    @cached_property
    def levels(self) -> tuple[str, ...]:
        """Its different words, in alphabetical order."""
        return tuple(str(level) for level in np.unique(self.values) if level)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Readings at each level."""
        return tuple(int(np.sum(self.values == level)) for level in self.levels)

    @cached_property
    def codes(self) -> FloatArray:
        """The place of each reading's word among the levels, shape (n,); NaN where it is missing."""
        places = {level: float(place) for place, level in enumerate(self.levels)}
        return np.array([places.get(str(value), np.nan) for value in self.values])

    @property
    def names_groups(self) -> bool:
        """Whether its words sort the readings into groups, and are not a remark on each of them."""
        return 1 < len(self.levels) <= self.values.size // 2


@dataclass(frozen=True)
class Readings:
    """Rows with a response and all that the baseline needs; n of them, `labels` say which ("row 7")."""

    spec: TableSpec
    response: Column
    columns: dict[str, Column]
    categories: dict[str, Category]
    expression: Expression
    labels: tuple[str, ...]
    sigma: FloatArray
    """As stated by a column; else the same for all, the declared noise or a guess, whose size is in the scatter."""
    block_of: IntArray
    excluded: Mapping[str, str] = field(default_factory=dict)
    """Rows that are marked invalid, and why: they are not among the readings."""
    incomplete: Mapping[str, str] = field(default_factory=dict)
    """Rows that lack something of what the fit needs, and what: nor are these."""

    @property
    def numbers(self) -> dict[str, FloatArray]:
        """Every numeric column but the response, by name."""
        return {name: column.values for name, column in self.columns.items()}

    @property
    def given(self) -> dict[str, FloatArray | TextArray]:
        """Every column but the response, by name: numbers and words."""
        return {**self.numbers, **{name: category.values for name, category in self.categories.items()}}

    def baseline(
        self, values: FloatArray, shifts: Mapping[int, FloatArray] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """The expression with its parameters at `values` (m,): what it predicts, (n,), and derivatives, (n, m).

        `shifts` (n,) are added to some of the parameters, by their places.
        """
        given: dict[str, float | FloatArray] = dict(zip(self.expression.parameters, map(float, values), strict=True))
        for place, shift in (shifts or {}).items():
            name = self.expression.parameters[place]
            given[name] = given[name] + shift
        return self.evaluated(given)

    def evaluated(self, given: Mapping[str, float | FloatArray]) -> tuple[FloatArray, FloatArray]:
        """The expression with these values of its parameters by name, and its derivatives; (n,) and (n, m)."""
        n = self.response.values.size
        value, slopes = self.expression.evaluate(self.numbers, given)
        # Without any column of numbers an expression cannot know how many readings there are.
        return np.broadcast_to(value, (n,)).copy(), np.broadcast_to(slopes, (n, slopes.shape[1])).copy()

    @cached_property
    def known_inputs(self) -> tuple[KnownInputs, ...]:
        """The uncertain constants of the baseline."""
        return known_inputs(self.spec.constants)

    def with_constants(self, values: Mapping[str, float]) -> Readings:
        """The same readings with other values of some of the baseline's constants, by name."""
        constants = {**_values(self.spec), **values}
        return replace(self, expression=Expression.read(self.spec.baseline, self.expression.columns, constants))

    @property
    def order(self) -> Column | None:
        """The column that orders the readings; None when they are in no order that means anything."""
        return self.columns[self.spec.order] if self.spec.order else None


def read(source: RunSource) -> Readings:
    """The readings of a recording; `DataError` where its [table] does not fit them."""
    header, spec = source.header, source.header.table
    if spec is None:
        raise DataError(f"the recording is of {header.experiment}, not a table: it has no [table] to fit")
    # Time stamps are columns of seconds: they may order readings and be drifted along.
    numbers, texts, stamps = _columns(source)
    samples = {**numbers, **stamps}
    if spec.response not in samples:
        raise TableFlaw(f"no column {spec.response} of numbers, which [table] response names")
    _require_measurable(samples)
    _require_only_marks(samples, texts, spec)
    excluded = excluded_rows(samples, texts)
    samples.pop(VALID, None)
    _require_uncertainties(samples, spec, list(excluded))
    expression = _expression(spec, set(samples), set(texts))
    _require_one_role(spec, expression.columns)
    others = (name for name in (spec.order, spec.sigma) if name)
    needed = list(dict.fromkeys((spec.response, *expression.columns, *others)))
    incomplete = _incomplete(samples, needed, excluded)
    places = {name: place for place, name in enumerate(samples)}
    samples, texts = in_order(samples, texts, spec.response, expression.columns, list(excluded))
    # Only what the baseline needs must be there: an effect that needs more says so when it is asked about.
    rows = readings_of(samples, texts, spec.response, spec.order, needed, list(excluded))
    if rows.size == 0:
        which = "valid row" if excluded else "row"
        raise TableFlaw(f"no {which} has a response and all that the baseline needs; fill in the gaps")
    columns = {
        name: Column(
            name,
            values[rows].astype(np.float64),
            "s" if name in stamps else _unit(header, name),
            clock=name in stamps or name == spec.order,
            place=places[name],
        )
        for name, values in samples.items()
    }
    response = columns.pop(spec.response)
    batches = [name for name in spec.batch if name in columns]
    numbered = {name: Category(name, _digits(columns.pop(name).values)) for name in batches}
    stated = columns.pop(spec.sigma).values if spec.sigma else None
    if rows.size > 1 and not response.standard_deviation > np.finfo(float).tiny:
        raise TableFlaw(
            f"column {spec.response} is the same in every row; name a response that changes, or write"
            " it with more digits or in a smaller unit"
        )
    # A number that names a batch is a word: its size means nothing.
    categories = {name: Category(name, np.array(text, dtype=np.str_)[rows]) for name, text in texts.items()}
    categories |= numbered
    return Readings(
        spec,
        response,
        columns,
        categories,
        expression,
        tuple(map(row_label, rows)),
        np.full(rows.size, _weight(header, response)) if stated is None else stated,
        _blocks(spec, columns, categories, rows.size),
        {row_label(row): reason for row, reason in excluded.items()},
        incomplete,
    )


def _incomplete(
    samples: Mapping[str, FloatArray], needed: Sequence[str], excluded: Collection[int]
) -> dict[str, str]:
    """By row, what it lacks of the columns that are needed."""
    missing = ~np.isfinite([samples[name] for name in needed])
    rows = np.flatnonzero(missing.any(axis=0)).tolist()
    return {
        row_label(row): ", ".join(name for name, lacks in zip(needed, missing[:, row], strict=True) if lacks)
        for row in rows
        if row not in excluded
    }


def _digits(values: FloatArray) -> TextArray:
    """Numbers as words: the shortest digits that tell each from all others, so that 20240115 is not 20240116."""
    return np.array([np.format_float_positional(each, trim="-") for each in values])


def _columns(source: RunSource) -> tuple[dict[str, FloatArray], dict[str, Sequence[str]], dict[str, FloatArray]]:
    """Columns of numbers, of words, and of time stamps in seconds."""
    record = source.run(READINGS)
    if record is None:
        raise DataError("there are no readings in it; import the table again")
    if not record.valid:
        raise DataError(f"the readings are declared invalid ({record.reason}); mark them valid to use them")
    conditions = record.conditions
    seconds = {name: seconds_of_stamps(texts) for name, texts in conditions.items()}
    words = {name: texts for name, texts in conditions.items() if seconds[name] is None}
    return source.samples(READINGS), words, {name: each for name, each in seconds.items() if each is not None}


def _require_measurable(samples: dict[str, FloatArray]) -> None:
    """`DataError` for a number that is infinite, or whose powers are: a fit would drop it, or break on it."""
    for name, values in samples.items():
        if not measurable(values):
            row = int(np.argmax(np.abs(np.nan_to_num(values, nan=0.0)) > MAGNITUDE_MAX))
            raise TableFlaw(
                f"column {name} holds {values[row]:g}, which nobody can have measured;"
                " mend it, or leave a missing value empty",
                row=row,
            )


def _require_only_marks(
    samples: Mapping[str, FloatArray], texts: Mapping[str, Sequence[str]], spec: TableSpec
) -> None:
    """`DataError` where a column says which readings count and is used as a quantity too, or holds anything else."""
    marks = samples.get(VALID)
    if marks is None and VALID not in texts:
        return
    said = f"column {VALID} says which readings count (1 or 0)"
    mend = "give a column that says anything else another name"
    if marks is None or not np.isin(marks[~np.isnan(marks)], (0.0, 1.0)).all():
        raise TableFlaw(f"{said}, and holds other values; {mend}")
    named = {"response": spec.response, "order": spec.order, "block": spec.block, "sigma": spec.sigma}
    for key, name in (*named.items(), *(("batch", name) for name in spec.batch)):
        if name == VALID:
            raise TableFlaw(f"[table] {key}: {said}; {mend}", ("table", key))
    tree = parse(spec.baseline)
    if VALID in names(tree):
        raise flaw(next(leaf.at for leaf in leaves(tree) if leaf.name == VALID), f"{said}; {mend}")


def _require_one_role(spec: TableSpec, baseline: Sequence[str]) -> None:
    """`DataError` where a column is a quantity and something else at once.

    The response is explained, an uncertainty weighs, and a number that names a batch is a word: none of them is a
    condition as well.
    """
    roles: dict[str, Sequence[str | None]] = {
        "response": [spec.response],
        "sigma": [spec.sigma],
        "batch": spec.batch,
        "baseline": baseline,
        "order": [spec.order],
        "block": [spec.block],
    }
    for key, other in itertools.product(("response", "sigma", "batch"), roles):
        # Readings that share an offset may well be held out together.
        if key == other or (key, other) == ("batch", "block"):
            continue
        for name in roles[key]:
            if name is not None and name in roles[other]:
                raise TableFlaw(
                    f"[table] {key}: column {name} is named by its {other} too, and cannot be both; name another"
                    " column, or a copy of it",
                    ("table", key),
                )


def _require_uncertainties(samples: dict[str, FloatArray], spec: TableSpec, excluded: Sequence[int]) -> None:
    """`DataError` for a stated uncertainty that is none."""
    if spec.sigma is None:
        return
    if spec.sigma not in samples:
        raise TableFlaw(f"no column {spec.sigma} of numbers, which [table] sigma names")
    if (wrong := np.setdiff1d(np.flatnonzero(samples[spec.sigma] <= 0.0), excluded)).size:
        raise TableFlaw(
            f"column {spec.sigma} holds {samples[spec.sigma][wrong[0]]:g}, which is no standard uncertainty; write a"
            " positive one, or leave it empty to leave the reading out",
            row=int(wrong[0]),
        )


def _require_names(baseline: str, columns: set[str]) -> None:
    """`DataError` where a baseline has the name of a column that an expression would read as several: `load-kN`."""
    for column in columns:
        parts = set(_NAME.findall(column))
        found = re.search(rf"(?<!\w){re.escape(column)}(?!\w)", baseline)
        if found and not _NAME.fullmatch(column) and not parts <= columns:
            raise flaw(
                found.start(),
                f"column {column} cannot be named: names in a baseline are letters, digits and _; rename the column",
            )


def _expression(spec: TableSpec, numeric: set[str], texts: set[str]) -> Expression:
    _require_names(spec.baseline, numeric | texts)
    _require_constants(spec, numeric | texts)
    expression = Expression.read(spec.baseline, numeric, _values(spec))
    for name in CONSTANTS:
        if name in numeric:
            raise TableFlaw(f"column {name} has the name of a constant; rename the column")
    for name in expression.columns + expression.parameters:
        if name == spec.response:
            raise flaw(expression.position(name), f"{name} is the response; it cannot stand on the right side too")
        if name in texts:
            raise flaw(expression.position(name), f"column {name} holds text; use a column of numbers")
    if not expression.parameters:
        raise flaw(0, "no parameter to fit; write one, such as b0, a name that is no column")
    for name in spec.start:
        if name not in expression.parameters:
            raise TableFlaw(
                f"[table] start: {name} is no parameter of the baseline;"
                f" its parameters are {', '.join(expression.parameters)}",
                ("table", "start", name),
            )
    return expression


def _values(spec: TableSpec) -> dict[str, float]:
    """The constants of the baseline by name."""
    return {name: constant.value for name, constant in spec.constants.items()}


def _require_constants(spec: TableSpec, columns: set[str]) -> None:
    """`DataError` for a constant that the baseline cannot have, or has not."""
    used = names(parse(spec.baseline)) if spec.constants else ()
    for name in spec.constants:
        if name in columns or name in CONSTANTS:
            what = "is a column of readings.csv" if name in columns else "has its value already"
            raise TableFlaw(
                f"[table.constants]: {name} {what}; give the constant another name", ("table", "constants", name)
            )
        if name not in used:
            raise TableFlaw(
                f"[table.constants]: {name} is not in the baseline; write it there, or leave it out",
                ("table", "constants", name),
            )


def _unit(header: Header, name: str) -> str:
    declared = header.channels.get(name)
    return declared.unit if declared and declared.unit else unit_of_column(name)


def declares_noise(header: Header, response: str) -> bool:
    """Whether recording.toml gives the noise of the response."""
    declared = header.channels.get(response)
    return bool(declared and declared.noise_rms)


def _weight(header: Header, response: Column) -> float:
    declared = header.channels.get(response.name)
    declared_rms = declared.noise_rms if declared else None
    # The last resort keeps sigmas above zero for a response that is the same everywhere.
    return declared_rms or _GUESSED_NOISE * response.standard_deviation or 1.0


def _blocks(spec: TableSpec, columns: dict[str, Column], categories: dict[str, Category], rows: int) -> IntArray:
    if spec.block is not None:
        column = categories[spec.block] if spec.block in categories else columns[spec.block]
        blocks = np.unique(column.values, return_inverse=True)[1]
        if blocks.max() == 0:
            raise TableFlaw(
                f"column {spec.block} holds one value only, but [table] block needs two blocks or more;"
                " name another column, or leave block out"
            )
        return np.asarray(blocks, dtype=np.intp)
    if spec.order is not None:
        # Ranks: stretches of equal numbers of readings, whatever the gaps between them.
        place = np.argsort(np.argsort(columns[spec.order].values, kind="stable"), kind="stable")
        return np.asarray(place * min(STRETCHES_MAX, max(rows // 2, 1)) // rows, dtype=np.intp)
    # Rows are sorted by their contents, so every seventh has its share of all conditions.
    return np.asarray(np.arange(rows) % min(BLOCKS_MAX, max(rows // 2, 1)), dtype=np.intp)
