"""What shells and `man` get of the commands: completion as bash really does it, the manual page as groff reads it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.application import app
from rigctl.cli.definitions import definitions

SHELLS = ("bash", "zsh", "fish")

COMPLETED = [
    ("rigctl diag", {"diagnose"}),
    ("rigctl re", {"resume", "result", "report", "replay"}),
    ("rigctl model a", {"add"}),
    ("rigctl diagnose --al", {"--alpha"}),
    ("rigctl mark a.rig.sqlite 3 --in", {"--invalid"}),
    ("rigctl model add ", {"a.rig.sqlite", "b c.rig.sqlite", "campaigns"}),
    ("rigctl run ", {"x.toml", "campaigns"}),
    ("rigctl run campaigns/", {"campaigns/d.toml"}),
    ("rigctl run x.toml --store ", {"a.rig.sqlite", "b c.rig.sqlite", "campaigns"}),
    ("rigctl compare a.rig.sqlite --plugin ", set()),  # any file: bash's own
]


def script(shell: str) -> str:
    printed = CliRunner().invoke(app, ["completion", shell])
    assert printed.exit_code == 0, printed.output
    return printed.stdout


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("desk")
    (directory / "campaigns").mkdir()
    for name in ("a.rig.sqlite", "b c.rig.sqlite", "x.toml", "y.txt", "campaigns/d.toml"):
        (directory / name).touch()
    return directory


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash")
def test_bash_completes_commands_options_and_files(desk: Path) -> None:
    asked = "\n".join(
        f"COMP_WORDS=({typed}{' ' * typed.endswith(' ')}{repr('') * typed.endswith(' ')}); "
        'COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 )); _rigctl; (IFS="|"; echo "${COMPREPLY[*]}")'
        for typed, _ in COMPLETED
    )
    bash = subprocess.run(
        ["bash", "--norc", "-c", f"{script('bash')}\n{asked}"], cwd=desk, capture_output=True, text=True, check=True
    )
    assert bash.stderr == ""
    found = [set(filter(None, line.split("|"))) for line in bash.stdout.splitlines()]
    assert dict(zip((typed for typed, _ in COMPLETED), found, strict=True)) == dict(COMPLETED)


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_and_option_is_completed(shell: str) -> None:
    text = script(shell)
    for command in definitions():
        assert all(word in text for word in command.name.split())
        for option in command.options:
            for name in option.names:
                assert (f"-l {name[2:]}" if shell == "fish" else name) in text, (command.name, name)


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_are_such_that_their_shell_reads_them(shell: str) -> None:
    if not shutil.which(shell):
        pytest.skip(f"no {shell}")
    read = subprocess.run([shell, "-n"], input=script(shell), capture_output=True, text=True, check=False)
    assert (read.returncode, read.stderr) == (0, "")


def test_another_shell_is_refused() -> None:
    refused = CliRunner().invoke(app, ["completion", "csh"])
    assert str(refused.exception) == "no completion for 'csh'; write bash, zsh or fish"


def test_the_manual_page_has_every_command_and_option() -> None:
    page = CliRunner().invoke(app, ["man"]).stdout
    if shutil.which("groff"):
        command = ["groff", "-man", "-Tascii", "-ww", "-P-cbou", "-rLL=2000n"]
        formatted = subprocess.run(command, input=page, capture_output=True, text=True, check=True)
        assert formatted.stderr == ""
        sections = formatted.stdout.split("\n   rigctl ")
    else:
        sections = page.replace("\\-", "-").split("\n.SS rigctl ")
    for each in definitions():
        (section,) = [section for section in sections if f"{section.splitlines()[0]} ".startswith(f"{each.name} ")]
        assert " ".join(each.summary.split()[:3]) in section
        for option in each.options:
            assert all(name in section for name in option.names), each.name
