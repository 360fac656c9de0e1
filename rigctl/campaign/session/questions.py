"""What a campaign asks the operator, kept in its store: it can be answered at its terminal, or from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.campaign.store.entries import RESUMED
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError

ASKED, ANSWERED = "question", "answer"


@dataclass(frozen=True)
class Question:
    """An open question: `number` is that of its event, which an answer names, so that none is answered by mistake."""

    number: int
    text: str
    time: str

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that answer it."""
        return ("yes", "no") if self.text.rstrip().endswith("[y/n]") else ("done", "abort")


class Questions:
    """The campaign's side: one question at a time, answered by whoever is first."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._number = 0

    def post(self, text: str) -> None:
        """Ask, where every process that reads the store sees it."""
        self._number = self._store.add_event(ASKED, {"text": text})

    def heard(self) -> str | None:
        """The answer that came through the store; None while there is none."""
        return _answer_to(self._store, self._number)

    def close(self, answer: str) -> None:
        """Keep an answer that was typed at the campaign's own terminal."""
        # Somebody else may have answered first, while a line was being typed; the first answer counts.
        if self.heard() is None:
            self._store.add_event(ANSWERED, {"question": self._number, "answer": answer})


def open_question(store: Store) -> Question | None:
    """What the campaign of a store waits for; only a campaign that runs waits."""
    last = store.last_event(ASKED)
    if last is None or _answer_to(store, last.id) is not None:
        return None
    # Whoever goes on asks anew: a process that was killed while it waited hears no answer.
    resumed = store.last_event(RESUMED)
    if resumed is not None and resumed.id > last.id:
        return None
    return Question(last.id, str(last.data["text"]), last.time)


def answer(store: Store, number: int, text: str) -> None:
    """Answer question `number`; `DataError` when it is not open any more, or `text` is none of its choices."""
    question = open_question(store)
    if question is None or question.number != number:
        raise DataError(f"{store.path}: that question is not open any more; look what the campaign asks now")
    if text not in question.choices:
        raise DataError(f"{store.path}: '{text}' is no answer; one of {', '.join(question.choices)}")
    store.add_event(ANSWERED, {"question": number, "answer": text})


def _answer_to(store: Store, number: int) -> str | None:
    return next(
        (str(e.data["answer"]) for e in store.events(ANSWERED, after=number) if e.data["question"] == number), None
    )
