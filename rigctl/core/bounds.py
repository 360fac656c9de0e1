"""How a file is read: within bounds, every one of them here with its reason, and never led elsewhere.

Each is some ten times what the longest real record needs (days at 200 Hz: 60 million samples of a few columns), so
that nobody meets one by measuring, and small enough that a file made or damaged to fill the memory is refused first.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

KIB, MIB, GIB = 1 << 10, 1 << 20, 1 << 30

TOML_BYTES = MIB
"""Of a rig file, a campaign file, a header: pages of text. The parser takes about a second for so many."""

TOML_DEPTH = 32
"""Of tables within tables; ours have five. What walks a document may recurse."""

TOML_DOTS_SQUARED = 10_000_000
"""Over the lines, squares of the number of dots: what dotted keys cost. 3000 numbers in one line are fine."""

TABLE_BYTES = 64 * MIB
"""Of runs.csv, patterns.csv, readings.csv, whose fields are kept as text one by one."""

TABLE_ROWS = 1_000_000
"""Readings of a table, or dwells of a pattern."""

RUNS = 200_000
"""Runs of a recording: four years of runs of ten minutes."""

RUN_TEXT_BYTES = GIB
"""Of one run as .csv, after .gz: a day of three columns at 200 Hz. A longer one goes as .npz."""

RUN_VALUES = 1_000_000_000
"""Numbers of one run, all columns: 60 million samples of sixteen columns. 8 GB."""

NPZ_BYTES = 8 * GIB
"""Of one run as .npz: `RUN_VALUES` numbers of 64 bits."""

SAMPLES = 200_000_000
"""Of one run: eleven days at 200 Hz."""

COLUMNS = 2000
"""Of a table or a run; ours have at most forty."""

LINE_CHARACTERS = MIB
"""Of one line, or one row whose quoted fields hold line ends: 2000 columns of 500 characters."""

FILES = 2 * RUNS
"""In a bundle."""

ZIP_DIRECTORY_BYTES = 128 * MIB
"""Of a .zip's list of contents: 300 bytes for each of `FILES`."""

ZIP_BYTES = 16 * GIB
"""Of all that a .zip holds, unpacked. Larger recordings are imported from their directory."""

RATIO = 100
"""Unpacked to packed. Noise packs 1.1 to 1, text of numbers 2 to 10 to 1; zeros, and bombs, 1000 to 1."""

RATIO_COUNTS_FROM_BYTES = 32 * MIB
"""So much may be unpacked at any ratio: a run of a simulator without noise packs as well as a bomb."""

EXPRESSION_CHARACTERS = 10_000
"""Of a baseline: a hundred terms."""

PLUGIN_BYTES = MIB
"""Of a file of effects."""

KEY_BYTES = 64 * KIB
"""Of a file with a key, a passphrase, an X.509 certificate or a signature: an RSA key of 16384 bits has 13 KiB."""

MESSAGE_CHARACTERS = 600
"""Of an error: one line, whatever it quotes."""


def amount(size: int) -> str:
    """A number of bytes for messages."""
    for unit, name in ((GIB, "GiB"), (MIB, "MiB"), (KIB, "KiB")):
        if size >= unit:
            return f"{size / unit:.4g} {name}"
    return f"{size} bytes"


class NoFile(OSError):
    """Something is there, but it is no file to read; the message says what, and the mend."""


class TooLarge(OSError):
    """More bytes than allowed; the message says how many."""


def open_regular(path: str | Path, *, within: int | None = None) -> BinaryIO:
    """A regular file, open for reading; `NoFile` for a directory, a device or a pipe, which is never waited for.

    With `within`, the descriptor of the directory that `path` is in, a link is refused too. `OSError` as `open`.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
    # Looked at before it is opened, since opening alone may act on a device.
    if not stat.S_ISREG(os.stat(path, dir_fd=within, follow_symlinks=within is None).st_mode):
        raise NoFile(_what(path, within))
    file = os.open(path, flags | (os.O_NOFOLLOW if within is not None else 0), dir_fd=within)
    # Looked at again: between the look and the opening the name may have been given to something else.
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise NoFile(_what(path, within))
    return os.fdopen(file, "rb")


def _what(path: str | Path, within: int | None) -> str:
    mode = os.stat(path, dir_fd=within, follow_symlinks=within is None).st_mode
    if stat.S_ISLNK(mode):
        return "a link; put the file itself there"
    return "a directory; name a file" if stat.S_ISDIR(mode) else "a device or a pipe; put a file there"


def read_regular(path: Path, limit: int) -> bytes:
    """The content of a file that a user names, links followed; `TooLarge` beyond `limit` bytes."""
    with open_regular(path) as file:
        # One byte more, which tells a file of just this size from a larger one; its own word for its size may be
        # wrong.
        data = file.read(limit + 1)
    if len(data) > limit:
        raise TooLarge(f"more than {limit} bytes")
    return data
