"""What is worked out from samples is worked out once, and kept beside them by a store that can.

A recipe names how: its version is counted up whenever other numbers would come out, its settings are whatever else
they depend on. Nothing kept is relied on: what is missing, damaged or in another form is made again.
"""

from __future__ import annotations

import io
import json
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from rigctl.core.errors import DataError

_LEFT_OUT = "left out"
_MAGIC = b"RIGKEPT1"
# Checksum of all that follows; how long the description is, in a whole number of so many bytes.
_START, _LENGTH, _ALIGNED = struct.Struct("<8sI"), struct.Struct("<I"), 16
# What numpy, zip and JSON raise for bytes that `to_bytes` did not make.
_UNREADABLE = (ValueError, TypeError, LookupError, EOFError, OSError, BadZipFile, zlib.error, struct.error)

Progress = Callable[[int, int], None]
"""Called with the number of runs reduced so far, and of all there are to reduce."""


@runtime_checkable
class KeepsReductions(Protocol):
    """A source of runs that keeps what was worked out from their samples, by recipe and name."""

    @property
    def readonly(self) -> bool:
        """Whether it can be read only."""

    def reduction(self, recipe: str, name: str) -> bytes | None:
        """What is kept under one name; None for nothing."""

    def keep_reductions(self, recipe: str, blobs: Mapping[str, bytes]) -> None:
        """Keep, by run_id or another name; replaces what was there."""


class Run(Protocol):
    """A run that has a name."""

    @property
    def run_id(self) -> str:
        """Its name in the recording."""


RunT = TypeVar("RunT", bound=Run)
T = TypeVar("T")


@dataclass(frozen=True)
class Recipe:
    """How something is worked out; `compressed` where its arrays repeat themselves."""

    name: str
    version: int
    settings: tuple[float | str, ...] = ()
    compressed: bool = False

    def __str__(self) -> str:
        """The text under which a store keeps what comes out."""
        return " ".join(map(str, (self.name, self.version, *self.settings)))


