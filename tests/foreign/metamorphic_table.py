"""Random tables, and changes of them that must change nothing of what is found.

A table knows its columns and words by roles; what they are called, what they are multiplied by and where they are
counted from can be changed without the roles, so that the answers about two tables can be held side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Powers = Mapping[str, float]
"""Exponents of columns by role: of what a number is a product, its unit."""

RESPONSE = "y"
SUFFIXES = {
    RESPONSE: "_v",
    "a": "_n",
    "b": "_c",
    "c": "_hpa",
    "t": "_s",
    "u": "_v",
    "lot": "",
    "head": "",
    "kind": "",
}
STEMS = ("pull", "room", "air", "clock", "known", "shift", "zone", "arm", "gauge", "mark", "post", "rank")


@dataclass(frozen=True)
class Table:
    """Columns by role, `numbers` (n,) as written and `words` as places among their `labels`.

    `scale` is what a column was multiplied by, `offset` what was then added. The baseline is a template of roles;
    `start` gives starting values and `units` what each of its parameters is a product of.
    """

    numbers: Mapping[str, Floats]
    words: Mapping[str, Ints]
    labels: Mapping[str, tuple[str, ...]]
    names: Mapping[str, str]
    baseline: str
    units: Mapping[str, Powers]
    hidden: str
    start: Mapping[str, float] = field(default_factory=dict)
    order: str | None = None
    sigma: str | None = None
    batch: tuple[str, ...] = ()
    scale: Mapping[str, float] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        return len(self.numbers[RESPONSE])

    def size(self, powers: Powers) -> float:
        """What a number that is such a product was multiplied by."""
        return float(np.prod([self.scale.get(role, 1.0) ** power for role, power in powers.items()]))

    def recording(self) -> Recording:
        """As a recording in memory."""
        names = self.names
        spec = {
            "response": names[RESPONSE],
            "baseline": self.baseline.format(**names),
            "start": {name: value * self.size(self.units[name]) for name, value in self.start.items()},
            "order": self.order and names[self.order],
            "sigma": self.sigma and names[self.sigma],
            "batch": [names[role] for role in self.batch],
        }
        header = Header("table", extra={"table": {key: value for key, value in spec.items() if value}})
        texts = {names[role]: [self.labels[role][place] for place in places] for role, places in self.words.items()}
        run = RunRecord(READINGS, READINGS, "import", texts)
        columns = {names[role]: values for role, values in self.numbers.items()}
        return Recording(header, (run,), {READINGS: columns}, ImportReport(1))


Change = Callable[[Table, np.random.Generator], Table]


def rows_shuffled(table: Table, random: np.random.Generator) -> Table:
    """The rows in another order."""
    places = random.permutation(table.rows)
    numbers = {role: values[places] for role, values in table.numbers.items()}
    return replace(table, numbers=numbers, words={role: each[places] for role, each in table.words.items()})


def columns_permuted(table: Table, random: np.random.Generator) -> Table:
    """The columns in another order."""
    numbers, words = (
        [each[place] for place in random.permutation(len(each))] for each in map(list, (table.numbers, table.words))
    )
    return replace(
        table,
        numbers={role: table.numbers[role] for role in numbers},
        words={role: table.words[role] for role in words},
    )


def words_renamed(table: Table, random: np.random.Generator) -> Table:
    """Other words for the same groups, in another alphabetical order."""
    labels = {}
    for role, words in table.labels.items():
        letters = random.choice(list("abcdefghijklmnopqrstuvwxyz"), len(words), replace=False)
        labels[role] = tuple(f"{letter}{place}" for place, letter in enumerate(letters))
    return replace(table, labels=labels)


def columns_renamed(table: Table, random: np.random.Generator) -> Table:
    """Other names with the same suffix."""
    stems = random.permutation(STEMS)
    names = {role: f"{stem}{SUFFIXES[role]}" for role, stem in zip(table.names, stems, strict=False)}
    return replace(table, names=names)


def columns_scaled(table: Table, random: np.random.Generator) -> Table:
    """Every column in another unit; what is stated in the response's goes with it."""
    scale = {role: float(10.0 ** random.uniform(-3.0, 3.0)) for role in table.numbers}
    if table.sigma:
        scale[table.sigma] = scale[RESPONSE]
    numbers = {role: values * scale[role] for role, values in table.numbers.items()}
    return replace(table, numbers=numbers, scale={role: scale[role] * table.scale.get(role, 1.0) for role in scale})


def clock_shifted(table: Table, random: np.random.Generator) -> Table:
    """The time that orders the readings counted from another zero."""
    numbers = dict(table.numbers)
    numbers["t"] = numbers["t"] + float(np.round(random.uniform(0.5, 20.0) * np.ptp(numbers["t"])))
    return replace(table, numbers=numbers)


