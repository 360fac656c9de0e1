"""Campaigns in processes of their own: started, and told that the terminal is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from textual.message import Message

from rigctl.console.messages import CampaignEnded, Launch


class Campaigns:
    """The campaigns this console has started; they outlive it."""

    def __init__(self, post: Callable[[Message], object]) -> None:
        self._post = post
        self._running: dict[Path, subprocess.Popen[bytes]] = {}
        self._investigated: set[Path] = set()

    def start(self, launch: Launch, plugins: Sequence[Path]) -> None:
        """`rigctl run` or `rigctl investigate`, detached from this terminal."""
        what = "investigate" if launch.investigate else "run"
        arguments = [what, str(launch.campaign), "--store", str(launch.store)]
        arguments += ["--rig", str(launch.rig)] if launch.rig else []
        arguments += ["--seed", str(launch.seed)] if launch.seed is not None else []
        arguments += ["--max-runs", str(launch.max_runs)] if launch.max_runs is not None else []
        arguments += ["--yes"] if launch.unattended else []
        self._spawn(launch.store, [*arguments, *_options(plugins)])
        if launch.investigate:
            self._investigated.add(launch.store)

    def investigates(self, store: Path) -> bool:
        """Whether an investigation that was started here goes on, also while nothing is measured."""
        process = self._running.get(store)
        return store in self._investigated and process is not None and process.poll() is None

    def resume(self, store: Path, plugins: Sequence[Path]) -> None:
        """`rigctl resume` of a campaign whose process has ended, detached."""
        self._spawn(store, ["resume", str(store), *_options(plugins)])

    def signal(self, store: Path, number: signal.Signals) -> bool:
        """Pass a signal on to the campaign this console started into `store`; False when there is none."""
        process = self._running.get(store)
        if process is None or process.poll() is not None:
            return False
        process.send_signal(number)
        return True

    def _spawn(self, store: Path, arguments: list[str]) -> None:
        # It answers through the store. Its standard input has a writer as long as it lives, itself, and so no end.
        read, write = os.pipe()
        log = log_of(store)
        with log.open("ab") as log_file:
            begun = log_file.tell()
            process = subprocess.Popen(  # noqa: S603
                # The same interpreter: another one on the path may have another version.
                [sys.executable, "-m", "rigctl", *arguments],
                stdin=read,
                stdout=subprocess.DEVNULL,
                stderr=log_file,
                pass_fds=(write,),
                # Not in the terminal's session: a hang-up reaches it only if we pass it on.
                start_new_session=True,
            )
        # Both ends live in the campaign now.
        os.close(read)
        os.close(write)
        self._running[store] = process
        threading.Thread(target=self._wait, args=(store, process, begun), daemon=True).start()

    def _wait(self, store: Path, process: subprocess.Popen[bytes], begun: int) -> None:
        status = process.wait()
        self._post(CampaignEnded(store, status, last_line(store, begun)))


def _options(plugins: Sequence[Path]) -> list[str]:
    return [word for path in plugins for word in ("--plugin", str(path))]


def last_line(store: Path, begun: int = 0) -> str:
    """What a campaign that was started here said last, behind so many bytes of its log; "" where it said nothing."""
    log = log_of(store)
    lines = log.read_bytes()[begun:].decode(errors="replace").splitlines() if log.exists() else []
    return lines[-1] if lines else ""


def log_of(store: Path) -> Path:
    """Where a campaign that was started here says what it would say on a terminal."""
    return store.with_name(store.name + ".log")
