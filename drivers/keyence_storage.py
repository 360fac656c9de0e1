"""How an LK-G3001 is told what to store, and how it tells what it has stored.

The maker's header LkIF.h says what there is: a target (no output, one, both), a number, a cycle from 0 to 9, and
status and values by output; none of its cycles is the TIMING input. How RS-232C writes it stands on pages 5-7 to 5-23
of the LK-G series user's manual, which were not at hand. Two programs for real controllers write `SW,CI` with an
output, a number and a cycle: mecode's `KeyenceProfilometer` (github.com/jminardi/mecode: a number of five digits, a
cycle of one) and a public C# program with an LK-G's two outputs (`AmountOfDataConfigurationCommand`: once for each
output). Whether their first field is an output or a target they do not tell. `FORMS` are the readings that are
possible, in the order in which they are tried. *Confirm* with the manual which yours takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from drivers.keyence_setting import Setting
from drivers.numbers import whole

MANUAL = "LK-G series user's manual, pages 5-7 to 5-23"

CYCLES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Sampling cycles between stored values, by the number that selects them (LkIF.h)."""

_OUT1, _OUT2, _BOTH = frozenset({1}), frozenset({2}), frozenset({1, 2})


@dataclass(frozen=True)
class StorageForm:
    """One reading of `SW,CI`: the numbers that choose each target, one command for each of them.

    Count and cycle have so many digits; 0: as few as go.
    """

    targets: Mapping[frozenset[int], tuple[int, ...]]
    count_digits: int
    cycle_digits: int

    def settings(self, outputs: frozenset[int], count: int, cycle: int) -> list[Setting]:
        """Store `count` values of `outputs`; `cycle` is a number of `CYCLES`."""
        how_often = f"{count:0{self.count_digits}d}", f"{cycle:0{self.cycle_digits}d}"
        # confirm: whether a question names the target, or is answered by it
        return [Setting("CI", (str(number), *how_often), named=(0, 1)) for number in self.targets[outputs]]


_TARGETS: Sequence[Mapping[frozenset[int], tuple[int, ...]]] = (
    {_OUT1: (1,), _OUT2: (2,), _BOTH: (3,)},  # confirm: LkIF.h counts none, OUT1, OUT2, both
    {_OUT1: (1,), _OUT2: (2,), _BOTH: (1, 2)},  # confirm: as the C# program, output by output
    {_OUT1: (1,), _OUT2: (2,), _BOTH: (0,)},  # confirm: as M0 measures both
    {_OUT1: (0,), _OUT2: (1,), _BOTH: (2,)},  # confirm: as LkIF.h counts outputs
)
_DIGITS = (
    (5, 1),  # mecode; 65536 has five digits, cycles 0 to 9 one
    (0, 1),  # confirm: no leading zeros (the C# program, if its user gives it less than five)
    (7, 2),  # confirm: as the LK-G5000
    (6, 1),  # confirm
    (7, 1),  # confirm
    (5, 2),  # confirm
    (6, 2),  # confirm
)
FORMS: Sequence[StorageForm] = tuple(
    StorageForm(targets, count_digits, cycle_digits)
    for targets, (count_digits, cycle_digits) in product(_TARGETS, _DIGITS)
)
"""What may be sent as `SW,CI`."""


@dataclass(frozen=True)
class Status:
    """Of one output: whether the storage runs, and how many values it has."""

    running: bool
    stored: int


def status_of(output: int, reply: bytes, *, by_output: bool) -> Status:
    """What the reply to `AN,<out>`, or to `AN` where that takes no output, says of one; `ValueError` for all else.

    *Confirm* which form it has: state and count, perhaps behind the output; or state and a count of each (mecode asks
    `AN`, and does not look into the reply).
    """
    fields = reply.decode("latin-1").split(",")
    if by_output and len(fields) == 3 and fields[0] == str(output):
        del fields[0]
    counts = [whole(field) for field in fields[1:]]
    if fields[0] not in {"0", "1"} or len(counts) != (1 if by_output else 2):
        raise ValueError(f"{reply!r} is no status")
    return Status(fields[0] == "1", counts[0 if by_output else output - 1])


def values_of(output: int, reply: bytes) -> bytes:
    """The values in the reply to `AO,<out>`; *confirm* whether the output stands before them (the C# program: no)."""
    whose, _, rest = reply.partition(b",")
    # A value has eight characters, an output's number one.
    return rest if whose == str(output).encode() else reply
