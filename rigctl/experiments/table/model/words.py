"""Effects that are different for each word of a column: levels, slopes, parameters of the baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.units import ratio
from rigctl.experiments.table.model.form import PLAIN, Choice, Form, Spans, TableEffect
from rigctl.experiments.table.observe.readings import Category, Column

# A level of one reading would fit it exactly; a slope stands beside a level and needs as many again.
_READINGS_OF_A_LEVEL, _READINGS_OF_A_SLOPE = 2, 4
# A choice: every word has a number of its own, for the model has none that the first could be counted from.
_EACH = "each"


@dataclass(frozen=True)
class Level(Form):
    """One number for each level of a column of words but the first, which it is counted from: `level[C]`.

    Where the model has no constant that the first could be, it has a number of its own.
    """

    category: Category

    @property
    def id(self) -> str:
        """As in commands."""
        return f"level[{self.category.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something is different for each {self.category.name}."

    @property
    def family(self) -> str:
        """With all that may differ by these words."""
        return f"by {self.category.name}"

    def untestable(self) -> str:
        """Why not, or ""."""
        return _untestable(self.category, _READINGS_OF_A_LEVEL)

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """What a level has more than the first, such as .B-A; of each of them, such as .A."""
        return of_each(self.category) if choice.get(_EACH) else beyond_first(self.category)

    def choices(self, spans: Spans) -> list[Choice]:
        """From the first, or each by itself."""
        return [PLAIN if spans(np.ones(self.category.values.size)) else {_EACH: 1.0}]

    def settled(self, choice: Choice, spans: Spans) -> Choice:
        """By what the model has now: terms come and go beside it."""
        del choice
        return self.choices(spans)[0]

    def of_each_word(self, choice: Choice) -> Choice:
        """The choice in which every word has a number of its own."""
        return {**choice, _EACH: 1.0}

    def basis(self, choice: Choice) -> FloatArray:
        """1 where a reading is of the level, shape (n, levels - 1) or (n, levels)."""
        return _of_words(self.category, choice)

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return [np.ones(self.category.values.size)]


@dataclass(frozen=True)
class Slope(Form):
    """A slope of C for each word of W but the first, which it is counted from: `slope[C by W]`.

    Where the model has no slope of C that the first could be, it has one of its own. Where the model has no levels of
    W it turns about C = 0 (of a clock: the first reading) or about the mean of C, whichever shows more.
    """

    column: Column
    category: Category

    @property
    def id(self) -> str:
        """As in commands."""
        return f"slope[{self.column.name} by {self.category.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"What {self.column.name} does is different for each {self.category.name}."

    @property
    def columns(self) -> tuple[Column, ...]:
        """The one of numbers."""
        return (self.column,)

    @property
    def family(self) -> str:
        """With all that may differ by these words."""
        return f"by {self.category.name}"

    def untestable(self) -> str:
        """Why not, or ""."""
        if reason := _untestable(self.category, _READINGS_OF_A_SLOPE):
            return reason
        for level in self.category.levels:
            if np.ptp(self.column.values[self.category.values == level]) == 0.0:
                return f"{self.column.name} is the same wherever {self.category.name} is {level}"
        return ""

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """What a word has more than the first, such as .B-A; of each of them, such as .A."""
        return of_each(self.category) if choice.get(_EACH) else beyond_first(self.category)

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over the column's."""
        return (ratio(response, self.column.unit),) * len(self.names(choice))

    def choices(self, spans: Spans) -> list[Choice]:
        """As in the column; about its mean, where the words share a crossing there."""
        return [self.settled({}, spans), self.settled({"origin": self.column.mean}, spans)]

    def settled(self, choice: Choice, spans: Spans) -> Choice:
        """By what the model has now: terms come and go beside it."""
        origin = {name: value for name, value in choice.items() if name != _EACH}
        if self.column.clock and not origin and not all(map(spans, self.trivial())):
            origin = {"origin": float(self.column.distinct[0])}
        whole = self.column.values - origin.get("origin", 0.0)
        return origin if spans(whole) else {**origin, _EACH: 1.0}

    def of_each_word(self, choice: Choice) -> Choice:
        """The choice in which every word has a number of its own."""
        return {**choice, _EACH: 1.0}

    def basis(self, choice: Choice) -> FloatArray:
        """C where a reading is of the word, shape (n, words - 1) or (n, words)."""
        return (self.column.values - choice.get("origin", 0.0))[:, None] * _of_words(self.category, choice)

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By the distance from the column's mean, so that nothing cancels."""
        inside, mean = _of_words(self.category, choice), self.column.mean
        return [(mean - choice.get("origin", 0.0)) * inside, (self.column.values - mean)[:, None] * inside]

    def trivial(self) -> list[FloatArray]:
        """Levels of the words."""
        return list(_of_words(self.category, {_EACH: 1.0}).T)


