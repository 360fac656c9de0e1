"""A file of effects that hangs, ends the program or changes it is named in one line, and the program goes on."""

from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.core.errors import PluginError
from rigctl.effects import plugin_code, plugins, rehearsal
from rigctl.effects.catalogue import Effect
from rigctl.effects.trial import made_up

EFFECT = """
import os, signal, sys, time
from rigctl.effects import effect
{before}

@effect("drag", on="angle_rad", parameters={{"b": "rad"}}, typical={{"b": 1e-5}})
def drag(run, b):
    \"\"\"A drag.\"\"\"
    {inside}
    return b * run.approach
"""

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(before: str = "", inside: str = "") -> Path:
        path = tmp_path / "my_effects.py"
        path.write_text(EFFECT.format(before=before, inside=inside))
        return path

    return written


EXIT = "ends the program|would end the program"
UNCIVIL = {
    "sys.exit(0)": EXIT,
    "os._exit(0)": EXIT,
    "raise GeneratorExit": EXIT,
    "os.abort()": "ends the program .signal SIGABRT.",
    "os.fork()": "starts a process of its own",
    "print('hello')": "prints to stdout",
    "os.write(1, b'x')": "prints to stdout",
    "signal.signal(signal.SIGTERM, signal.SIG_IGN)": "changes how signals are handled",
}


@pytest.mark.parametrize("where", ["before", "inside"])
@pytest.mark.parametrize("what", UNCIVIL)
def test_what_would_end_or_change_the_program_is_named(write: Write, what: str, where: str) -> None:
    with pytest.raises(PluginError) as raised:
        plugins.load(write(**{where: what}))
    named = "" if where == "before" or "changes" in UNCIVIL[what] or "prints" in UNCIVIL[what] else "effect 'drag'"
    assert re.search(rf"my_effects\.py:? ?{named}.*({UNCIVIL[what]})", str(raised.value)), raised.value
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize(
    ("where", "what"),
    [("before", "time.sleep(600)"), ("inside", "while True:\n        pass")],
    ids=["read", "called"],
)
def test_what_never_returns_is_interrupted(
    write: Write, monkeypatch: pytest.MonkeyPatch, where: str, what: str
) -> None:
    monkeypatch.setattr(rehearsal, "PATIENCE_S", 1.0)
    named = "effect 'drag': " if where == "inside" else ""
    with pytest.raises(PluginError, match=rf"my_effects\.py: {named}takes over 1 s; mend the file"):
        plugins.load(write(**{where: what}))


def test_a_civil_file_is_tried_once(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write()
    plugins.load(path)
    monkeypatch.setattr(rehearsal, "_performed", None)
    assert list(plugins.load(path).effects) == ["drag"]


def only_here(path: Path) -> Effect:
    """The file's effect, as if it had behaved in the other process."""
    (effect,) = plugin_code.effects_of(plugin_code.executed(path, path.read_bytes()))
    return effect


def test_an_exit_in_a_later_call_is_an_error_like_another(write: Write) -> None:
    effect = only_here(write(inside="if b > 1: sys.exit(0)"))
    assert effect(made_up(effect), b=np.asarray(0.5)).shape[1] == 1
    with pytest.raises(PluginError, match=r"my_effects\.py: effect 'drag' raises SystemExit, which would end"):
        effect(made_up(effect), b=np.asarray(2.0))


def test_a_later_call_that_never_returns_is_interrupted_in_whichever_thread(
    write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugin_code, "CALL_PATIENCE_S", 0.2)
    monkeypatch.setattr(plugin_code, "_LOOK_S", 0.05)
    effect = only_here(write(inside="while True:\n        pass"))
    caught: list[BaseException] = []

    def call() -> None:
        try:
            effect(made_up(effect), b=np.asarray(1.0))
        except PluginError as error:
            caught.append(error)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(20.0)
    assert "effect 'drag' does not return within 0.2 s" in str(caught[0])


def test_the_watch_costs_less_than_ten_microseconds_a_call() -> None:
    took = []
    for _ in range(5):
        start = time.process_time()
        for _ in range(1000):
            with plugin_code.WATCH.over(1.0):
                pass
        took.append(time.process_time() - start)
    assert min(took) < 1e-2
