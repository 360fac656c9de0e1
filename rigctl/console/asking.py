"""What a campaign asks its operator, as a dialog: once by itself, again on demand, gone when it is answered."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.console.store_view import StoreView
from rigctl.console.typed import OrderedKeys
from rigctl.console.widgets.dialogs import QuestionDialog

if TYPE_CHECKING:
    from rigctl.campaign.session.questions import Question

TYPING_S = 0.6
"""Who has typed a key within so long may type the next one, which must not land in a dialog that comes up."""


class Asking:
    """Shows the questions of stores in an application; `answer` is given the store, the question and the word."""

    def __init__(self, app: OrderedKeys, answer: Callable[[Path, Question, str], object]) -> None:
        self._app, self._answer = app, answer
        # A number alone is no question: every store counts from one.
        self._asked: tuple[Path, int] | None = None

    def show(self, view: StoreView | None) -> None:
        """Ask what is new, and not into the midst of what is being typed; take away what is answered."""
        question = view.question if view is not None else None
        if view is None or question is None:
            self._close()
            return
        if (view.path, question.number) == self._asked or time.monotonic() - self._app.typed_s < TYPING_S:
            return
        self._close()
        # Who has a dialog open, finishes that first; the alarm strip says meanwhile what is asked.
        if len(self._app.screen_stack) == 1:
            self._asked = (view.path, question.number)
            self.ask(view)

    def ask(self, view: StoreView | None) -> None:
        """Open the dialog, unless it is open or nothing is asked."""
        question = view.question if view is not None else None
        if view is None or question is None or self._open():
            return
        store = view.path
        QuestionDialog(question.text, question.choices).ask(
            self._app, lambda text: self._answer(store, question, text)
        )

    def _open(self) -> list[QuestionDialog]:
        return [screen for screen in self._app.screen_stack if isinstance(screen, QuestionDialog)]

    def _close(self) -> None:
        """Somebody else has answered, or the campaign is gone."""
        for dialog in self._open():
            dialog.dismiss(None)
