"""Keys in the order in which they were typed: each is dealt with, all that follows from it included, before the next.

A terminal sends keys faster than screens and dialogs come up. An application that gives each key at once to whatever
has the focus just then sends those typed ahead to the screen before. Here a key waits until the one before it has
gone all the way, and until the screen that it has opened can take keys. See docs/decisions/066.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import ClassVar

from textual import events
from textual.app import App
from textual.message import Message
from textual.message_pump import MessagePump

LOST_S = 0.5
"""A key whose target was removed while it had it is given up after so long; nobody is left who could answer it."""


class Passed(Message):
    """Follows a key on its way from widget to widget: where this arrives, the key has been dealt with."""


class OrderedKeys(App[None]):
    """An application whose keys arrive in order."""

    AT_ONCE: ClassVar[frozenset[str]] = frozenset()
    """Keys that wait for nothing; what was typed before them and has not been dealt with is dropped."""

    def __init__(self) -> None:
        super().__init__()
        self._typed: deque[events.Event] = deque()
        self._at: MessagePump | None = None
        self._at_since_s = 0.0
        self._answered = False
        self.keys_wait = False
        """Whether what is typed or clicked waits, as what it is for is not there yet; `take_keys` ends it."""
        self.typed_s = -math.inf
        """When the last key came, on the monotonic clock."""

    async def on_event(self, event: events.Event) -> None:
        """Take a key into the queue; whatever else comes is dealt with at once."""
        if isinstance(event, events.MouseEvent) and self.keys_wait:
            self._typed.append(event)
        elif not isinstance(event, events.Key | events.Paste) or event.is_forwarded:
            await super().on_event(event)
        elif isinstance(event, events.Key) and event.key in self.AT_ONCE:
            self._typed.clear()
            if self.keys_wait:
                self._typed.append(event)
            else:
                await super().on_event(event)
        else:
            self.typed_s = time.monotonic()
            self._typed.extend(_taken_apart(event))
            await self._next()

    def take_keys(self) -> None:
        """What they are for is there."""
        self.keys_wait = False
        self.call_later(self._next)

    async def _next(self) -> None:
        if self._at is not None and time.monotonic() - self._at_since_s > LOST_S and not self._at.is_attached:
            self._at = None
        if self._at is not None or not self._typed or self.keys_wait:
            return
        event = self._typed.popleft()
        self._at, self._at_since_s = self.focused or self.screen, time.monotonic()
        self._answered = False
        target = self._at
        await super().on_event(event)
        self._follow(target)

    def _follow(self, target: MessagePump) -> None:
        if not target.post_message(Passed()):
            # It is closing: whatever it does with the key is done.
            self._follow(self.screen) if target is not self.screen else self._release()

    def on_passed(self) -> None:
        """The key has gone all the way; what it has put off to the next turn comes before the next key."""
        self.call_later(self._settled)

    def _settled(self) -> None:
        if self._at is None:
            return
        if not self._answered:
            # What a widget makes of a key (an entry that is submitted) goes the same way once more, behind it.
            self._answered = True
            self._follow(self._at)
            return
        # A dialog that it has opened, or the screen below one that it has closed, has to be ready first.
        screen = self.screen
        if self._at is not screen and self.focused is not self._at:
            self._at = screen
            self._follow(screen)
        else:
            self._release()

    def _release(self) -> None:
        self._at = None
        if self._typed:
            self.call_later(self._next)


def _taken_apart(event: events.Key | events.Paste) -> list[events.Key | events.Paste]:
    """Esc and a key typed right after it come as one, as if Alt were held, which means nothing here."""
    if isinstance(event, events.Key) and event.key.startswith("alt+") and len(event.key) > len("alt+"):
        key = event.key.removeprefix("alt+")
        return [events.Key("escape", None), events.Key(key, event.character or (key if len(key) == 1 else None))]
    return [event]
