"""The console's first paint, the stalls of its event loop while campaigns run, what a frame costs, and its memory.

    python benchmarks/console.py [paint|switch|watch|live|night] ...

`paint`: processor time, of all threads, until STOP is written, and until the last screen has answered a key that was
typed ahead, all five being there; relative to a bare textual application, started in the same way in turn. `switch`:
processor time from a key to another screen of a store of one axis, relative to that of an application without any
content whose plain widgets are as many, as large and nested alike. `watch`: share of a core while nobody does
anything, each screen in turn, of a store that is over and of a campaign in real time. `live`: the screen Rig at
160 x 50, the rig held by the console, charts at 10 Hz, the event loop's lateness, and the processor time of its
thread per frame, which tells more than lateness does where other work shares the computer. `night`: campaigns of the
flight model one after the other at full virtual speed until two nights of rig time are over, watched all the while.
"""

from __future__ import annotations

import asyncio
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.on_terminal import WATCHED, OnTerminal, processor_s

ROOT = Path(__file__).parents[1]
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
BARE_SCREENS = """
import json, sys
from textual.app import App
from textual.containers import Container
from textual.widgets import ContentSwitcher, Static
class Rest(Static, can_focus=True):
    pass
def plain(of):
    if of["children"]:
        made = Container(*map(plain, of["children"]))
        made.styles.layout = of["layout"]
    else:
        width, height = of["size"]
        made = (Rest if of["focus"] else Static)("\\n".join(["." * width] * height), markup=False)
    if of["shown"]:
        made.styles.width, made.styles.height = of["size"]
    made.display = of["shown"]
    return made
class Bare(App):
    CSS = "Screen { overflow: hidden; } #title { dock: top; }"
    BINDINGS = [(key, f"go('{key}')", key) for key in "12345"]
    def compose(self):
        yield Static("[1 ]", id="title", markup=False)
        with ContentSwitcher(initial="s1"):
            for number, screen in enumerate(json.loads(sys.argv[1])):
                yield Container(plain(screen), id=f"s{number + 1}")
    def action_go(self, key):
        self.query_one(ContentSwitcher).current = f"s{key}"
        self.query_one("#title", Static).update(f"[{key} ]")
        self.screen.set_focus(next(iter(self.query_one(f"#s{key}").query(Rest)), None))
Bare().run()
"""
"""Five screens of plain widgets, nested and as large as those it is told of; its title is the screen's key."""

TIMES = 7
SWITCHES = 15
WATCHED_S = 10.0
TICK_S = 0.005
SHARES = (50, 99, 99.9, 100)
LIVE_S, LIVE_MOVES = 30.0, 6
NIGHT_S = 36.0 * 3600.0
CAMPAIGN = ROOT / "campaigns" / "isa-flight-model.toml"


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
    tried = {
        "bare textual": (BARE, "STOP", b""),
        "first paint": (OURS, "STOP", b""),
        "all screens": (OURS, "[5 Log]", b"5"),
    }
    took_s: dict[str, list[float]] = {name: [] for name in tried}
    for number in range(TIMES + 1):
        for name, (program, word, keys) in tried.items():
            seconds = processor_s(program, word, str(directory), keys)
            if number:
                took_s[name].append(seconds)
    bare = took_s["bare textual"]
    for name, each in took_s.items():
        median_s, ratio = statistics.median(each), statistics.median(each) / statistics.median(bare)
        best = f"best {min(each):.2f} s, {min(each) / min(bare):.2f}"
        print(f"{name:12} {median_s:.2f} s of processor, {ratio:.2f} of the bare one's ({best})", flush=True)


RIGCTL = (sys.executable, "-m", "rigctl")
ONE_AXIS = ROOT / "campaigns" / "one-axis.toml"


async def trees(store: Path) -> list[Any]:
    """The widgets of the five screens of a store, nested: what each is laid out as, its size, whether it is shown."""
    from rigctl.console.app import Console

    def tree(widget: Any) -> Any:
        return {
            "layout": "horizontal" if getattr(widget.styles.layout, "name", "") == "horizontal" else "vertical",
            "size": list(widget.size),
            "shown": bool(widget.display),
            "focus": widget.has_focus,
            "children": [tree(child) for child in widget.children],
        }

    found, app = [], Console(store)
    async with app.run_test(size=(120, 40)) as pilot:
        while app.keys_wait:
            await pilot.pause(0.05)
        for key, name in zip("12345", ("rig", "campaign", "results", "workbench", "log"), strict=True):
            await pilot.press(key)
            await pilot.pause(3.0)
            found.append(tree(app.screen.query_one(f"#{name}")))
    return found


