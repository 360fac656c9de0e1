"""The files of a bundle, in a directory or a .zip of one; nothing is ever unpacked to disk."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from rigctl.errors import DataError

HEADER_FILE = "recording.toml"


@dataclass(frozen=True)
class Place:
    """A file of a bundle as messages name it."""

    file: str

    def error(self, message: str, line: int | None = None) -> DataError:
        """A `DataError` that says where; `message` says what and the mend."""
        return DataError(f"{self.file}{'' if line is None else f', line {line}'}: {message}")


class BundleFiles:
    """The bundle at `path`; `names` are relative to it, with forward slashes."""

    def __init__(self, path: Path, names: frozenset[str], read: Callable[[str], bytes]) -> None:
        self.path = path
        self.names = names
        self._read = read

    def place(self, name: str) -> Place:
        """The file `name` for messages."""
        return Place(str(self.path / name))

    def read(self, name: str, mend: str = "add it") -> bytes:
        """The content of one file; `DataError`, ending in `mend`, when it is missing or cannot be read."""
        if name not in self.names:
            raise self.place(name).error(f"missing; {mend}")
        try:
            return self._read(name)
        except (OSError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
            raise self.place(name).error(f"cannot be read ({error}); copy or pack it again") from error


@contextmanager
def open_bundle(path: Path) -> Iterator[BundleFiles]:
    """The files of the directory or .zip at `path`; `DataError` when it is neither."""
    if path.is_dir():
        names = frozenset(p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file())
        yield BundleFiles(path, names, lambda name: (path / name).read_bytes())
        return
    if not path.is_file():
        raise DataError(f"{path}: no such bundle; name a directory with {HEADER_FILE}, or a .zip of one")
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError) as error:
        raise DataError(f"{path}: not a readable zip ({error}); pack the directory again") from error
    with archive:
        yield _zip_files(path, archive)


def _zip_files(path: Path, archive: zipfile.ZipFile) -> BundleFiles:
    members = [name for name in archive.namelist() if not name.endswith("/")]
    for name in members:
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name:
            raise DataError(f"{path}: member {name!r} points outside the bundle; pack the directory again")
    root = _root(members)
    names = frozenset(name.removeprefix(root) for name in members if name.startswith(root))
    return BundleFiles(path, names, lambda name: archive.read(root + name))


def _root(members: list[str]) -> str:
    """The folder of the archive that is the bundle: the top, or the one folder that was packed."""
    tops = {name.removesuffix(HEADER_FILE) for name in members if PurePosixPath(name).name == HEADER_FILE}
    folders = {top for top in tops if top.count("/") == 1}
    return folders.pop() if "" not in tops and len(folders) == 1 else ""
