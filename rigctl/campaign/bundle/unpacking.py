"""Packed files, unpacked within bounds: what would fill the memory is refused before or while it is unpacked."""

from __future__ import annotations

import gzip
import io
import stat
import struct
import zipfile
import zlib
from typing import BinaryIO

from rigctl.campaign.bundle.place import Place
from rigctl.core.bounds import RATIO, RATIO_COUNTS_FROM_BYTES, ZIP_BYTES, ZIP_DIRECTORY_BYTES, amount

UNREADABLE = (OSError, EOFError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error)
"""What zipfile, gzip and zlib raise for a file that is damaged, encrypted or packed in a way they do not know."""

_PIECE = 1 << 20
_DEFLATE_RATIO = 1032  # the most that the method can do: a file that says more is cut off, or none
_END = struct.Struct("<4s4H2LH")
_LOCATOR = struct.Struct("<4sLQL")
_END_64 = struct.Struct("<4sQ2H2L4Q")
_ENTRY = b"PK\x01\x02"


def gunzipped(place: Place, data: bytes, limit: int, mend: str) -> bytes:
    """A .gz's content; `DataError`, ending in `mend` where it is larger than `limit` bytes."""
    # The trailer of gzip has the size modulo 2**32, and may be wrong: a quick refusal, while the loop decides.
    announced = int.from_bytes(data[-4:], "little")
    if limit < announced <= _DEFLATE_RATIO * len(data):
        raise place.error(f"{amount(announced)} unpacked, but at most {amount(limit)} are read; {mend}")
    packed = io.BytesIO(data)
    content = io.BytesIO()
    try:
        with gzip.GzipFile(fileobj=packed) as file:
            while piece := file.read(_PIECE):
                content.write(piece)
                # After every piece: a bomb is found after megabytes, not when the memory is full.
                _require_ratio(place, content.tell(), packed.tell())
                if content.tell() > limit:
                    raise place.error(f"more than {amount(limit)} unpacked; {mend}")
    except UNREADABLE as error:
        raise place.error(f"not a readable gzip file ({error}); compress it again") from error
    return content.getvalue()


def open_zip(place: Place, file: BinaryIO, members_max: int, mend: str) -> zipfile.ZipFile:
    """A .zip whose list of contents and whose contents are within bounds; `DataError`, ending in `mend`.

    Refused are members that are no files, are there twice, or are packed unusually.
    """
    _require_short_list(place, file, members_max, mend)
    try:
        archive = zipfile.ZipFile(file)
    except UNREADABLE as error:
        raise place.error(f"not a readable zip ({error}); {mend}") from error
    members = archive.infolist()
    total = sum(member.file_size for member in members)
    if total > ZIP_BYTES:
        raise place.error(f"{amount(total)} unpacked, but at most {amount(ZIP_BYTES)} are read; {mend}")
    # Over the whole archive: a single column may well be constant.
    _require_ratio(place, total, file.seek(0, io.SEEK_END))
    names: set[str] = set()
    for member in members:
        if flaw := "is there twice" if member.filename in names else _flaw_of_member(member):
            raise place.error(f"member {member.filename!r} {flaw}; {mend}")
        names.add(member.filename)
    return archive


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """One member, piece by piece: never more than its entry in the list of contents says."""
    content = io.BytesIO()
    with archive.open(name) as file:
        while piece := file.read(_PIECE):
            content.write(piece)
    return content.getvalue()


def _require_ratio(place: Place, unpacked: int, packed: int) -> None:
    if unpacked > max(RATIO_COUNTS_FROM_BYTES, RATIO * packed):
        raise place.error(
            f"{amount(unpacked)} packed into {amount(packed)}, more than {RATIO} to 1, which no measured record is;"
            " look at what it holds, or give it unpacked"
        )


def _flaw_of_member(member: zipfile.ZipInfo) -> str | None:
    # A .zip made on Unix has the file's mode in the upper 16 bits; elsewhere they are 0.
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind == stat.S_IFLNK:
        return "is a link"
    if kind not in {0, stat.S_IFREG, stat.S_IFDIR}:
        return "is a device or a pipe"
    if member.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        return "is packed in an unusual way"
    return None


def _require_short_list(place: Place, file: BinaryIO, members_max: int, mend: str) -> None:
    """Before zipfile reads the list of contents, which takes it seconds for a million entries."""
    size = file.seek(0, io.SEEK_END)
    # The end record stands last, before a comment of at most 64 KiB.
    tail_bytes = min(size, _END.size + (1 << 16) + _LOCATOR.size + _END_64.size)
    file.seek(size - tail_bytes)
    listed = _list_bytes(file.read(tail_bytes))
    if listed > ZIP_DIRECTORY_BYTES:
        raise place.error(f"a list of contents of {amount(listed)}; {mend}")
    file.seek(max(0, size - tail_bytes - listed))
    # Counted by its mark, because the number in the end record has 16 bits and may be false.
    members = file.read().count(_ENTRY)
    if members > members_max:
        raise place.error(f"{members} files packed, but at most {members_max} are read; {mend}")
    file.seek(0)


def _list_bytes(tail: bytes) -> int:
    """The size of the list as the end of a .zip says it, 0 when there is none to be seen."""
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or len(tail) - at < _END.size:
        return 0
    size: int = _END.unpack_from(tail, at)[5]
    wide = tail.rfind(b"PK\x06\x06", 0, at)
    # The 64-bit record counts where the old field says it is too small for the size.
    if wide >= 0 and at - wide >= _END_64.size:
        size = max(size if size != 0xFFFFFFFF else 0, _END_64.unpack_from(tail, wide)[8])
    return size