CHANGES: Mapping[str, Change] = {
    "rows": rows_shuffled,
    "columns": columns_permuted,
    "words": words_renamed,
    "names": columns_renamed,
    "scale": columns_scaled,
}
"""After which everything is the same, sizes in other units."""

CONSTANT = "b0"
"""The parameter that is added to everything, in those baselines that have one."""

BASELINES: Mapping[str, tuple[str, Mapping[str, Powers]]] = {
    "constant": ("b0", {"b0": {RESPONSE: 1}}),
    "line": ("b0 + b1 * {a}", {"b0": {RESPONSE: 1}, "b1": {RESPONSE: 1, "a": -1}}),
    "proportion": ("b1 * {a}", {"b1": {RESPONSE: 1, "a": -1}}),
    "saturation": ("vm * {a} / (km + {a})", {"vm": {RESPONSE: 1}, "km": {"a": 1}}),
}

HIDDEN = (
    "nothing", "nothing", "linear", "square", "product", "period", "step", "decay", "words", "slopes", "logarithm",
)  # fmt: skip


def drawn(seed: int) -> Table:
    """One table of 30 to 60 rows, something hidden in it or nothing, of 5 to 30 sigma."""
    random = np.random.default_rng([14, seed])
    rows = int(random.integers(30, 61))
    numbers: dict[str, Floats] = {"a": np.round(random.uniform(1.0, 10.0, rows), 4)}
    if random.random() < 0.6:
        numbers["b"] = np.round(random.normal(22.0, 1.5, rows), 2)
    if random.random() < 0.4:
        numbers["c"] = np.round(random.lognormal(0.0, 0.5, rows), 4)
    order = None
    if random.random() < 0.5:
        numbers["t"] = np.round(np.cumsum(random.exponential(10.0, rows)), 1)
        order = "t" if random.random() < 0.6 else None
    words: dict[str, Ints] = {}
    if random.random() < 0.5:
        words["head"] = random.permutation(np.arange(rows) % int(random.integers(2, 5)))
    if random.random() < 0.2:
        words["lot"] = random.permutation(np.arange(rows) % int(random.integers(6, 11)))
    form = str(random.choice(list(BASELINES), p=[0.3, 0.4, 0.15, 0.15]))
    baseline, units = BASELINES[form]
    hidden = str(random.choice(HIDDEN))
    noise = np.full(rows, 0.1)
    if stated := random.random() < 0.25:
        noise = np.round(random.uniform(0.05, 0.2, rows), 4)
    signal = _signal(form, numbers["a"])
    effect = _effect(hidden, numbers, words, random)
    strength = float(np.linalg.norm((effect - effect.mean()) / noise))
    size = random.uniform(5.0, 30.0) / strength if strength > 0.0 else 0.0
    response = signal + size * effect + noise * random.normal(size=rows)
    if "lot" in words:
        response = response + 0.15 * random.normal(size=rows)[words["lot"]]
    columns = {RESPONSE: np.round(response, 6), **numbers, **({"u": noise} if stated else {})}
    return Table(
        numbers=columns,
        words=words,
        labels={
            role: tuple(f"{role[0].upper()}{place}" for place in np.unique(each)) for role, each in words.items()
        },
        names={role: f"{role}{SUFFIXES[role]}" for role in (*columns, *words)},
        baseline=baseline,
        units=units,
        hidden=hidden if size else "nothing",
        start={"vm": 4.0, "km": 3.0} if form == "saturation" else {},
        order=order,
        sigma="u" if stated else None,
        batch=("lot",) if "lot" in words and random.random() < 0.5 else (),
    )


def _signal(form: str, a: Floats) -> Floats:
    made = {
        "constant": np.full(a.size, 3.0),
        "line": 3.0 + 0.4 * a,
        "proportion": 0.7 * a,
        "saturation": 4.0 * a / (3.0 + a),
    }
    return np.asarray(made[form])


def _effect(
    hidden: str, numbers: Mapping[str, Floats], words: Mapping[str, Ints], random: np.random.Generator
) -> Floats:
    """What is hidden, of any size, (n,); zero where the table has no column for it."""
    a = numbers["a"]
    column = numbers[str(random.choice(sorted(numbers)))]
    low, span = column.min(), np.ptp(column)
    group = words.get("head", np.zeros(a.size, dtype=np.intp)).astype(np.float64)
    made = {
        "nothing": 0.0 * a,
        "linear": column,
        "square": (column - low) ** 2,
        "product": (a - a.mean()) * (column - column.mean()),
        "period": np.sin(2.0 * np.pi * random.uniform(1.5, 6.0) * (column - low) / span + 1.0),
        "step": (column > low + random.uniform(0.3, 0.7) * span).astype(np.float64),
        "decay": np.exp(-(column - low) / (0.2 * span)),
        "words": np.array([0.0, 1.0, -0.6, 0.3])[group.astype(np.intp)],
        "slopes": group * (column - column.mean()),
        "logarithm": np.log(column),
    }
    return np.asarray(made[hidden])
