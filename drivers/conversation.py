"""Questions and replies over one connection: every question gets its own reply, or nothing read is believed.

Nothing may be unread when a question is sent. After whatever leaves open which reply comes next (a time-out, a
reply that cannot be, bytes that nobody asked for) the connection is brought in step before the next question: by a
new one, or, where bytes under way outlive a connection, by reading on until the check question is answered.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import NamedTuple, NoReturn, ParamSpec, TypeVar

from drivers.transport import Clearable, Connect, Transport
from rigctl.core.errors import BadReply, LinkError, LinkLost, LinkTimeout, OutOfStep

T = TypeVar("T")
P = ParamSpec("P")

# A line that still sends other things after so many is used by somebody else.
REPLIES_BEHIND_MAX = 64
LINE_ENDS = b"\r\n"
MEASURE_AGAIN = "replies may have been taken for others: measure again"
SET_DELIMITER = (
    "lines end otherwise than they should: set the delimiter of the instrument, or of a terminal server before it, "
    "as docs/hardware.md says"
)
OVERTAKEN_AFTER_S = 0.05
"""How long [s of wall-clock time] somebody urgent waits for an exchange to end by itself; most take a millisecond."""


class Check(NamedTuple):
    """A question that may be asked at any time and that no other question's reply answers.

    `own` reads one reply and says whether it is the question's.
    """

    question: bytes
    own: Callable[[Transport], bool]


class Conversation:
    """The one connection to an instrument, made anew when it is lost; usable from any thread, one exchange at a time.

    `lock` may be held around exchanges that belong together. `harmless` says of unread bytes that they are part of no
    reply. `anew` is for instruments whose late replies do not reach a new connection: it is made after every doubt.
    Exchanges raise `LinkTimeout`, `LinkLost` or `OutOfStep`; after the first two the question may have come or not.
    """

    def __init__(
        self,
        name: str,
        connect: Connect,
        check: Check,
        *,
        anew: bool,
        harmless: Callable[[bytes], bool] = lambda _: False,
    ) -> None:
        # Re-entrant, since exchanges that belong together hold it around single ones.
        self.lock = threading.RLock()
        self.opened = False
        """True between `open` and `close`."""
        self.sessions = 0
        """Counts connections: what was true of the instrument may not be after a new one."""
        self._name = name
        self._connect = connect
        self._harmless = harmless
        self._check = check
        self._checks_due = 0
        self._anew = anew
        self._transport: Transport | None = None
        self._busy = False
        self._doubtful = False
        self._unread = b""
        self._reached = 0
        # A lock of its own: `reachable` is entered by who must not wait for an exchange.
        self._reaching = threading.Lock()
        self._urgent = 0
        self._overtaken = False

    def open(self) -> None:
        """Connect; what is unread on a new connection belongs to nobody."""
        self.close()
        self.opened = True
        with self.lock, self._told():
            # What was left of the old connection says nothing about the new one.
            self._unread, self._overtaken = b"", False
            self._connected().unread()

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`. May be called twice."""
        self.opened = False
        self._drop()

    @property
    def guarded(self) -> bool:
        """No bit turns on the way without being noticed."""
        return self._transport is None or self._transport.guarded

    @property
    def address(self) -> str:
        """Where the connection goes to; empty when there is none."""
        return self._transport.address if self._transport else ""

    def ask(
        self, question: bytes, read: Callable[[Transport], T], sending: AbstractContextManager[None] | None = None
    ) -> T:
        """Send a question and read its reply; it is sent within `sending`, which may refuse.

        Whatever `read` raises leaves the connection in doubt.
        """
        return self._in_turn(question, self._ask, question, read, sending)

    def _ask(
        self, question: bytes, read: Callable[[Transport], T], sending: AbstractContextManager[None] | None
    ) -> T:
        transport = self._clear(question)
        with sending or nullcontext():
            self._send(transport, question)
        try:
            return read(transport)
        except BaseException as error:
            self._failed(error)
            raise

    def ask_each(
        self, questions: Sequence[bytes], read: Callable[[Transport], T], good: Callable[[T], bool]
    ) -> list[T]:
        """As `ask` for each in turn, up to the first reply that is not `good`, all on one connection."""
        return self._in_turn(b"", self._ask_each, questions, read, good)

    def _ask_each(
        self, questions: Sequence[bytes], read: Callable[[Transport], T], good: Callable[[T], bool]
    ) -> list[T]:
        replies: list[T] = []
        transport = self._clear(questions[0])
        try:
            for question in questions:
                # Also between two questions, where a surplus reply would shift all later ones.
                if unread := transport.unread():
                    self._look_at(unread, question)
                transport.write(question)
                replies.append(read(transport))
                if not good(replies[-1]):
                    break
        except BaseException as error:
            if isinstance(error, LinkError):
                self._tell(error, question)
            self._failed(error)
            raise
        return replies

    def tell(self, command: bytes) -> None:
        """Send what has no reply, hence at once, even where the next reply is in doubt."""
        self._in_turn(command, lambda: self._send(self._alive(), command))

    def device_clear(self) -> None:
        """GPIB's device clear, where the wire has one: what the instrument is at ends, and nothing is unread."""
        self._in_turn(b"", self._clear_device)

    def _clear_device(self) -> None:
        transport = self._alive()
        if isinstance(transport, Clearable) and transport.device_clear():
            self._unread = b""

    def confirm_in_step(self) -> None:
        """`OutOfStep` unless the check question is answered by its own reply and nothing else is unread."""
        with self.lock:
            if not self.ask(self._check.question, self._is_own, self._one_check()):
                self._raise_out_of_step(f"{self._check.question!r} was not answered by its own reply")
            # The surplus of a doubled reply comes after it: hence one more look.
            with self._told(self._check.question):
                self._clear(self._check.question)

    @contextmanager
    def _one_check(self) -> Iterator[None]:
        # Counted when it is sent: a reply that comes much later must still be known as its own.
        self._checks_due += 1
        yield

    def _is_own(self, transport: Transport) -> bool:
        try:
            is_own = self._check.own(transport)
        except BadReply:
            is_own = False
        self._checks_due -= is_own
        return is_own

    def _settle(self, transport: Transport) -> None:
        """Read on until every check question is answered, or the last ones seem lost."""
        # A new connection carries no late replies: nothing to settle.
        if self._anew:
            return
        with self._one_check():
            transport.write(self._check.question)
        answered = False
        # Late replies of earlier questions come first; each check question sent so far is answered once.
        for _ in range(REPLIES_BEHIND_MAX):
            try:
                answered = self._is_own(transport) or answered
            except LinkTimeout:
                if not answered:
                    raise
                # Silence after an answer: what is outstanding was lost on the line and will not come.
                self._checks_due = 0
            if answered and not self._checks_due:
                return
        raise LinkError(f"{self._name}: {self._check.question!r} is not answered; does somebody else use the line?")

    @contextmanager
    def reachable(self) -> Iterator[None]:
        """Connected even if it is not open; what was closed is closed again."""
        self._reach(1)
        try:
            yield
        finally:
            # Only who leaves last closes, and only what nobody has opened meanwhile.
            if not self._reach(-1) and not self.opened:
                self._drop()

    def _reach(self, change: int) -> int:
        with self._reaching:
            self._reached += change
            return self._reached

    @contextmanager
    def urgently(self) -> Iterator[None]:
        """Reachable, and before all others: who awaits a reply for long gets `LinkLost`."""
        with self.reachable():
            # The lock is given back below, not in a `with`: taking it may mean closing the connection first.
            self._take_turn()
            self._urgent += 1
            try:
                yield
            finally:
                self._urgent -= 1
                self.lock.release()

    def shout(self, command: bytes) -> None:
        """Send what has no reply, past whoever awaits one; waits for whoever is connecting."""
        while not self.lock.acquire(timeout=OVERTAKEN_AFTER_S):
            if (transport := self._transport) is not None:
                transport.write(command)
                return
        try:
            self.tell(command)
        finally:
            self.lock.release()

    def _take_turn(self) -> None:
        while not self.lock.acquire(timeout=OVERTAKEN_AFTER_S):
            # Somebody urgent is not overtaken by somebody urgent: both are stops.
            if not self._urgent and (transport := self._transport) is not None:
                self._overtaken = True
                # Who waits for a reply holds the lock; the end of its connection makes it let go.
                transport.close()
        if self._overtaken:
            self._overtaken = False
            self._drop()
            # The reply that was overtaken may still come, on lines that outlive their connection.
            self._doubtful = True

    def _in_turn(self, asked: bytes, exchange: Callable[P, T], *values: P.args, **named: P.kwargs) -> T:
        """One exchange at a time. No generator, as every exchange comes through here.

        A signal handler may come in the middle of its own thread's exchange: it gets a new connection.
        """
        with self.lock:
            # Who was overtaken often asks again at once: it must not take the lock back before the stop has it.
            if self._overtaken:
                raise LinkLost(f"{self._name}: its connection was taken over to stop it; ask again")
            # The lock is re-entrant, so this thread can be inside an exchange already: only a signal handler is.
            if self._busy:
                self._drop()
                self._doubtful = True
            self._busy = True
            try:
                return exchange(*values, **named)
            except LinkError as error:
                self._tell(error, asked)
                raise
            finally:
                self._busy = False

    @contextmanager
    def _told(self, asked: bytes = b"") -> Iterator[None]:
        try:
            yield
        except LinkError as error:
            self._tell(error, asked)
            raise

    def _tell(self, error: LinkError, asked: bytes) -> None:
        """Have `error` say whose wire it is and what was asked: a transport knows its address only."""
        error.instrument = self._name
        if not str(error).startswith(f"{self._name}:"):
            question = [asked.decode("ascii", "backslashreplace").strip()] if asked else []
            error.args = (": ".join([self._name, *question, str(error)]),)

    def _clear(self, question: bytes) -> Transport:
        """The connection, in step and with nothing unread."""
        transport = self._alive()
        if self._doubtful:
            try:
                self._settle(transport)
            except BaseException as error:
                self._failed(error)
                raise
        elif self._unread:
            self._look_at(self._unread, question)
        self._doubtful, self._unread = False, b""
        return transport

    def _alive(self) -> Transport:
        """The connection, looked at; a new one when the instrument has ended it: nothing is sent yet."""
        transport = self._connected()
        try:
            # Collected, not thrown away: what is unread tells that replies are out of step.
            self._unread += transport.unread()
        except LinkLost:
            self._drop()
            return self._connected()
        return transport

    def _look_at(self, unread: bytes, question: bytes) -> None:
        if not self._harmless(unread):
            mend = MEASURE_AGAIN if unread.strip(LINE_ENDS) else SET_DELIMITER
            self._raise_out_of_step(f"{unread[:60]!r} was unread at {question[:60]!r}", mend)

    def _raise_out_of_step(self, why: str, mend: str = MEASURE_AGAIN) -> NoReturn:
        self.doubt()
        self._clear(b"")
        raise OutOfStep(f"{self._name}: {why}; {mend}")

    def _send(self, transport: Transport, data: bytes) -> None:
        try:
            transport.write(data)
        except BaseException as error:
            self._failed(error)
            raise

    def _failed(self, error: BaseException) -> None:
        if isinstance(error, LinkLost):
            self._drop()
        else:
            self.doubt()

    def doubt(self) -> None:
        """Bring the connection in step before the next question: what came was no reply to the last one."""
        self._doubtful = True
        if self._anew:
            self._drop()

    def _connected(self) -> Transport:
        self._require_wanted()
        if self._transport is None:
            self._transport = self._connect()
            self.sessions += 1
            # Connecting takes seconds, in which `close` may have been called.
            self._require_wanted()
        return self._transport

    def _require_wanted(self) -> None:
        """It may have been closed while it was connecting."""
        if not self.opened and not self._reached:
            self._drop()
            raise LinkLost(f"{self._name}: not connected; open it first")

    def _drop(self) -> None:
        # Taken out before it is closed: of two threads that drop it, one finds nothing.
        transport, self._transport = self._transport, None
        self._checks_due = 0
        if transport is not None:
            transport.close()
