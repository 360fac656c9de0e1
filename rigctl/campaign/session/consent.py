"""A yes or no between two parts of a campaign, from whoever looks after it: at its terminal, or through its store."""

from __future__ import annotations

from functools import partial

from rigctl.campaign.session import locks
from rigctl.campaign.session.heartbeat import beat
from rigctl.campaign.session.operator import TerminalOperator, TypedLines
from rigctl.campaign.session.questions import Questions
from rigctl.campaign.store.store import Store


def consent(store: Store, question: str) -> bool:
    """Ask, and wait; `ProcedureError` where nobody can answer, `RigError` where the store is another campaign's.

    Nothing is measured meanwhile, but the store is ours: who looks at it sees a campaign that waits.
    """
    questions, heed = Questions(store), partial(beat, store.path)
    refusal = f"{store.path} is in use by another campaign; see `rigctl status`"
    with locks.held(locks.store_lock(store.path), refusal):
        heed()
        return TerminalOperator(None, TypedLines(heed, questions.heard), questions, heed=heed).accept(question)
