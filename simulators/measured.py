"""What the simulated instruments really measured, before any fault of a wire: for trials that hold stores to it.

    kept = rig.simulation.measured.keep()        in this process
    [world] measured = "FILE"                    the same, one JSON object per line
    rigctl simulate RIG --measured FILE          on a served rig

It never enters a store, and nothing that analyses one reads it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rigctl.core.arrays import FloatArray


@dataclass(frozen=True)
class Measurement:
    """Some values of one quantity in the unit of its column, NaN where the instrument had none."""

    instrument: str
    channel: str
    """The run's column; a quantity that is no column has the instrument's own name for it.

    `true COLUMN` is where a stage really is, whatever its controller believes: a reference may have been lost.
    `fault KEY` tells that a fault of the instrument's plan strikes: when, and the number of the reply, if it was one.
    """
    run: int | None
    """As the operator announced it last; None before the first."""
    record: int
    """Counts what the instrument recorded since it was made: one arming, one acquisition."""
    at_s: FloatArray
    """Rig time of each value; of telemetry the time it carries."""
    values: FloatArray


Listener = Callable[[Measurement], None]


class Measured:
    """Hands on what the instruments of one rig measure; costs nothing while nobody listens."""

    def __init__(self) -> None:
        self.run: int | None = None
        self._listeners: list[Listener] = []

    @property
    def heard(self) -> bool:
        """True when somebody listens."""
        return bool(self._listeners)

    def listen(self, listener: Listener) -> None:
        """Call `listener` with every measurement from now on, under the clock's lock."""
        self._listeners.append(listener)

    def keep(self) -> list[Measurement]:
        """A list that fills from now on."""
        kept: list[Measurement] = []
        self.listen(kept.append)
        return kept

    def tell(self, measurement: Measurement) -> None:
        """Hand it to all who listen."""
        for listener in self._listeners:
            listener(measurement)

    def tap(self, instrument: str, columns: Mapping[str, str] | None = None) -> Tap:
        """For one instrument; `columns` by its own names for what it measures."""
        return Tap(self, instrument, columns or {})


class Tap:
    """Where one instrument says what it measured."""

    def __init__(self, measured: Measured, instrument: str, columns: Mapping[str, str]) -> None:
        self._measured = measured
        self._instrument = instrument
        self._columns = columns
        self._record = 0

    @property
    def heard(self) -> bool:
        """True when somebody listens: what is worked out for `note` alone need not be otherwise."""
        return self._measured.heard

    def begin(self) -> None:
        """A new record."""
        self._record += 1

    def note(self, quantity: str, at_s: ArrayLike, values: ArrayLike) -> None:
        """These values were measured; what is not finite is no value."""
        if not self.heard:
            return
        given = np.atleast_1d(np.asarray(values, dtype=np.float64))
        if not given.size:
            return
        self._measured.tell(
            Measurement(
                self._instrument,
                self._columns.get(quantity, quantity),
                self._measured.run,
                self._record,
                # Copies, of times and values: what an instrument tells from may be memory it uses again.
                np.atleast_1d(np.array(at_s, dtype=np.float64)),
                np.where(np.isfinite(given), given, np.nan),
            )
        )


def unheard() -> Tap:
    """For an instrument of which nobody wants to know."""
    return Measured().tap("")


def into_file(path: Path) -> Listener:
    """Appends each measurement as a line, so that a killed process leaves all but the last; `OSError`."""
    # At once, so that a name that cannot be written is told before anything is measured.
    path.open("a", encoding="ascii").close()

    def write(measurement: Measurement) -> None:
        fields = {**vars(measurement), "at_s": measurement.at_s.tolist(), "values": _with_nulls(measurement.values)}
        # Opened for every line: nothing waits in a buffer when the process is killed.
        with path.open("a", encoding="ascii") as file:
            file.write(json.dumps(fields) + "\n")

    return write


def from_file(path: Path) -> Iterator[Measurement]:
    """What `into_file` wrote; a line that a kill has cut is left out, as nothing had been read from it."""
    with path.open(encoding="ascii") as file:
        for line in file:
            if line.endswith("\n"):
                fields = json.loads(line)
                numbers = {key: np.array(fields[key], dtype=np.float64) for key in ("at_s", "values")}
                yield Measurement(**{**fields, **numbers})


def joined(measurements: Iterable[Measurement]) -> list[Measurement]:
    """The pieces of each record put together in order of time; what was read twice counts once."""
    pieces: dict[tuple[str, str, int | None, int], list[Measurement]] = {}
    for each in measurements:
        pieces.setdefault((each.instrument, each.channel, each.run, each.record), []).append(each)
    return [_whole(of_one) for of_one in pieces.values()]


def _whole(pieces: list[Measurement]) -> Measurement:
    at_s, first = np.unique(np.concatenate([each.at_s for each in pieces]), return_index=True)
    return replace(pieces[0], at_s=at_s, values=np.concatenate([each.values for each in pieces])[first])


def _with_nulls(values: FloatArray) -> list[float | None]:
    # JSON has no NaN.
    return [None if value != value else value for value in values.tolist()]
