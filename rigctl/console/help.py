"""The help, as F1 shows it."""

TEXT = """\
EVERYWHERE
  F8        STOP: every instrument to rest, now; a campaign is aborted
            (r on screen 2 resumes it). Ctrl+X does the same.
  1 .. 5    the screens: Rig, Campaign, Results, Workbench, Log
            (F2 .. F6 also while you write in an entry)
  o         open a rig file, a campaign file or a store
  F9        answer what the campaign asks: write the word, press Enter
  Ctrl+P    everything by name          b  bell on or off
  t         light or dark               q  quit: a campaign goes on
  Tab, ↑ ↓  to the next entry, in lists and tables

1 RIG       ↑ ↓ choose an instrument; m move, h home, [ ] jog, j step,
            c connect. While a campaign holds the rig, this shows what
            its store tells.
2 CAMPAIGN  e edit, Ctrl+S save, d dry run, s start, p pause,
            r resume, a abort. It runs in a process of its own:
            quitting the console, or losing it, does not end it.
3 RESULTS   u work out, v compare with another store; ← → change tabs
4 WORKBENCH f fit, g diagnose, a add, x remove, n next, v residuals
            against another covariate
5 LOG       / search, w alarms only

SIGNS  ● ready  ▶ moving  ■ stopped  ✗ lost or failed  ✓ passed  ? silent
"""
