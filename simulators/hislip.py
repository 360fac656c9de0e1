"""HiSLIP, the instrument's side: two TCP connections carry the messages of one session.

IVI-6.1 "High-Speed LAN Instrument Protocol", protocol version 1.0, synchronised mode. Left out: locks,
service requests and Interrupted messages (a client must recognise a stale response by its message identifier).
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from simulators.wiring import Connection, SimulatedInstrument

HEADER = struct.Struct("!2sBBIQ")
"""Prologue, message type, control code, message parameter, payload length."""

VERSION = 0x0100
SUB_ADDRESSES = (b"", b"hislip0")
MAX_PAYLOAD_BYTES = 1 << 20
MESSAGE_AVAILABLE = 0x10
"""The MAV bit of the IEEE 488.2 status byte."""

RMT_DELIVERED = 0x01
"""Control-code bit of a client that has taken the whole last response."""


class Kind(IntEnum):
    """Message types, IVI-6.1 table 4."""

    INITIALIZE = 0
    INITIALIZE_RESPONSE = 1
    FATAL_ERROR = 2
    ERROR = 3
    DATA = 6
    DATA_END = 7
    DEVICE_CLEAR_COMPLETE = 8
    DEVICE_CLEAR_ACKNOWLEDGE = 9
    ASYNC_REMOTE_LOCAL_CONTROL = 10
    ASYNC_REMOTE_LOCAL_RESPONSE = 11
    TRIGGER = 12
    ASYNC_MAX_MSG_SIZE = 15
    ASYNC_MAX_MSG_SIZE_RESPONSE = 16
    ASYNC_INITIALIZE = 17
    ASYNC_INITIALIZE_RESPONSE = 18
    ASYNC_DEVICE_CLEAR = 19
    ASYNC_STATUS_QUERY = 21
    ASYNC_STATUS_RESPONSE = 22
    ASYNC_DEVICE_CLEAR_ACKNOWLEDGE = 23


class Fatal(IntEnum):
    """Codes of errors that end the connection."""

    UNIDENTIFIED = 0
    BAD_HEADER = 1
    NOT_BOTH_CHANNELS = 2
    BAD_INITIALIZATION = 3


class Complaint(IntEnum):
    """Codes of errors after which the session goes on."""

    UNKNOWN_MESSAGE = 1
    TOO_LARGE = 4


@dataclass(frozen=True)
class Message:
    """One message as it came."""

    kind: int
    control: int
    parameter: int
    payload: bytes


class HislipPort:
    """Serves HiSLIP for an instrument whose messages end with LF, both ways."""

    def __init__(self, instrument: SimulatedInstrument) -> None:
        self.kind = instrument.kind
        self._instrument = instrument
        self._numbers = itertools.count(1)
        self._sessions: dict[int, Session] = {}

    @property
    def listening(self) -> bool:
        """False while an attempt to connect finds nobody."""
        # Only faulty instruments know when nobody listens.
        return bool(getattr(self._instrument, "listening", True))

    def connect(self, send: Callable[[bytes], None]) -> Channel:
        """Serve one more TCP connection; its first message says which channel it is."""
        return Channel(self, send)

    def begin(self, channel: Channel) -> Session:
        """A new session on its synchronous channel."""
        # Session numbers have 16 bits on the wire.
        number = next(self._numbers) & 0xFFFF
        session = Session(number, self._instrument, channel)
        self._sessions[number] = session
        return session

    def find(self, number: int) -> Session | None:
        """The session of that number that waits for its asynchronous channel."""
        session = self._sessions.get(number)
        # A session has one asynchronous channel; a second is none.
        return session if session and session.asynchronous is None else None

    def forget(self, session: Session) -> None:
        """The session is over."""
        self._sessions.pop(session.number, None)


class Channel:
    """One of the two TCP connections of a session: cuts bytes into messages and hands them on."""

    def __init__(self, port: HislipPort, send: Callable[[bytes], None]) -> None:
        self._port = port
        self._send = send
        self._received = bytearray()
        self._to_skip = 0
        self._over = False
        self.session: Session | None = None

    @property
    def hung_up(self) -> bool:
        """True when this side has ended the connection."""
        return self._over or (self.session is not None and self.session.over)

    def receive(self, data: bytes) -> None:
        """Take bytes from the client."""
        self._received += data
        while not self.hung_up and (message := self._next()):
            self._handle(message)

    def close(self) -> None:
        """The client has gone, and with one channel the whole session."""
        if self.session is not None:
            self.session.end()
            self._port.forget(self.session)

    def tell(self, kind: Kind, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        """Send one message."""
        self._send(HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload)

    def fail(self, code: Fatal, text: str) -> None:
        """Say why, and end the connection."""
        self.tell(Kind.FATAL_ERROR, code, 0, text.encode())
        self._over = True

    def complain(self, code: Complaint, text: str) -> None:
        """Say what was ignored."""
        self.tell(Kind.ERROR, code, 0, text.encode())

    def _next(self) -> Message | None:
        # A message that was refused for its size is passed over as it comes, not kept.
        skipped = min(self._to_skip, len(self._received))
        del self._received[:skipped]
        self._to_skip -= skipped
        if self._to_skip or len(self._received) < HEADER.size:
            return None
        prologue, kind, control, parameter, length = HEADER.unpack_from(self._received)
        if prologue != b"HS":
            self.fail(Fatal.BAD_HEADER, "a message begins with HS")
            return None
        if length > MAX_PAYLOAD_BYTES:
            self._to_skip = HEADER.size + length
            self.complain(Complaint.TOO_LARGE, f"at most {MAX_PAYLOAD_BYTES} bytes")
            return self._next()
        if len(self._received) < HEADER.size + length:
            return None
        payload = bytes(self._received[HEADER.size : HEADER.size + length])
        del self._received[: HEADER.size + length]
        return Message(kind, control, parameter, payload)

    def _handle(self, message: Message) -> None:
        if self.session is None:
            self._introduce(message)
        elif self.session.asynchronous is None:
            self.fail(Fatal.NOT_BOTH_CHANNELS, "open the asynchronous channel first")
        elif self is self.session.synchronous:
            self.session.synchronous_message(message)
        else:
            self.session.asynchronous_message(message)

    def _introduce(self, message: Message) -> None:
        if message.kind == Kind.INITIALIZE and message.payload.lower() in SUB_ADDRESSES:
            self.session = self._port.begin(self)
            # One parameter for both: the server's version above, the session's number below.
            self.tell(Kind.INITIALIZE_RESPONSE, 0, VERSION << 16 | self.session.number)
        elif message.kind == Kind.ASYNC_INITIALIZE and (session := self._port.find(message.parameter)):
            self.session = session
            session.asynchronous = self
            self.tell(Kind.ASYNC_INITIALIZE_RESPONSE)
        else:
            self.fail(Fatal.BAD_INITIALIZATION, "initialise hislip0, then its asynchronous channel")


class Session:
    """What a client and the instrument say to each other."""

    def __init__(self, number: int, instrument: SimulatedInstrument, synchronous: Channel) -> None:
        self.number = number
        self.synchronous = synchronous
        self.asynchronous: Channel | None = None
        self._instrument = instrument
        self._whole = bool(getattr(instrument, "sends_whole_replies", False))
        self._max_payload = MAX_PAYLOAD_BYTES
        self._ended = False
        self._connect()

    @property
    def over(self) -> bool:
        """True when either side has ended it."""
        return self._ended or bool(getattr(self._connection, "hung_up", False))

    def end(self) -> None:
        """The client has gone; may be called twice."""
        if not self._ended:
            self._ended = True
            self._connection.close()

    def synchronous_message(self, message: Message) -> None:
        """Data, trigger, and the end of a device clear."""
        match message.kind:
            case Kind.DEVICE_CLEAR_COMPLETE:
                # A device clear empties both parsers; a fresh connection to the instrument is just that.
                if (heard := getattr(self._connection, "device_clear", None)) is not None:
                    heard()
                self._connection.close()
                self._connect()
                self.synchronous.tell(Kind.DEVICE_CLEAR_ACKNOWLEDGE)
            # What was sent before the clear was complete is to be ignored.
            case _ if self._clearing:
                pass
            case Kind.DATA | Kind.DATA_END:
                self._command(message, message.payload, ends=message.kind == Kind.DATA_END)
            case Kind.TRIGGER:
                self._command(message, b"*TRG", ends=True)
            case _:
                self.synchronous.complain(Complaint.UNKNOWN_MESSAGE, f"message type {message.kind}")

    def asynchronous_message(self, message: Message) -> None:
        """Message size, status, remote/local, and the begin of a device clear."""
        assert self.asynchronous is not None
        tell = self.asynchronous.tell
        match message.kind:
            case Kind.ASYNC_MAX_MSG_SIZE if len(message.payload) == 8:
                wanted = int.from_bytes(message.payload, "big")
                # The client's limit is for whole messages, header included.
                self._max_payload = max(1, min(wanted - HEADER.size, MAX_PAYLOAD_BYTES))
                tell(Kind.ASYNC_MAX_MSG_SIZE_RESPONSE, payload=MAX_PAYLOAD_BYTES.to_bytes(8, "big"))
            case Kind.ASYNC_STATUS_QUERY:
                if message.control & RMT_DELIVERED:
                    self._waiting = False
                tell(Kind.ASYNC_STATUS_RESPONSE, MESSAGE_AVAILABLE if self._waiting else 0)
            case Kind.ASYNC_DEVICE_CLEAR:
                self._clearing = True
                tell(Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE)
            case Kind.ASYNC_REMOTE_LOCAL_CONTROL:
                tell(Kind.ASYNC_REMOTE_LOCAL_RESPONSE)
            case _:
                self.asynchronous.complain(Complaint.UNKNOWN_MESSAGE, f"message type {message.kind}")

    def _connect(self) -> None:
        """A fresh start for both parsers: what a device clear is."""
        self._clearing = False
        self._waiting = False
        self._message_id = 0
        self._last_byte = b""
        self._response = bytearray()
        self._connection: Connection = self._instrument.connect(self._respond)

    def _command(self, message: Message, payload: bytes, *, ends: bool) -> None:
        self._message_id = message.parameter
        self._waiting = False
        self._last_byte = payload[-1:] or self._last_byte
        # The end of a message is the LF that a raw socket would carry; some clients send it themselves.
        if ends and self._last_byte != b"\n":
            payload += b"\n"
        if ends:
            self._last_byte = b""
        if payload:
            self._connection.receive(payload)

    def _respond(self, data: bytes) -> None:
        if self._clearing or self._ended:
            return
        self._response += data
        # Instruments send LF at the end of a message; faulty ones may not, and say so.
        if not (data.endswith(b"\n") or self._whole):
            return
        response, self._response = bytes(self._response), bytearray()
        for start in range(0, len(response), self._max_payload):
            part = response[start : start + self._max_payload]
            kind = Kind.DATA_END if start + len(part) == len(response) else Kind.DATA
            self.synchronous.tell(kind, 0, self._message_id, part)
        self._waiting = True
