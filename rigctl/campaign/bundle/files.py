"""The files of a bundle, in a directory or a .zip of one; nothing is ever unpacked to disk, no link followed."""

from __future__ import annotations

import io
import os
import stat
import unicodedata
import zipfile
from collections.abc import Callable, Iterable, Iterator, KeysView
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from rigctl.campaign.bundle.place import Place
from rigctl.campaign.bundle.unpacking import UNREADABLE, open_zip, read_member
from rigctl.core.bounds import FILES, NoFile, amount, open_regular
from rigctl.core.errors import DataError

HEADER_FILE = "recording.toml"
_FOLDER = "runs"
_PACK = "pack the directory again"


@dataclass(frozen=True)
class BundleFiles:
    """The bundle at `path`; `sizes` are of its files in bytes, by names relative to it, with forward slashes."""

    path: Path
    sizes: dict[str, int]
    open_file: Callable[[str], BinaryIO]

    @property
    def names(self) -> KeysView[str]:
        """Every file."""
        return self.sizes.keys()

    def place(self, name: str) -> Place:
        """The file `name` for messages."""
        return Place(str(self.path / name))

    def read(self, name: str, limit: int, mend: str = "add it", shorten: str = "split the recording") -> bytes:
        """The content of one file; `DataError` when it is missing, cannot be read or is larger than `limit` bytes.

        The message ends in `mend` for a missing file, in `shorten` for one too large.
        """
        with self.open(name, limit, mend, shorten) as file:
            try:
                return file.read()
            except (MemoryError, *UNREADABLE) as error:
                raise self._unreadable(name, error) from error

    def open(self, name: str, limit: int, mend: str = "add it", shorten: str = "split the recording") -> BinaryIO:
        """The same, to read piece by piece."""
        if name not in self.sizes:
            raise self.place(name).error(f"missing; {mend}")
        if self.sizes[name] > limit:
            raise self.place(name).error(
                f"{amount(self.sizes[name])}, but at most {amount(limit)} are read; {shorten}"
            )
        try:
            return self.open_file(name)
        except NoFile as error:
            raise self.place(name).error(str(error)) from error
        except (MemoryError, *UNREADABLE) as error:
            raise self._unreadable(name, error) from error

    def _unreadable(self, name: str, error: BaseException) -> DataError:
        return self.place(name).error(f"cannot be read ({error or 'out of memory'}); copy or pack it again")


@contextmanager
def open_bundle(path: Path) -> Iterator[BundleFiles]:
    """The files of the directory or .zip at `path`; `DataError` when it is neither."""
    if path.is_dir():
        with _directory(path) as files:
            yield files
        return
    try:
        file = open_regular(path)
    except FileNotFoundError:
        raise Place(str(path)).error(
            f"no such bundle; name a directory with {HEADER_FILE}, or a .zip of one"
        ) from None
    except OSError as error:
        raise Place(str(path)).error(f"not a readable zip ({error.strerror or error}); {_PACK}") from error
    with file, open_zip(Place(str(path)), file, FILES, _PACK) as archive:
        yield _zip_files(path, archive)


@contextmanager
def _directory(path: Path) -> Iterator[BundleFiles]:
    """By descriptors, so that no part of a name can be exchanged for a link between a look and the opening."""
    place = Place(str(path))
    folders: dict[str, int] = {}
    try:
        folders[""] = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        sizes = _listed(place, folders[""], "")
        # A table has no folder of runs.
        with suppress(FileNotFoundError, NotADirectoryError):
            folders[_FOLDER] = os.open(_FOLDER, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=folders[""])
            sizes |= _listed(place, folders[_FOLDER], f"{_FOLDER}/")
        _require_different(place, sizes)

        def opened(name: str) -> BinaryIO:
            folder, _, file = name.rpartition("/")
            return open_regular(file, within=folders[folder])

        yield BundleFiles(path, sizes, opened)
    except OSError as error:
        raise place.error(f"cannot be read ({error.strerror or error}); check the directory") from error
    finally:
        for folder in folders.values():
            os.close(folder)


def _listed(place: Place, folder: int, prefix: str) -> dict[str, int]:
    sizes: dict[str, int] = {}
    with os.scandir(folder) as entries:
        for count, entry in enumerate(entries, 1):
            if count > FILES:
                raise place.error(f"more than {FILES} files in {prefix or 'it'}; split the recording")
            status = entry.stat(follow_symlinks=False)
            if stat.S_ISLNK(status.st_mode):
                raise Place(f"{place.file}/{prefix}{entry.name}").error("a link; put the file itself there")
            if not stat.S_ISDIR(status.st_mode):
                sizes[prefix + entry.name] = status.st_size
    return sizes


def _require_different(place: Place, names: Iterable[str]) -> None:
    """`DataError` for two names that a person, or another file system, takes for one."""
    seen: dict[str, str] = {}
    for name in names:
        # A bundle made here must also unpack where names ignore case or are stored in another Unicode form.
        same = seen.setdefault(unicodedata.normalize("NFKC", name).casefold(), name)
        if same != name:
            raise place.error(f"{same!r} and {name!r} are one name to other systems; rename or remove one")


def _zip_files(path: Path, archive: zipfile.ZipFile) -> BundleFiles:
    members = {member.filename: member.file_size for member in archive.infolist() if not member.is_dir()}
    for name in members:
        # Nothing is unpacked to disk here, but the same archive may be unpacked by other programs.
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name:
            raise Place(str(path)).error(f"member {name!r} points outside the bundle; {_PACK}")
    root = _root(list(members))
    sizes = {name.removeprefix(root): size for name, size in members.items() if name.startswith(root)}
    _require_different(Place(str(path)), sizes)
    return BundleFiles(path, sizes, lambda name: io.BytesIO(read_member(archive, root + name)))


def _root(members: list[str]) -> str:
    """The folder of the archive that is the bundle: the top, or the one folder that was packed."""
    tops = {name.removesuffix(HEADER_FILE) for name in members if PurePosixPath(name).name == HEADER_FILE}
    # Packing a directory from outside puts its name before every member; two such folders would be a choice.
    folders = {top for top in tops if top.count("/") == 1}
    return folders.pop() if "" not in tops and len(folders) == 1 else ""
