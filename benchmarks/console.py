"""The console's first paint, the stalls of its event loop while a campaign runs, and its memory over many campaigns.

    python benchmarks/console.py [CAMPAIGNS]

First paint is also given relative to a bare textual application, started in the same way in turn.
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
from pathlib import Path

ROOT = Path(__file__).parents[1]
BARE = """
from textual.app import App
from textual.widgets import Static
class Bare(App):
    def compose(self):
        yield Static('STOP')
Bare().run()
"""
TIMES = 7


def first_paint_s(command: list[str], state: str) -> float:
    """Seconds until a command has written STOP to a terminal of 80 x 24."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    env = dict(os.environ, TERM="xterm-256color", XDG_STATE_HOME=state)
    began_s = time.monotonic()
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True)
    os.close(theirs)
    seen = b""
    while b"STOP" not in seen:
        if select.select([ours], [], [], 30.0)[0]:
            seen += os.read(ours, 65536)
    took_s = time.monotonic() - began_s
    process.kill()
    process.wait()
    os.close(ours)
    return took_s


async def night(directory: Path, campaigns: int) -> None:
    """Campaigns one after the other at full virtual speed, watched: stalls and memory."""
    from rigctl.console.app import Console
    from rigctl.console.messages import Launch, StartAsked

    lateness_s: list[float] = []

    async def tick() -> None:
        while True:
            began_s = time.monotonic()
            await asyncio.sleep(0.005)
            lateness_s.append(time.monotonic() - began_s - 0.005)

    app = Console(ROOT / "campaigns" / "isa-flight-model.toml", directory=directory / "state")
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause(5.0)
        ticking = asyncio.create_task(tick())
        for number in range(campaigns):
            store = directory / f"{number}.rig.sqlite"
            lateness_s.clear()
            await pilot.press("1" if number % 2 else "2")
            app.post_message(StartAsked(Launch(ROOT / "campaigns" / "isa-flight-model.toml", store, unattended=True)))
            while app._view is None or app._view.path != store or app._view.state != "done":
                await asyncio.sleep(0.1)
            late = sorted(lateness_s)
            worst = " ".join(
                f"{share:g} %: {1e3 * late[int(share / 100 * (len(late) - 1))]:.1f} ms"
                for share in (50, 99, 99.9, 100)
            )
            rss_mib = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
            runs, screen = len(app._view.runs), app.kept.screen
            print(
                f"campaign {number + 1}, {runs} runs, screen {screen}: stalls {worst}; {rss_mib:.1f} MiB", flush=True
            )
        ticking.cancel()


def main() -> None:
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    with tempfile.TemporaryDirectory() as name:
        console, bare = [], []
        for _ in range(TIMES):
            console.append(first_paint_s([sys.executable, "-m", "rigctl.cli", "console"], name))
            bare.append(first_paint_s([sys.executable, "-c", BARE], name))
        ours, theirs = statistics.median(console), statistics.median(bare)
        ratio = ours / theirs
        print(
            f"first paint {ours:.2f} s (best {min(console):.2f}), bare textual {theirs:.2f} s: {ratio:.2f}",
            flush=True,
        )
        asyncio.run(night(Path(name), campaigns))


if __name__ == "__main__":
    main()
