"""A yes or no between two parts of a campaign, from whoever looks after it: at its terminal, or through its store."""

from __future__ import annotations

from functools import partial

from rigctl.campaign.session import locks
from rigctl.campaign.session.control import forget_requests
from rigctl.campaign.session.heartbeat import beat
from rigctl.campaign.session.operator import TerminalOperator, TypedLines
from rigctl.campaign.session.questions import Questions
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted


def consent(store: Store, question: str) -> bool:
    """Ask, and wait; `ProcedureError` where nobody can answer, `RigError` where the store is another campaign's.

    Nothing is measured meanwhile, but the store is ours: who looks at it sees a campaign that waits, and may abort it
    (`Aborted`).
    """
    questions, heed = Questions(store), partial(_heed, store)
    refusal = f"{store.path} is in use by another campaign; see `rigctl status`"
    with locks.held(locks.store_lock(store.path), refusal):
        beat(store.path)
        forget_requests(store)  # of a campaign that ended before it looked
        return TerminalOperator(None, TypedLines(heed, questions.heard), questions, heed=heed).accept(question)


def _heed(store: Store) -> None:
    beat(store.path)
    if store.take_request() in {"abort", "stop"}:
        raise Aborted("from another process, while it asked")
