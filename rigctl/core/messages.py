"""Messages are one line, whatever they quote."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.core.bounds import MESSAGE_CHARACTERS


def one_line(text: str) -> str:
    """`text` with everything that would break a line or a terminal escaped, the middle left out where it is long."""
    if len(text) > MESSAGE_CHARACTERS:
        text = f"{text[: MESSAGE_CHARACTERS // 2]} ... {text[-MESSAGE_CHARACTERS // 2 :]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def either(choices: Iterable[str]) -> str:
    """The choices as one reads them: "a, b or c"."""
    *first, last = choices
    return f"{', '.join(first)} or {last}" if first else last
