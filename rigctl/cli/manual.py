"""The command that prints the manual page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.metadata import version

import typer

from rigctl.cli.definitions import Definition, Parameter, definitions
from rigctl.cli.io import say

app = typer.Typer(add_completion=False)

HEAD = """\
.TH RIGCTL 1 "" "rigctl {version}" "User commands"
.SH NAME
rigctl \\- instrument control and model building for precision accelerometer calibration
.SH SYNOPSIS
.B rigctl
.I COMMAND
[\\fIARGUMENTS\\fR] [\\fIOPTIONS\\fR]
.SH DESCRIPTION
rigctl drives the instruments of a laboratory rig, real or simulated, through a campaign, keeps every sample in a
store, and works out the result with its uncertainty. Where a model does not describe the data it says where it
fails, which physical effect is missing, and what to measure next.
.PP
Results go to stdout, progress and messages to stderr. With \\fB\\-\\-json\\fR stdout holds one JSON document.
.SH COMMANDS"""

TAIL = """\
.SH FILES
.TP
.I CAMPAIGN.toml
What to do; names the rig file.
.TP
.I RIG.toml
With which instruments, and where they are.
.TP
.I STORE
A campaign's file, by convention \\fINAME.rig.sqlite\\fR: every sample, event and model version.
.SH ENVIRONMENT
.TP
.B RIGCTL_TRACEBACK
Set to 1, a bug is shown with its traceback.
.TP
.B RIGCTL_BROWSER
The browser that prints certificates as PDF.
.SH EXIT STATUS
.TP
.B 0
Done.
.TP
.B 1
The work failed; one line on stderr says what, where and how to mend it.
.TP
.B 2
Wrong usage or bad input; nothing was moved.
.TP
.B 130
Aborted by the operator.
.SH EXAMPLES
.nf
rigctl demo
rigctl run campaigns/my\\-first.toml \\-\\-yes
rigctl compare my\\-first.rig.sqlite
.fi"""


@app.command()
def man() -> None:
    """Print the manual page: `rigctl man | man -l -`."""
    say("\n".join([HEAD.format(version=version("rigctl")), *_commands(), TAIL]))


def _commands() -> Iterator[str]:
    for command in definitions():
        yield f".SS rigctl {_synopsis(command)}"
        yield from _paragraphs(command.help)
        for parameter in command.parameters:
            yield ".TP"
            yield _named(parameter)
            yield _text(parameter.help) or "\\&"


def _synopsis(command: Definition) -> str:
    words = [command.name]
    for parameter in command.parameters:
        words.append(_named(parameter) if parameter.required else f"[{_named(parameter)}]")
    return " ".join(words)


def _named(parameter: Parameter) -> str:
    """An argument, or an option's names with the placeholder of its value."""
    names = ", ".join(f"\\fB{_text(name)}\\fR" for name in parameter.names)
    value = f"\\fI{_text(parameter.value)}\\fR" if parameter.value else ""
    return " ".join(filter(None, [names, value]))


def _paragraphs(text: str) -> Iterator[str]:
    for number, paragraph in enumerate(re.split(r"\n\s*\n", text)):
        if number:
            yield ".PP"
        yield _text(paragraph)


def _text(text: str) -> str:
    """Words as roff takes them: as one line, nothing in it a request or an escape."""
    plain = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{plain}" if plain.startswith((".", "'")) else plain
