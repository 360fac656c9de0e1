"""What the console says of itself: the help, as F1 shows it, and the command palette."""

from __future__ import annotations

EVERYWHERE = """\
EVERYWHERE
  F8        STOP: every instrument to rest, now; a campaign is aborted
            (r on screen 2 resumes it). Ctrl+X does the same.
  1 .. 5    the screens: Rig, Campaign, Results, Workbench, Log
            (F2 .. F6 also while you write in an entry)
  o         open a rig file, a campaign file, a store or a plug-in
  F9        answer what the campaign asks: write the word, press Enter
  Ctrl+P    everything by name          b  bell on or off
  t         colours                     q  quit: a campaign goes on
  , .       pages of a screen           u  undo
  Esc       leave an entry, a search    k  cancel what is worked out
  Tab, ↑ ↓  to the next entry or plot, in lists and tables

IN A PLOT ← → ↑ ↓ from point to point, Home End PgUp PgDn to the ends,
          + - closer and back, Shift with arrows aside, 0 all of it,
          Enter shows the run, or the version, that a point is
"""

SCREENS = {
    "rig": """\
1 RIG       ↑ ↓ choose an instrument; m move, h home, [ ] jog, j step,
            c connect. While a campaign holds the rig, this shows what
            its store tells.
""",
    "campaign": """\
2 CAMPAIGN  e edit, Ctrl+S save, d dry run, s start, p pause,
            r resume, a abort; among the steps ↑ ↓ choose a run, Enter
            shows its samples, m leaves it out or uses it again.
            It runs in a process of its own: quitting the console,
            or losing it, does not end it.
""",
    "results": """\
3 RESULTS   f work out, v compare with another store, w write a report,
            figures, a certificate or a bundle
""",
    "workbench": """\
4 WORKBENCH f fit, g diagnose, a add, x remove, n next, v residuals
            against another covariate, m leave the run that is shown out,
            w write what to measure next as a campaign, or what nothing
            describes as a plug-in
""",
    "log": """\
5 LOG       / search, w alarms only
""",
}

SIGNS = """\
SIGNS  ● ready  ▶ moving  ■ stopped  ✗ lost or failed  ✓ passed  ? silent
"""


def text_for(screen: str) -> str:
    """All keys, those of a screen first."""
    others = "".join(text for name, text in SCREENS.items() if name != screen)
    return "\n".join((SCREENS[screen], EVERYWHERE, others, SIGNS))


COMMANDS: dict[str, tuple[str, str]] = {
    "STOP": ("stop", "Bring every instrument to rest, abort the campaign (F8)"),
    "Open…": ("open", "A rig file, a campaign file, a store or a plug-in (o)"),
    "Answer the campaign": ("answer", "What it asks the operator (F9)"),
    "Undo": ("undo", "Take the last change back: of the model, of an entry of a form (u)"),
    "Cancel": ("cancel", "Give up what is being worked out (k)"),
    "Page: next": ("step_page(1)", "Of the screen that is shown (.)"),
    "Page: previous": ("step_page(-1)", "Of the screen that is shown (,)"),
    "Screen: Rig": ("screen('rig')", "Instruments and charts (1)"),
    "Screen: Campaign": ("screen('campaign')", "Start, progress, what the runs tell (2)"),
    "Screen: Results": ("screen('results')", "Tables, plots, comparison (3)"),
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
    "Campaign: mark run": ("pane('campaign', 'mark')", "Leave the chosen run out, or use it again (m)"),
    "Campaign: edit": ("pane('campaign', 'edit')", "The file as a form (e)"),
    "Results: update": ("pane('results', 'update')", "Work the result out anew (f)"),
    "Results: compare": ("pane('results', 'compare')", "With the runs of another store (v)"),
    "Results: write": ("pane('results', 'write')", "A report, figures, a certificate, a bundle (w)"),
    "Workbench: fit": ("pane('workbench', 'ask', 'fit')", "Fit the current model (f)"),
    "Workbench: diagnose": ("pane('workbench', 'ask', 'diagnose')", "Which effect is missing? (g)"),
    "Workbench: add effect": ("pane('workbench', 'add')", "A new version of the model (a)"),
    "Workbench: remove effect": ("pane('workbench', 'remove')", "A new version without it (x)"),
    "Workbench: next measurement": ("pane('workbench', 'ask', 'recommend')", "What would decide (n)"),
    "Workbench: write": ("pane('workbench', 'write')", "The next campaign, a drafted plug-in, a report (w)"),
    "Workbench: residuals against": ("pane('workbench', 'covariate')", "Pick the covariate (v)"),
    "Log: search": ("pane('log', 'search')", "In everything that happened (/)"),
    "Log: alarms only": ("pane('log', 'alarms')", "Or everything again (w)"),
    "Bell on or off": ("mute", "Alarms and questions ring (b)"),
    "Workbench: mark run": ("pane('workbench', 'mark')", "Leave the run that is shown out, or use it again (m)"),
    "Colours": ("theme", "Dark, light, high contrast, amber for eyes used to the dark (t)"),
    "Help": ("help", "Keys (F1)"),
    "Quit": ("leave", "The campaign goes on (q)"),
}
"""Action and explanation of each command."""
