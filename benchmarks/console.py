"""The console's first paint, the stalls of its event loop while campaigns run, what a frame costs, and its memory.

    python benchmarks/console.py [paint|live|night] ...

`paint`: processor time, of all threads, until STOP is written, and until the last screen has answered a key that was
typed ahead, all five being there; relative to a bare textual application, started in the same way in turn. `live`:
the screen Rig at 160 x 50, the rig held by the console, charts at 10 Hz, the event loop's lateness, and the processor
time of its thread per frame, which tells more than lateness does where other work shares the computer. `night`:
campaigns of the flight model one after the other at full virtual speed until two nights of rig time are over, watched
all the while.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import resource
import select
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
WATCHED = """
import os, sys, time
from textual.drivers.linux_driver import LinuxDriver
word, took = sys.argv[1:]
write = LinuxDriver.write
def noted(driver, data):
    write(driver, data)
    if word in data:
        with open(took, 'w') as file:
            file.write(str(time.process_time()))
        os._exit(0)
LinuxDriver.write = noted
"""
"""Ends with the first text on the terminal that has a word, and leaves the processor time until then in a file."""

BARE = f"""{WATCHED}
from textual.app import App
from textual.widgets import Static
class Bare(App):
    def compose(self):
        yield Static('STOP')
Bare().run()
"""
OURS = f"""{WATCHED}
from rigctl.cli import main
sys.argv = ['rigctl', 'console']
main()
"""
TIMES = 7
TICK_S = 0.005
SHARES = (50, 99, 99.9, 100)
LIVE_S, LIVE_MOVES = 30.0, 6
NIGHT_S = 36.0 * 3600.0
CAMPAIGN = ROOT / "campaigns" / "isa-flight-model.toml"


def processor_s(program: str, word: str, state: str, keys: bytes = b"") -> float:
    """Processor time until a program has written a word to a terminal of 80 x 24 on which keys were typed ahead."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    took = Path(state) / "took"
    command = [sys.executable, "-c", program, word, str(took)]
    # As installed: an index's installer compiles all modules, so none is compiled at a start.
    env = dict(os.environ, TERM="xterm-256color", XDG_STATE_HOME=state, PYTHONPYCACHEPREFIX=f"{state}/compiled")
    env.pop("PYTHONDONTWRITEBYTECODE", None)
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True)
    os.close(theirs)
    os.write(ours, keys)
    while process.poll() is None:
        if select.select([ours], [], [], 0.05)[0]:
            with suppress(OSError):  # it has ended
                os.read(ours, 65536)
    os.close(ours)
    return float(took.read_text())


