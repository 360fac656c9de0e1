"""The rig this console holds, if it holds one: taken, given free, stopped. Nothing here keeps the screen waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from textual.message import Message

from rigctl.console.analyses import in_one_line
from rigctl.console.messages import BenchTaken, Noted
from rigctl.console.store_view import StoreView
from rigctl.core.making_safe import Rest

if TYPE_CHECKING:
    from rigctl.console.bench import LiveBench


class Holding:
    """A rig file and, while it is held, its instruments; `post` and `call` bring things to the screen's thread."""

    def __init__(self, post: Callable[[Message], object], call: Callable[[Callable[[], None]], object]) -> None:
        self.rig: Path | None = None
        self.bench: LiveBench | None = None
        self._post = post
        self._call = call
        self._one_at_a_time = threading.Lock()
        self._stopping_outside = threading.Lock()

    def take(self, rig: Path | None = None) -> None:
        """Hold a rig, or again the one that was given free; `BenchTaken` is posted when it is there or refused."""
        wanted = rig or self.rig
        if wanted is not None:
            self._begin(self._take, wanted)

    def give(self, then: Callable[[], None] = lambda: None) -> None:
        """Give the instruments free for others, then go on with `then`."""
        self._begin(self._give, then)

    def stop(self) -> bool:
        """Bring everything that is held to rest; returns at once, False when nothing is held."""
        if self.bench is None:
            return False
        self.bench.stop()
        return True

    def stop_from_outside(self, view: StoreView) -> None:
        """Second connections to what a campaign holds, as `rigctl stop` makes them."""
        self._begin(self._stop_from_outside, view)

    def bring_to_rest(self) -> tuple[Rest, ...]:
        """Bring everything that is held to rest; waits until that is done."""
        bench = self.bench
        return () if bench is None else bench.bring_to_rest()

    def close(self) -> tuple[Rest, ...]:
        """Bring everything to rest and let go; waits until that is done."""
        # Waits for a rig that is just being taken, which would be left held otherwise.
        with self._one_at_a_time:
            return self._let_go()

    def _let_go(self) -> tuple[Rest, ...]:
        # Out of sight first: nothing may be asked of a bench that is being closed.
        bench, self.bench = self.bench, None
        return () if bench is None else bench.close()

    def _begin(self, act: Callable[..., None], *arguments: Any) -> None:
        def safely() -> None:
            try:
                act(*arguments)
            except Exception as error:  # noqa: BLE001 - whatever went wrong in this thread, the operator hears of it
                self._post(Noted(in_one_line(error), "error"))

        threading.Thread(target=safely, name=act.__name__, daemon=True).start()

    def _take(self, rig: Path) -> None:
        from rigctl.console.bench import open_bench
        from rigctl.files.rig_file import read_rig

        try:
            # First: a file that cannot be used leaves the rig that is held as it is.
            file = read_rig(rig)
            with self._one_at_a_time:
                # The rig held so far may share instruments with the one to come.
                self._let_go()
                self.rig = rig
                # A campaign that was stopped gives its rig free: a serial line has no room for the stop and a bench.
                with self._stopping_outside:
                    self.bench = open_bench(file, self._post)
        finally:
            self._post(BenchTaken())

    def _give(self, then: Callable[[], None]) -> None:
        self.close()
        self._call(then)

    def _stop_from_outside(self, view: StoreView) -> None:
        from rigctl.console.bench import stop_from_outside

        with self._stopping_outside:
            held = frozenset[str]() if self.bench is None else self.bench.addresses
            stop_from_outside(view.rig_toml, view.path, held, self._post)
