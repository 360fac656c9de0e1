"""One setting of a Keyence LK-G controller: written, and read back, since the reply to `SW` does not say what came.

Sources: `SW,CA,n` is answered by `SW,CA`; reads are "same with SR and without the value", answered by all of it
(LK-G Series User's Manual, chapter 5; drivers in public use).
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.keyence_line import KeyenceLine
from drivers.numbers import whole
from rigctl.core.errors import BadReply, InstrumentError


@dataclass(frozen=True)
class Setting:
    """A setting: its name and the whole numbers that are written behind it.

    `named` is how many of these a question names, in the order in which they are tried: which of them are "the value"
    the manual does not always tell.
    """

    name: str
    fields: tuple[str, ...]
    named: tuple[int, ...] = (0,)

    @property
    def written(self) -> str:
        """The command that writes it."""
        return ",".join(("SW", self.name, *self.fields))


def confirm(line: KeyenceLine, setting: Setting) -> None:
    """Ask for a setting; `BadReply` when it is not as it was written."""
    there = _asked(line, setting)
    try:
        agrees = [whole(field) for field in there] == [whole(field) for field in setting.fields]
    except ValueError:
        agrees = False
    if not agrees:
        raise BadReply(
            f"{line.name}: {setting.written} is {setting.name},{','.join(there)} when it is read back; bits turn on "
            "the line, or somebody is at the panel: check the line (baud rate, parity) and record again",
            instrument=line.name,
        )


def _asked(line: KeyenceLine, setting: Setting) -> list[str]:
    *first, last = setting.named
    for named in first:
        try:
            return _fields(line, setting, named)
        except InstrumentError as error:
            # Without a code it was no refusal.
            if not error.code:
                raise
    return _fields(line, setting, last)


def _fields(line: KeyenceLine, setting: Setting, named: int) -> list[str]:
    whose = setting.fields[:named]
    reply = line.ask_repeated(",".join(("SR", setting.name, *whose)))
    return [*whose, *reply.decode("latin-1").split(",")]