@dataclass
class Watch:
    """How late the event loop is, and what its thread costs, since `begin`."""

    late_s: list[float] = field(default_factory=list)
    rss_mib: list[float] = field(default_factory=list)
    frames: int = 0
    began_s: float = 0.0
    cpu_s: float = 0.0

    def begin(self) -> None:
        """Forget what was before."""
        self.late_s.clear()
        self.rss_mib.clear()
        self.frames, self.began_s, self.cpu_s = 0, time.monotonic(), time.thread_time()

    async def tick(self) -> None:
        """Runs beside the console."""
        while True:
            began_s = time.monotonic()
            await asyncio.sleep(TICK_S)
            self.late_s.append(time.monotonic() - began_s - TICK_S)
            if len(self.late_s) % 200 == 1:
                self.rss_mib.append(memory_mib())

    def count(self, app: Any) -> None:
        """Count the screen's paints."""
        paint = app.screen._compositor.render_update

        def counting(*arguments: Any, **options: Any) -> Any:
            self.frames += 1
            return paint(*arguments, **options)

        app.screen._compositor.render_update = counting

    def told(self) -> str:
        """Percentiles of lateness, processor time per frame, memory."""
        late = sorted(self.late_s)
        stalls = " ".join(f"{share:g} %: {1e3 * late[int(share / 100 * (len(late) - 1))]:.1f} ms" for share in SHARES)
        cpu_s, took_s = time.thread_time() - self.cpu_s, time.monotonic() - self.began_s
        return (
            f"stalls {stalls}; {self.frames / took_s:.1f} frames/s, "
            f"{1e3 * cpu_s / max(self.frames, 1):.1f} ms of processor each; MiB over time: "
            + " ".join(f"{each:.1f}" for each in [*self.rss_mib[:: max(len(self.rss_mib) // 5, 1)], memory_mib()])
        )


def memory_mib() -> float:
    """Of this process, resident now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


async def live(directory: Path) -> None:
    """The rig held by the console, a stage moving to and fro, charts at 10 Hz."""
    from rigctl.console.app import Console

    rig = directory / "live.toml"
    text = (ROOT / "campaigns" / "isa-rig.toml").read_text().replace('clock = "virtual"', 'clock = "real"')
    rig.write_text(text)
    watch, app = Watch(), Console(rig, directory=directory / "live")
    async with app.run_test(size=(160, 50)) as pilot:
        while app._holding.bench is None or any(v.state == "connecting" for v in app._holding.bench.views()):
            await pilot.pause(0.1)
        ticking = asyncio.create_task(watch.tick())
        watch.count(app)
        for size in ((160, 50), (80, 24)):
            await pilot.resize_terminal(*size)
            await pilot.press("1")
            await pilot.pause(2.0)
            watch.begin()
            for target in range(LIVE_MOVES):
                app._holding.bench.stations["rotation"].move(20.0 * (-1.0) ** target)
                await asyncio.sleep(LIVE_S / LIVE_MOVES)
            print(f"live rig, {size[0]} x {size[1]}: {watch.told()}", flush=True)
        ticking.cancel()


async def night(directory: Path) -> None:
    """Campaigns until two nights of rig time are over, watched on the screens Campaign and Rig in turn."""
    from rigctl.campaign.store.store import Store
    from rigctl.console.app import Console
    from rigctl.console.messages import Launch, StartAsked

    watch, rig_time_s, number = Watch(), 0.0, 0
    app = Console(CAMPAIGN, directory=directory / "state")
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause(5.0)
        ticking = asyncio.create_task(watch.tick())
        watch.count(app)
        while rig_time_s < NIGHT_S:
            store = directory / f"{number}.rig.sqlite"
            watch.begin()
            await pilot.press("1" if number % 2 else "2")
            app.post_message(StartAsked(Launch(CAMPAIGN, store, unattended=True)))
            while app._view is None or app._view.path != store or app._view.state != "done":
                await asyncio.sleep(0.1)
            told = watch.told()
            with Store.open(store, readonly=True) as done:
                rig_time_s += max(event.rig_time_s or 0.0 for event in done.events())
            print(
                f"{rig_time_s / 3600.0:5.1f} h of rig time, {len(app._view.runs)} runs more, screen "
                f"{app.kept.screen}: {told}",
                flush=True,
            )
            number += 1
        ticking.cancel()


def paint(directory: Path) -> None:
    """Ours and a bare application's, in turn; the first of each does not count."""
    tried = {"bare textual": (BARE, "STOP"), "first paint": (OURS, "STOP"), "all screens": (OURS, "[5 Log]", b"5")}
    took_s: dict[str, list[float]] = {name: [] for name in tried}
    for number in range(TIMES + 1):
        for name, (program, word, *keys) in tried.items():
            seconds = processor_s(program, word, str(directory), *keys)
            if number:
                took_s[name].append(seconds)
    bare = took_s["bare textual"]
    for name, each in took_s.items():
        median_s, ratio = statistics.median(each), statistics.median(each) / statistics.median(bare)
        best = f"best {min(each):.2f} s, {min(each) / min(bare):.2f}"
        print(f"{name:12} {median_s:.2f} s of processor, {ratio:.2f} of the bare one's ({best})", flush=True)


def main() -> None:
    wanted = sys.argv[1:] or ["paint", "live", "night"]
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        if "paint" in wanted:
            paint(directory)
        if "live" in wanted:
            asyncio.run(live(directory))
        if "night" in wanted:
            asyncio.run(night(directory))


if __name__ == "__main__":
    main()