@dataclass(frozen=True)
class Packed:
    """A value to keep: `head` is what JSON can hold, `arrays` stay as they are bit for bit."""

    head: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def to_bytes(self, *, compressed: bool = False) -> bytes:
        """The arrays one behind the other, with what they are before them; `compressed` as one file of numpy's."""
        if compressed:
            file = io.BytesIO()
            head: NDArray[Any] = np.frombuffer(json.dumps(self.head).encode(), dtype=np.uint8)
            arrays: dict[str, Any] = {**self.arrays, "head": head}
            np.savez_compressed(file, **arrays)
            return file.getvalue()
        shapes = [(name, each.dtype.str, each.shape) for name, each in self.arrays.items()]
        text = json.dumps([self.head, shapes]).encode()
        # A file of numpy's takes ten times as long to read, which thousands of runs show.
        body = b"".join(
            [_LENGTH.pack(len(text)), text.ljust(-(-len(text) // _ALIGNED) * _ALIGNED)]
            + [np.ascontiguousarray(each).tobytes() for each in self.arrays.values()]
        )
        return _START.pack(_MAGIC, zlib.crc32(body)) + body

    @classmethod
    def from_bytes(cls, data: bytes) -> Packed:
        """What `to_bytes` was given; any of `_UNREADABLE` for other bytes."""
        if data[: len(_MAGIC)] == _MAGIC:
            return cls._from_rows(data)
        # A store may come from another laboratory: unpickling would run code that it carries.
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return cls(json.loads(bytes(arrays.pop("head"))), arrays)

    @classmethod
    def _from_rows(cls, data: bytes) -> Packed:
        _, told = _START.unpack_from(data)
        if zlib.crc32(memoryview(data)[_START.size :]) != told:
            raise ValueError("not as it was written")
        (length,) = _LENGTH.unpack_from(data, _START.size)
        place = _START.size + _LENGTH.size
        head, shapes = json.loads(data[place : place + length])
        place += -(-length // _ALIGNED) * _ALIGNED
        arrays: dict[str, NDArray[Any]] = {}
        for name, kind, shape in shapes:
            count = math.prod(shape)
            # A copy: what is worked on later may be written to.
            arrays[name] = np.frombuffer(data, kind, count, place).reshape(shape).copy()
            place += arrays[name].nbytes
        return cls(head, arrays)


class Kept:
    """What a source keeps by a recipe: nothing if it is a recording in memory, nothing new if it is only read."""

    def __init__(self, source: object, recipe: Recipe) -> None:
        self._store = source if isinstance(source, KeepsReductions) else None
        self._recipe = recipe
        self.writable = self._store is not None and not self._store.readonly
        self.added = False
        """Whether something new was kept."""

    def get(self, name: str, unpack: Callable[[Packed], T]) -> T | None:
        """What is kept under a name; None for nothing and for what cannot be read."""
        data = self._store.reduction(str(self._recipe), name) if self._store is not None else None
        if data is None:
            return None
        try:
            return unpack(Packed.from_bytes(data))
        except _UNREADABLE:
            return None

    def put(self, name: str, packed: Packed) -> bytes:
        """Keep it, where that is possible; returns it as it is kept."""
        data = packed.to_bytes(compressed=self._recipe.compressed)
        if self._store is not None and self.writable:
            try:
                self._store.keep_reductions(str(self._recipe), {name: data})
                self.added = True
            except DataError:
                # A disk that is full: the numbers are as good.
                self.writable = False
        return data

    def once(self, name: str, make: Callable[[], Packed], unpack: Callable[[Packed], T]) -> T:
        """What is kept under a name, or is made and kept now: the same bit for bit either way."""
        value = self.get(name, unpack)
        return unpack(Packed.from_bytes(self.put(name, make()))) if value is None else value


@dataclass(frozen=True)
class LeftOut:
    """A run that cannot be reduced, and why, in a sentence."""

    run_id: str
    reason: str


@dataclass(frozen=True)
class Reduction(Generic[T]):
    """The valid runs of a recording, reduced; `left_out` says by run_id, in a sentence, why one is not."""

    runs: tuple[T, ...]
    left_out: Mapping[str, str]

    @classmethod
    def of(cls, runs: Iterable[T | LeftOut]) -> Reduction[T]:
        """Those that are reduced apart from those that are not."""
        reduced: list[T] = []
        left_out: dict[str, str] = {}
        for run in runs:
            if isinstance(run, LeftOut):
                left_out[run.run_id] = run.reason
            else:
                reduced.append(run)
        return cls(tuple(reduced), left_out)

    def sorted_by(self, contents: Callable[[T], Iterable[float]]) -> Reduction[T]:
        """In the order of numbers that runs contain, unknown ones last.

        Whatever the order in the file, blocks that are held out and draws of noise are the same.
        """

        def key(run: T) -> list[float]:
            return [value if math.isfinite(value) else math.inf for value in map(float, contents(run))]

        return Reduction(tuple(sorted(self.runs, key=key)), self.left_out)


def each_reduced(
    kept: Kept,
    runs: Sequence[RunT],
    make: Callable[[RunT], Packed],
    unpack: Callable[[Packed, RunT], T],
    progress: Progress | None = None,
) -> Iterator[T | LeftOut]:
    """Every run, reduced now or before, in order; one of which `make` raises `DataError` is left out from then on."""

    def reduced(done: int, run: RunT) -> T | LeftOut:
        def made() -> Packed:
            try:
                packed = make(run)
            except DataError as error:
                # The refusal is kept as well: a run that cannot be reduced is not read again at every question.
                packed = Packed({_LEFT_OUT: str(error)}, {})
            if progress is not None:
                progress(done, len(runs))
            return packed

        def unpacked(packed: Packed) -> T | LeftOut:
            reason = packed.head.get(_LEFT_OUT)
            return unpack(packed, run) if reason is None else LeftOut(run.run_id, reason)

        return kept.once(run.run_id, made, unpacked)

    return (reduced(done, run) for done, run in enumerate(runs, start=1))