def switch(directory: Path) -> None:
    """From key to screen, ours and a bare application's."""
    store, state = directory / "one-axis.rig.sqlite", str(directory / "state")
    subprocess.run([*RIGCTL, "run", ONE_AXIS, "--store", store, "--yes"], check=True, capture_output=True)
    commands = {
        "bare": (sys.executable, "-c", BARE_SCREENS, json.dumps(asyncio.run(trees(store)))),
        "ours": (*RIGCTL, "console", str(store)),
    }
    took_ms: dict[str, list[list[float]]] = {name: [] for name in commands}
    with ExitStack() as stack:
        programs = {name: stack.enter_context(OnTerminal(state, *command)) for name, command in commands.items()}
        for program in programs.values():
            program.sees("[")
            # Each screen once first, and what a store's opening works out.
            for key in "54321":
                program.press(key, f"[{key} ")
            program.idle(10.0)
        # In turn: how fast the computer is changes.
        for _ in range(SWITCHES):
            for name, program in programs.items():
                took_ms[name].append([])
                for key in "23451":
                    begun_s = program.processor_s
                    program.press(key, f"[{key} ")
                    program.idle(0.2)  # what comes after the first paint is the switch's too
                    took_ms[name][-1].append(1e3 * (program.processor_s - begun_s))
    bare_ms = statistics.median(map(statistics.mean, took_ms["bare"]))
    for name, rounds in took_ms.items():
        median_ms = statistics.median(map(statistics.mean, rounds))
        screens = " ".join(f"{statistics.mean(each):.0f}" for each in zip(*rounds, strict=True))
        print(
            f"{name}: {median_ms:.0f} ms of processor a switch, {median_ms / bare_ms:.2f} of the bare one's;"
            f" to screens 2, 3, 4, 5, 1: {screens}",
            flush=True,
        )


def watch(directory: Path) -> None:
    """Of a core, while nobody does anything."""
    over, state = directory / "over.rig.sqlite", str(directory / "state")
    subprocess.run([*RIGCTL, "run", ONE_AXIS, "--store", over, "--yes"], check=True, capture_output=True)
    shares_of(over, "a store that is over", state)
    running, rig = directory / "running.rig.sqlite", directory / "real.toml"
    rig.write_text((ROOT / "campaigns" / "isa-rig.toml").read_text().replace('clock = "virtual"', 'clock = "real"'))
    campaign = subprocess.Popen(
        [*RIGCTL, "run", ONE_AXIS, "--rig", rig, "--store", running, "--yes"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        while not running.exists():
            time.sleep(0.2)
        shares_of(running, "a campaign in real time", state)
    finally:
        campaign.kill()
        campaign.wait()


def shares_of(store: Path, name: str, state: str) -> None:
    """Print the share of a core that each screen of a store takes."""
    with OnTerminal(state, *RIGCTL, "console", str(store)) as program:
        program.sees("[")
        program.press("5", "[5 ")
        program.idle(15.0)
        shares = []
        for key in "12345":
            program.press(key, f"[{key} ")
            program.idle(1.0)
            begun_s = program.processor_s
            program.idle(WATCHED_S)
            shares.append(100.0 * (program.processor_s - begun_s) / WATCHED_S)
    print(f"{name}: {' '.join(f'{share:.1f}' for share in shares)} % of a core on screens 1 to 5", flush=True)


def main() -> None:
    wanted = sys.argv[1:] or ["paint", "switch", "watch", "live", "night"]
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        if "paint" in wanted:
            paint(directory)
        if "switch" in wanted:
            switch(directory)
        if "watch" in wanted:
            watch(directory)
        if "live" in wanted:
            asyncio.run(live(directory))
        if "night" in wanted:
            asyncio.run(night(directory))


if __name__ == "__main__":
    main()
