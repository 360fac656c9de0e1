"""Everything the console does, by name: the command palette."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, cast

from textual.command import DiscoveryHit, Hit, Hits, Provider

if TYPE_CHECKING:
    from rigctl.console.app import Console

COMMANDS: dict[str, tuple[str, str]] = {
    "STOP": ("stop", "Bring every instrument to rest, abort the campaign (F8)"),
    "Open…": ("open", "A rig file, a campaign file or a store (o)"),
    "Answer the campaign": ("answer", "What it asks the operator (F9)"),
    "Screen: Rig": ("screen('rig')", "Instruments and charts (1)"),
    "Screen: Campaign": ("screen('campaign')", "Start, progress, null search (2)"),
    "Screen: Results": ("screen('results')", "Axes, scatter, budget (3)"),
    "Screen: Workbench": ("screen('workbench')", "Which effect is missing? (4)"),
    "Screen: Log": ("screen('log')", "Events, alarms, actions (5)"),
    "Rig: connect": ("bench", "Hold the rig that is open, and connect to its instruments"),
    "Rig: release": ("release", "Give the instruments free for others"),
    "Rig: move": ("pane('rig', 'move')", "Move the stage that is chosen (m)"),
    "Rig: home": ("pane('rig', 'home')", "Home the stage that is chosen (h)"),
    "Rig: jog step": ("pane('rig', 'step')", "Size of a jog's step (j)"),
    "Campaign: start": ("pane('campaign', 'begin')", "Start the campaign file that is open (s)"),
    "Campaign: pause": ("pane('campaign', 'ask', 'pause')", "Hold after the run it is in (p)"),
    "Campaign: resume": ("pane('campaign', 'ask', 'resume')", "Go on with a paused or ended one (r)"),
    "Campaign: abort": ("pane('campaign', 'abort')", "End it now; it can be resumed (a)"),
    "Campaign: dry run": ("pane('campaign', 'dry_run')", "What it would do; moves nothing (d)"),
    "Campaign: edit": ("pane('campaign', 'edit')", "The file as a form (e)"),
    "Results: update": ("pane('results', 'update')", "Work the result out anew (u)"),
    "Results: compare": ("pane('results', 'compare')", "With the runs of another store (v)"),
    "Workbench: fit": ("pane('workbench', 'fit')", "Fit the current model (f)"),
    "Workbench: diagnose": ("pane('workbench', 'diagnose')", "Which effect is missing? (g)"),
    "Workbench: add effect": ("pane('workbench', 'add')", "A new version of the model (a)"),
    "Workbench: remove effect": ("pane('workbench', 'remove')", "A new version without it (x)"),
    "Workbench: next measurement": ("pane('workbench', 'next')", "What would decide (n)"),
    "Workbench: residuals against": ("pane('workbench', 'covariate')", "Pick the covariate (v)"),
    "Log: search": ("pane('log', 'search')", "In everything that happened (/)"),
    "Log: alarms only": ("pane('log', 'alarms')", "Or everything again (w)"),
    "Bell on or off": ("mute", "Alarms and questions ring (b)"),
    "Light or dark": ("theme", "Change the colours (t)"),
    "Help": ("help", "Keys (F1)"),
    "Quit": ("leave", "The campaign goes on (q)"),
}


class Commands(Provider):
    """Offers them."""

    async def discover(self) -> Hits:
        """All of them."""
        for name, action, told in _all():
            yield DiscoveryHit(name, partial(self._run, action), help=told)

    async def search(self, query: str) -> Hits:
        """Those that match."""
        matcher = self.matcher(query)
        for name, action, told in _all():
            if (score := matcher.match(name)) > 0:
                yield Hit(score, matcher.highlight(name), partial(self._run, action), help=told)

    async def _run(self, action: str) -> None:
        await cast("Console", self.app).run_action(action)


def _all() -> Iterator[tuple[str, str, str]]:
    for name, (action, told) in COMMANDS.items():
        yield name, action, told
