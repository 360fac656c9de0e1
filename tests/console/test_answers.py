"""What the processes of the analysis answer is received by the console without importing the analysis."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rigctl.console import analysis

RECEIVED = """
import pickle, sys
answer = pickle.load(sys.stdin.buffer)
print(type(answer).__name__, *sorted(name for name in sys.modules if name.startswith(("rigctl.workbench", "scipy"))))
"""


@pytest.mark.parametrize(
    ("ask", "kind"),
    [
        (lambda store: analysis.watched(store, ()), "Watch"),
        (lambda store: analysis.run(store, "1", ()), "RecordedRun"),
        (lambda store: analysis.result(store, ()), "tuple"),
        (lambda store: analysis.fit(store, ()), "dict"),
    ],
    ids=["watched", "run", "result", "fit"],
)
def test_an_answer_is_received_without_the_analysis(measured: Path, ask: Callable[[Path], Any], kind: str) -> None:
    answer = pickle.dumps(ask(measured))
    # Half a second of the screen's thread, or of its processor, if it were.
    received = subprocess.run([sys.executable, "-c", RECEIVED], input=answer, capture_output=True, check=True)
    assert received.stdout.decode().split() == [kind]
