"""The command that shows the whole story on a simulated bench."""

from __future__ import annotations

import contextlib
import shlex
import shutil
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from rigctl.campaign.store.store import Store
from rigctl.cli.application import app as rigctl
from rigctl.cli.io import say
from rigctl.core.errors import ConfigError, RigError
from rigctl.core.making_safe import ended_by_signals
from rigctl.files.shipped import shipped_campaigns
from rigctl.workbench.model.versions import last_diagnosis

app = typer.Typer(add_completion=False)

CAMPAIGN, RIG, FIRST = "campaigns/demo.toml", "campaigns/demo-rig.toml", "campaigns/my-first.toml"
SERVED, STORE, REPORT = "served.toml", "demo.rig.sqlite", "report.html"


@app.command()
def demo(
    directory: Annotated[
        Path, typer.Option("--dir", metavar="DIR", help="A new directory, in which everything stays.")
    ] = Path("rigctl-demo"),
) -> None:
    """Two minutes: a simulated bench is measured, its model fails, what it lacks is named and added."""
    try:
        directory.mkdir()
    except FileExistsError:
        raise ConfigError(f"{directory} is there already; name a new directory with --dir, or remove it") from None
    shutil.copytree(shipped_campaigns(), directory / "campaigns")
    # While the campaign runs it takes over: then a signal stops the instruments first.
    with contextlib.chdir(directory), ended_by_signals(lambda _: None, leave_s=0.0):
        _story()
    _tell(
        f"""Everything stays in {directory}: the store {STORE}, the report {REPORT}, and in campaigns/ the rig and
        campaign files that the documentation uses. Open {(directory / REPORT).absolute().as_uri()} in a browser. To
        go on:"""
    )
    for command, purpose in (
        (f"cd {shlex.quote(str(directory))}", ""),
        (f"rigctl console {STORE}", "the operator's console: all of this by keys"),
        (f"rigctl run {FIRST} --yes", "a campaign to make your own; read it, change it"),
        (f"rigctl compare {Path(FIRST).stem}.rig.sqlite", "and does its model hold?"),
        ("rigctl man | man -l -", "every command"),
    ):
        say(f"  {command:<44} {purpose}".rstrip())


def _story() -> None:
    _tell(
        """An accelerometer on a bench: a linear stage shakes it, a rotation stage tilts it, a voltmeter reads it. The
        instruments are simulated, and speak on local ports the bytes that the real ones speak."""
    )
    with _simulated():
        _tell(
            """The rig file that was written has these addresses, and nothing of the simulated nature behind them.
            Twenty-four runs take ten minutes of the bench, which goes forty times as fast as the clock. They tell the
            null, the angle at which the sensor does not feel the motion; an axis would take more mountings, and
            lasers."""
        )
        _type("run", CAMPAIGN, "--rig", SERVED, "--store", STORE, "--yes")
    _tell("Does the model of the campaign file describe what was measured, within the noise?")
    _type("compare", STORE)
    _tell(
        """Which effect is missing? Each effect of a catalogue is fitted beside the model, and has to help on runs
        that were left out of the fit."""
    )
    _type("diagnose", STORE)
    suggested = _suggested()
    _tell("What it suggests becomes a new version of the model; the old one stays.")
    _type("model", "add", STORE, *suggested)
    _type("compare", STORE)
    _tell("What did it bring? Errors in units of the noise, on the runs of the fit and on runs left out of it.")
    _type("model", "history", STORE)
    _tell(f"And what had nature? In [world] of {RIG}, which only the simulators read, stands {_nature()}.")
    _tell("What remains open, and which runs would tell most?")
    _type("next", STORE)
    _tell("The whole of it as one file:")
    _type("report", STORE, "--out", REPORT)


@contextlib.contextmanager
def _simulated() -> Iterator[None]:
    """`rigctl simulate` in a process of its own, as at another terminal, until the block is left."""
    words = ["simulate", RIG, "--write-rig", SERVED]
    _show([*words, "&"])
    # In a session of its own: Ctrl-C must not take the instruments away before they have been brought to rest.
    with subprocess.Popen(  # noqa: S603 - this program
        [sys.executable, "-m", "rigctl", *words], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            assert process.stdout is not None
            for line in process.stdout:
                say(line.rstrip())
                if line.startswith("name=operator "):  # the last
                    break
            else:
                raise RigError("the simulated instruments did not start; try the command above by itself")
            yield
        finally:
            process.terminate()


def _suggested() -> list[str]:
    """What the diagnosis in the store suggests; `RigError` when that is nothing."""
    with Store.open(Path(STORE), readonly=True) as store:
        diagnosis = last_diagnosis(store)
    if not diagnosis or not diagnosis["suggested"]:
        raise RigError(f"{STORE}: the diagnosis suggests nothing; look at it with `rigctl diagnose {STORE}`")
    return list(diagnosis["suggested"])


def _nature() -> str:
    """The simulated world's effects that the campaign's model lacks, with their sizes."""
    believed = tomllib.loads(Path(CAMPAIGN).read_text(encoding="utf-8"))["model"]["effects"]
    acting = tomllib.loads(Path(RIG).read_text(encoding="utf-8"))["world"]["effects"]
    return ", ".join(
        f"{effect}, {name} = {value:g}"
        for effect, sizes in acting.items()
        if effect not in believed
        for name, value in sizes.items()
    )


def _type(*words: str) -> None:
    """A command as a user types it, and what it prints."""
    _show(words)
    rigctl(list(words), prog_name="rigctl", standalone_mode=False)


def _show(words: Sequence[str]) -> None:
    say(f"\n$ rigctl {' '.join(words)}")
    # What commands tell on stderr comes after it.
    sys.stdout.flush()


def _tell(text: str) -> None:
    say("\n" + textwrap.fill(" ".join(text.split()), 100, break_long_words=False, break_on_hyphens=False))
