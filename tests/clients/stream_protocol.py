"""A small reader of EPICS StreamDevice protocol files: what they send, and what they take for an answer.

As far as the files tried here go: `out`, `in`, `wait`, calls of other protocols, `@mismatch`, variables, arguments
in calls; `%d`, `%f`, `%s`-less enumerations `%{a|b}`, `%*nc`, and values for other records, `%(record){a|b}`. Source:
StreamDevice's documentation, chapters Protocol Files and Formats (https://paulscherrerinstitute.github.io/StreamDevice).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

TERMINATORS = {"CR": b"\r", "LF": b"\n", "CR LF": b"\r\n"}
_TOKENS = re.compile(r'#[^\n]*|"(?:[^"\\]|\\.)*"|[@$\w]+|[{};=]|\S')
_FORMAT = re.compile(r"%(?:\((?P<record>[^)]*)\))?(?P<flags>[*+0]*)(?P<width>\d*)(?P<kind>[dfc]|\{[^}]*\})")

Value = int | float | None


@dataclass
class Statement:
    word: str
    arguments: list[str]


@dataclass
class Outcome:
    """`values` that an answer had; `elsewhere` those for other records; `matched` False for another answer."""

    matched: bool = True
    values: list[float] = field(default_factory=list)
    elsewhere: dict[str, int] = field(default_factory=dict)


class Protocols:
    """The protocols of a file, spoken over `exchange`: one line out, one line back, both without terminators."""

    def __init__(
        self, text: str, send: Callable[[bytes], None], receive: Callable[[], bytes], wait_ms: Callable[[int], None]
    ) -> None:
        tokens = [token for token in _TOKENS.findall(text) if not token.startswith("#")]
        self.terminator = b""
        self._variables: dict[str, str] = {}
        self._protocols: dict[str, list[Statement]] = {}
        self._send, self._receive, self._wait_ms = send, receive, wait_ms
        while tokens:
            self._read_one(tokens)

    def run(self, name: str, value: Value = None, *arguments: str) -> Outcome:
        """One record that is processed with `value`."""
        outcome = Outcome()
        self._run(name, value, arguments, outcome)
        return outcome

    def names(self) -> list[str]:
        """Of all protocols in the file."""
        return list(self._protocols)

    # the file

    def _read_one(self, tokens: list[str]) -> None:
        name = tokens.pop(0)
        opening = tokens.pop(0)
        if opening == "{":
            self._protocols[name] = _statements(tokens)
            return
        assert opening == "=", (name, opening)
        words = []
        while (token := tokens.pop(0)) != ";":
            words.append(token)
        if name == "Terminator":
            self.terminator = TERMINATORS[" ".join(words)]
        else:
            self._variables[name] = words[0]

    # a protocol

    def _run(self, name: str, value: Value, arguments: tuple[str, ...], outcome: Outcome) -> None:
        handlers = {s.word: s.arguments for s in self._protocols[name] if s.word.startswith("@")}
        for statement in self._protocols[name]:
            match statement.word:
                case "out":
                    self._send(self._sent(statement.arguments[0], value, arguments) + self.terminator)
                case "in":
                    answer = self._receive().decode()
                    if not self._taken(statement.arguments[0], answer, arguments, outcome):
                        outcome.matched = False
                        for handler in handlers.get("@mismatch", []):
                            # What did not match is looked at once more by the handler.
                            self._handle(handler, answer, arguments, outcome)
                        return
                case "wait":
                    self._wait_ms(int(statement.arguments[0]))
                case other if not other.startswith("@"):
                    self._run(other, value, arguments, outcome)
                    if not outcome.matched:
                        return

    def _handle(self, name: str, answer: str, arguments: tuple[str, ...], outcome: Outcome) -> None:
        for statement in self._protocols[name]:
            if statement.word == "in":
                self._taken(statement.arguments[0], answer, arguments, outcome)

    def _text(self, token: str, arguments: tuple[str, ...]) -> str:
        text = self._variables[token[1:]] if token.startswith("$") else token
        text = text.strip('"')
        for number, argument in enumerate(arguments, start=1):
            text = text.replace(f"\\${number}", argument)
        return text

    def _sent(self, token: str, value: Value, arguments: tuple[str, ...]) -> bytes:
        def formatted(found: re.Match[str]) -> str:
            kind = found["kind"]
            if kind.startswith("{"):
                assert isinstance(value, int)
                return kind[1:-1].split("|")[value]
            return ("%" + found["flags"] + found["width"] + kind) % value

        return _FORMAT.sub(formatted, self._text(token, arguments)).encode()

    def _taken(self, token: str, answer: str, arguments: tuple[str, ...], outcome: Outcome) -> bool:
        text = self._text(token, arguments)
        place = 0
        for found in [*_FORMAT.finditer(text), None]:
            literal = text[place : found.start()] if found else text[place:]
            if not answer.startswith(literal):
                return False
            answer = answer[len(literal) :]
            if found is None:
                # Whatever is left over was not expected either.
                return not answer
            place = found.end()
            length = _converted(found, answer, outcome)
            if length is None:
                return False
            answer = answer[length:]
        return True


def _statements(tokens: list[str]) -> list[Statement]:
    found = []
    while (word := tokens.pop(0)) != "}":
        if word == ";":
            continue
        arguments = []
        if word.startswith("@"):
            assert tokens.pop(0) == "{"
            arguments = [statement.word for statement in _statements(tokens)]
        else:
            while (token := tokens.pop(0)) != ";":
                arguments.append(token)
        found.append(Statement(word, arguments))
    return found


def _converted(found: re.Match[str], answer: str, outcome: Outcome) -> int | None:
    """How much of the answer a format takes; None where it does not fit."""
    kind = found["kind"]
    if kind == "c":
        width = int(found["width"] or 1)
        return width if len(answer) >= width else None
    if kind.startswith("{"):
        for index, choice in enumerate(kind[1:-1].split("|")):
            if answer.startswith(choice):
                if found["record"] is not None:
                    outcome.elsewhere[found["record"]] = index
                else:
                    outcome.values.append(index)
                return len(choice)
        return None
    pattern = r"[+-]?\d+" if kind == "d" else r"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?"
    number = re.match(pattern, answer)
    if number is None:
        return None
    outcome.values.append(float(number[0]))
    return number.end()
