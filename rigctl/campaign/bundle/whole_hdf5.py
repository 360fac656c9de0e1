"""A file of HDF5 that is there whole or not at all, also when the disk is full."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from rigctl.core.whole_file import whole_file

Check = Callable[[], None]


@contextmanager
def whole_hdf5(path: Path) -> Iterator[tuple[h5py.File, Check]]:
    """A new file to write to, which takes the name `path` at the end, and what raises if the disk has failed by now.

    `DataError` as `whole_file`. Who writes for long calls the second now and then.
    """
    with whole_file(path) as partial, _Disk(partial) as disk:
        try:
            with h5py.File(disk, "w", track_order=True) as file:
                yield file, disk.check
        finally:
            # Also in place of what HDF5 says of a file that has not what it wrote.
            disk.check()


class _Disk(io.FileIO):
    """A file that takes everything, and keeps the first error of its disk for `check`.

    HDF5 told of an error tells it again for every object that is let go, and ends the process: it is not told.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "r+")
        self._error: OSError | None = None

    def check(self) -> None:
        """Raise the first error there was; nothing without one."""
        if self._error is not None:
            raise self._error

    def write(self, data: memoryview, /) -> int:  # type: ignore[override]
        """Write all of it; the number of its bytes."""
        left = memoryview(data)
        try:
            while self._error is None and left:
                # A disk that is nearly full takes a part.
                left = left[super().write(left) :]
        except OSError as error:
            self._error = error
        return len(data)

    def truncate(self, size: int | None = None, /) -> int:
        """Make it as long as that."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size or 0
