"""What `HokuyoLX` takes for its socket: SCIP over a line, one whole reply at a time."""

from __future__ import annotations

from typing import Protocol

from robot_app.drivers.scip import END, Reply, ReplyBuffer, parse_reply
from shared.runtime.clock import Clock

_STREAMS = {b"MD", b"MS", b"ME"}
_COUNT_DIGITS = 2  # at the end of their requests; the echo of a streamed reply has how many are still to come


class Line(Protocol):
    """A serial port or a connection. Both raise `DeviceError` when the other side is gone."""

    @property
    def name(self) -> str: ...
    def write(self, data: bytes) -> None: ...
    def read(self, timeout_s: float) -> bytes: ...
    def close(self) -> None: ...


class ScipTransport:
    """`send` and `recv` of a socket, as far as the library uses them.

    A socket gives whatever has arrived: half a reply, two of them glued, garbage before it, and for ever nothing
    after the other side has hung up. This one gives the reply to what was sent last, from its echo to its empty
    line, or raises: `TimeoutError` when it has not come `timeout_s` after the request, whatever else came meanwhile,
    and `DeviceError` when the line is lost.
    """

    def __init__(self, line: Line, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._timeout_s = 1.0
        self._buffer = ReplyBuffer()
        self._waiting: list[bytes] = []  # blocks that came together with an answer, after it
        self._echo = b""
        self._due_s = 0.0
        self._is_answered = False

    @property
    def name(self) -> str:
        return self._line.name

    @property
    def discarded_bytes(self) -> int:
        return self._buffer.discarded_bytes

    def settimeout(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s

    def send(self, data: bytes) -> int:
        """One request with its line feed; all of it is sent. What came before it answers nothing any more."""
        self._waiting = []
        self._echo = data.rstrip(b"\n")
        self._due_s = self._clock.now_s() + self._timeout_s
        self._is_answered = False
        self._line.write(data)
        return len(data)

    def recv(self, _size: int) -> bytes:
        """The whole reply, LF LF at its end, however long. After the answer to a stream's request: its next scan."""
        if self._is_answered:
            self._due_s = self._clock.now_s() + self._timeout_s
        reply = self.reply()
        while reply is not None and not reply.text.isascii():  # spoilt; the library would not survive it
            reply = self.reply()
        if reply is None:
            raise TimeoutError
        if not self._is_answered and self._echo[:2] in _STREAMS:
            self._echo = self._echo[:-_COUNT_DIGITS]
        self._is_answered = True
        return reply.text + END

    def reply(self) -> Reply | None:
        """The next reply to what was sent last; None when it does not come in time."""
        while True:
            while self._waiting:
                reply = parse_reply(self._waiting.pop(0), self._echo)
                if reply is not None:
                    return reply
            left_s = self._due_s - self._clock.now_s()
            data = self._line.read(left_s) if left_s > 0 else b""
            if not data:
                return None
            self._buffer.feed(data)
            self._waiting = self._buffer.take()

    def receive(self, timeout_s: float) -> list[bytes] | None:
        """The blocks that became complete, oldest first, maybe none yet; None when no byte came in time."""
        if self._waiting:
            blocks, self._waiting = self._waiting, []
            return blocks
        data = self._line.read(timeout_s)
        if not data:
            return None
        self._buffer.feed(data)
        return self._buffer.take()

    def clear(self) -> None:
        self._buffer.clear()

    def close(self) -> None:
        self._line.close()
