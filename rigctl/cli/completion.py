"""The command that prints what a shell needs to complete our commands, options and files.

The scripts hold all that they complete: a shell asks no program of ours while somebody types.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated

import typer

from rigctl.cli.definitions import Definition, Parameter, definitions
from rigctl.cli.io import say
from rigctl.core.errors import ConfigError

app = typer.Typer(add_completion=False)

SUFFIXES = {"STORE": ".rig.sqlite", "RIG": ".toml", "CAMPAIGN": ".toml"}
"""How names of files end, by a word of the placeholder they stand for; any file stands for the others."""

# The cases set `next`, `options` and `suffix`. Directories are offered with files, which may be in them.
BASH = """\
_rigctl() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" next="" options="" suffix="" IFS=$' \\t\\n'
    case "$COMP_CWORD ${{COMP_WORDS[1]}}" in
{next}
    esac
    case "${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}} " in
{commands}
    esac
    case "${{COMP_WORDS[COMP_CWORD-1]}}" in
{values}
    esac
    COMPREPLY=()
    if [[ -n "$next" ]]; then
        COMPREPLY=( $(compgen -W "$next" -- "$current") )
    elif [[ "$current" == -* ]]; then
        COMPREPLY=( $(compgen -W "$options" -- "$current") )
    elif [[ -n "$suffix" ]]; then
        IFS=$'\\n'
        COMPREPLY=( $(compgen -f -X "!*@($suffix)" -- "$current"; compgen -d -- "$current") )
        compopt -o filenames 2>/dev/null
    fi
    return 0
}}
shopt -s extglob
complete -o default -F _rigctl rigctl"""

ZSH = """\
#compdef rigctl
_rigctl() {{
    local next="" options="" suffix=""
    case "$((CURRENT - 1)) ${{words[2]}}" in
{next}
    esac
    case "${{words[2]}} ${{words[3]}} " in
{commands}
    esac
    case "${{words[CURRENT-1]}}" in
{values}
    esac
    if [[ -n "$next" ]]; then
        compadd -- ${{=next}}
    elif [[ "$PREFIX" == -* ]]; then
        compadd -- ${{=options}}
    elif [[ -n "$suffix" ]]; then
        _files -g "*($suffix)(-.)"
    else
        _files
    fi
}}
(( $+functions[compdef] )) || {{ autoload -Uz compinit && compinit }}
compdef _rigctl rigctl"""


@app.command()
def completion(
    shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")],
) -> None:
    """Print the script with which a shell completes commands, options and files."""
    commands = tuple(definitions())
    if shell in ("bash", "zsh"):
        say({"bash": BASH, "zsh": ZSH}[shell].format_map(_cases(commands)))
    elif shell == "fish":
        say("\n".join(_fish(commands)))
    else:
        raise ConfigError(f"no completion for {shell!r}; write bash, zsh or fish")


def _suffixes(parameters: Iterable[Parameter]) -> str:
    """How the files that these parameters take may end, with | between; empty for any file."""
    found = [SUFFIXES[word] for parameter in parameters for word in SUFFIXES if word in parameter.value]
    return "|".join(dict.fromkeys(found))


def _next_words(commands: Sequence[Definition]) -> dict[str, list[str]]:
    """The words that continue a command: behind "", behind the name of each group of commands."""
    words: dict[str, dict[str, None]] = {"": {}}
    for command in commands:
        first, *part = command.name.split()
        words[""][first] = None
        for word in part:
            words.setdefault(first, {})[word] = None
    return {before: list(each) for before, each in words.items()}


def _option_names(command: Definition) -> list[str]:
    return [*(name for option in command.options for name in option.names), "--help"]


def _cases(commands: Sequence[Definition]) -> dict[str, str]:
    """The cases of the scripts, which bash and zsh read alike."""
    of_suffix: dict[str, dict[str, None]] = {}
    for option in (option for command in commands for option in command.options if option.value):
        of_suffix.setdefault(_suffixes([option]), {}).update(dict.fromkeys(option.names))
    return {
        "next": _lines(
            (f'"2 {before}"' if before else '"1 "*', f'next="{" ".join(words)}"')
            for before, words in _next_words(commands).items()
        ),
        "commands": _lines(
            (f'"{each.name} "*', f'options="{" ".join(_option_names(each))}"; suffix="{_suffixes(each.arguments)}"')
            for each in commands
        ),
        "values": _lines(("|".join(names), f'suffix="{suffix}"') for suffix, names in of_suffix.items()),
    }


def _lines(cases: Iterable[tuple[str, str]]) -> str:
    return "\n".join(f"        {pattern}) {settings} ;;" for pattern, settings in cases)


def _fish(commands: Sequence[Definition]) -> Iterator[str]:
    seen = "__fish_seen_subcommand_from"
    words = _next_words(commands)
    yield "complete -c rigctl -f"
    for group in (before for before in words if before):
        yield f"complete -c rigctl -n __fish_use_subcommand -a {group}"
    for command in commands:
        first, *part = command.name.split()
        place = f"{seen} {first}; and not {seen} {' '.join(words[first])}" if part else "__fish_use_subcommand"
        yield f"complete -c rigctl -n '{place}' -a {(part or [first])[0]} -d {_quoted(command.summary)}"
        inside = "; and ".join(f"{seen} {word}" for word in (first, *part))
        for option in command.options:
            longs = " ".join(f"-l {name.removeprefix('--')}" for name in option.names)
            takes = f" -r{_files(_suffixes([option]))}" if option.value else ""
            yield f"complete -c rigctl -n '{inside}' {longs}{takes} -d {_quoted(option.help)}"
        if command.arguments:
            yield f"complete -c rigctl -n '{inside}'{_files(_suffixes(command.arguments))}"


def _files(suffixes: str) -> str:
    """That fish completes files, those that end so."""
    each = "; ".join(f"__fish_complete_suffix {suffix}" for suffix in suffixes.split("|") if suffix)
    return f" -a '({each})'" if each else " -F"


def _quoted(text: str) -> str:
    """As fish reads it."""
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