@dataclass(frozen=True)
class Group(TableEffect):
    """A parameter P of the baseline for each word of W but the first, which it is counted from: `group[P by W]`."""

    parameter: str
    place: int
    """Of the parameter in the baseline."""
    category: Category

    @property
    def id(self) -> str:
        """As in commands."""
        return f"group[{self.parameter} by {self.category.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"The baseline's {self.parameter} is different for each {self.category.name}."

    @property
    def family(self) -> str:
        """With all that may differ by these words."""
        return f"by {self.category.name}"

    def untestable(self) -> str:
        """Why not, or ""."""
        return _untestable(self.category, _READINGS_OF_A_SLOPE)

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """What a word has more than the first, such as .B-A."""
        del choice
        return beyond_first(self.category)

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """The baseline's are not known: ""."""
        del response
        return ("",) * len(self.names(choice))

    def of_each_word(self, slopes: FloatArray) -> FloatArray:
        """The same for every word, shape (n, words)."""
        return slopes[:, [self.place]] * _of_words(self.category, {_EACH: 1.0})

    def derivative(self, slopes: FloatArray) -> FloatArray:
        """Where the baseline has the derivatives `slopes` (n, m), shape (n, words - 1)."""
        return slopes[:, [self.place]] * indicators(self.category)

    def shift(self, values: FloatArray) -> FloatArray:
        """What is added to the parameter in each reading, shape (n,)."""
        return np.asarray(indicators(self.category) @ values)


def indicators(category: Category) -> FloatArray:
    """1 where a reading is of a word, shape (n, words - 1); the first word has none."""
    return np.asarray(category.codes[:, None] == np.arange(1, len(category.levels)), dtype=np.float64)


def beyond_first(category: Category) -> tuple[str, ...]:
    """What a word has more than the first, such as .B-A."""
    # The first word has no number of its own: the baseline's constant is there already.
    first, *others = category.levels
    return tuple(f".{level}-{first}" for level in others)


def of_each(category: Category) -> tuple[str, ...]:
    """Of every word, such as .A."""
    return tuple(f".{level}" for level in category.levels)


def _of_words(category: Category, choice: Choice) -> FloatArray:
    """1 where a reading is of a word, shape (n, words - 1), or (n, words) where each has its own number."""
    if not choice.get(_EACH):
        return indicators(category)
    return np.asarray(category.codes[:, None] == np.arange(len(category.levels)), dtype=np.float64)


def _untestable(category: Category, least: int) -> str:
    """Why readings cannot be sorted by words of which each must stand in `least` of them; "" when they can."""
    name, levels, counts = category.name, category.levels, category.counts
    if missing := np.count_nonzero(category.values == ""):
        return f"{name} has no value in {missing} readings"
    if len(levels) == 1:
        return f"{name} is {levels[0]} in all readings"
    if not category.names_groups:
        return f"{name} takes {len(levels)} different values in {sum(counts)} readings: too many for levels"
    rare = [level for level, count in zip(levels, counts, strict=True) if count < least]
    return f"{name} is {rare[0]} in fewer than {least} readings" if rare else ""
