"""A file layer below the program's own SQLite: it keeps the order of writes and syncs, and refuses what it is told.

SQLite reaches files through a table of functions, its VFS. This one is SQLite's own with `xWrite`, `xTruncate` and
`xSync` passed through here, in the very library that Python's `sqlite3` uses.
"""

from __future__ import annotations

import _sqlite3
import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

OK, FULL, READONLY, IOERR_WRITE, IOERR_FSYNC = 0, 13, 8, 778, 1034

_Pointer = ctypes.c_void_p
_Open = ctypes.CFUNCTYPE(ctypes.c_int, _Pointer, _Pointer, _Pointer, ctypes.c_int, _Pointer)
_Write = ctypes.CFUNCTYPE(ctypes.c_int, _Pointer, _Pointer, ctypes.c_int, ctypes.c_longlong)
_Truncate = ctypes.CFUNCTYPE(ctypes.c_int, _Pointer, ctypes.c_longlong)
_Sync = ctypes.CFUNCTYPE(ctypes.c_int, _Pointer, ctypes.c_int)


class _Methods(ctypes.Structure):
    """`sqlite3_io_methods`, of version 3."""

    _fields_ = (
        ("version", ctypes.c_int),
        *((name, _Pointer) for name in ("close", "read", "write", "truncate", "sync")),
        *((f"other_{place}", _Pointer) for place in range(13)),
    )


class _Vfs(ctypes.Structure):
    """`sqlite3_vfs`, of version 3."""

    _fields_ = (
        ("version", ctypes.c_int),
        ("file_bytes", ctypes.c_int),
        ("path_bytes", ctypes.c_int),
        ("next", _Pointer),
        ("name", ctypes.c_char_p),
        ("data", _Pointer),
        ("open", _Pointer),
        *((f"other_{place}", _Pointer) for place in range(14)),
    )


@dataclass(frozen=True)
class Step:
    """Something that happened to a file, or that the program said: then `kind` is "said" and `file` what."""

    kind: Literal["write", "truncate", "sync", "note", "said"]
    file: str
    at: int = 0
    data: bytes = b""


@dataclass
class FileLayer:
    """`steps` in their order; `refuse` gives the code with which a step fails, 0 for none."""

    steps: list[Step] = field(default_factory=list)
    refuse: Callable[[Step], int] = lambda step: OK

    def say(self, what: str) -> None:
        """Keep that the program has come so far."""
        self.steps.append(Step("said", what))

    def _taken(self, step: Step, pass_on: Callable[[], int]) -> int:
        code = self.refuse(step) or pass_on()
        if code == OK:
            self.steps.append(step)
        return code


@contextmanager
def watched_files(layer: FileLayer) -> Iterator[None]:
    """Every SQLite file opened inside goes through `layer`; files must be closed inside too."""
    library = ctypes.CDLL(_sqlite3.__file__)
    library.sqlite3_vfs_find.restype = ctypes.POINTER(_Vfs)
    usual = library.sqlite3_vfs_find(None)
    ours = _Vfs.from_buffer_copy(usual.contents)
    ours.name, ours.next = b"watched", None
    opened = _Opened(layer, _Open(usual.contents.open))
    ours.open = ctypes.cast(opened.function, _Pointer)
    library.sqlite3_vfs_register(ctypes.byref(ours), 1)
    try:
        yield
    finally:
        library.sqlite3_vfs_unregister(ctypes.byref(ours))
        library.sqlite3_vfs_register(usual, 1)


class _Opened:
    """`xOpen`, and the functions of the files it has opened."""

    def __init__(self, layer: FileLayer, usual: Any) -> None:
        self._layer = layer
        self._usual = usual
        self._tables: list[Any] = []
        self.function = _Open(self._open)

    def _open(self, vfs: int, path: int, file: int, flags: int, out: int) -> int:
        code = int(self._usual(vfs, path, file, flags, out))
        if code == OK and path:
            # A file begins with a pointer to its functions.
            place = ctypes.cast(file, ctypes.POINTER(ctypes.POINTER(_Methods)))
            table = self._table(Path((ctypes.string_at(path)).decode()).name, place.contents.contents)
            place[0] = ctypes.pointer(table)
        return code

    def _table(self, name: str, usual: _Methods) -> _Methods:
        write, truncate, sync = _Write(usual.write), _Truncate(usual.truncate), _Sync(usual.sync)
        layer = self._layer

        def on_write(file: int, data: int, size: int, at: int) -> int:
            step = Step("write", name, at, ctypes.string_at(data, size))
            return layer._taken(step, lambda: write(file, data, size, at))

        def on_truncate(file: int, size: int) -> int:
            return layer._taken(Step("truncate", name, size), lambda: truncate(file, size))

        def on_sync(file: int, flags: int) -> int:
            return layer._taken(Step("sync", name), lambda: sync(file, flags))

        functions = (_Write(on_write), _Truncate(on_truncate), _Sync(on_sync))
        table = _Methods.from_buffer_copy(usual)
        table.write, table.truncate, table.sync = (ctypes.cast(each, _Pointer) for each in functions)
        self._tables += [table, functions]
        return table
