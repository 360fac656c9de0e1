"""Leaving a run out, or using it again: the operator is asked why, on whatever screen the run was chosen."""

from __future__ import annotations

from textual.widget import Widget

from rigctl.console.messages import AnalysisAsked
from rigctl.console.widgets.dialogs import TextDialog


def ask_why(widget: Widget, run_id: str, *, valid: bool, reason: str) -> None:
    """Ask, then have it marked: one that is `valid` is left out, one that is not, for its `reason`, used again."""

    def say(why: str) -> None:
        widget.post_message(AnalysisAsked("mark", (run_id, not valid, why.strip())))

    title = f"Run {run_id}: {'leave it out' if valid else 'use it again'}"
    prompt = "why?" if valid else f"left out: {reason}; why is it good?"
    TextDialog(title, prompt, "", _no_reason).ask(widget.app, say)


def _no_reason(text: str) -> str:
    return "" if text.strip() else "a mark needs its reason"
