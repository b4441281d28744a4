"""The bytes of one radio between host and transceiver, sans-I/O; the firmware's twin is `core/stream.c`.

Bytes are numbered by their offset since the session began, modulo 65536. The receiver acknowledges and says up to
which offset it has room; what is not acknowledged in time is sent again. A damaged frame loses nothing, a frame that
comes twice does no harm, and neither side can be overrun.
"""

from __future__ import annotations

from shared.protocol.transceiver import MAX_DATA_BYTES, RETRY_AFTER_MS, Acknowledge, Data

_MASK = 0xFFFF
_LARGEST_WINDOW = 0x8000
_RETRY_AFTER_S = RETRY_AFTER_MS / 1_000
TO_RADIO_BYTES = 4_096  # what may wait for a radio: half a second at 115200
FROM_RADIO_BYTES = 16_384  # what may wait for the reader: more than a second of a radio at 115200


class ToRadio:
    """What the host has for one radio."""

    def __init__(self, radio: int) -> None:
        self._radio = radio
        self._bytes = bytearray()  # from the first that is not acknowledged
        self._acknowledged = 0
        self._sent = 0  # how many of `_bytes` are on their way
        self._limit = 0
        self._progress_s = 0.0
        self._gap: int | None = None  # the last that was reported missing and sent again for it
        self.resent_bytes = 0

    @property
    def room(self) -> int:
        return TO_RADIO_BYTES - len(self._bytes)

    @property
    def is_empty(self) -> bool:
        """All that was written has arrived at the transceiver."""
        return not self._bytes

    def write(self, data: bytes) -> int:
        """Take what there is room for; how many bytes that is."""
        taken = data[: self.room]
        self._bytes += taken
        return len(taken)

    def acknowledge(self, frame: Acknowledge, now_s: float) -> None:
        advance = frame.received - self._acknowledged & _MASK
        if advance > len(self._bytes):
            return
        del self._bytes[:advance]
        self._sent = max(0, self._sent - advance)
        self._acknowledged = frame.received
        if advance:
            self._progress_s = now_s
            self._gap = None
        if frame.missing and self._gap != self._acknowledged:  # each frame behind a gap reports it; once is enough
            self._gap = self._acknowledged
            self._send_again()
        if frame.limit - frame.received & _MASK <= _LARGEST_WINDOW:
            self._limit = frame.limit

    def frames(self, now_s: float) -> list[Data]:
        """What may be sent now."""
        if self._sent and now_s - self._progress_s >= _RETRY_AFTER_S:
            self._send_again()
        window = self._limit - self._acknowledged & _MASK
        end = min(len(self._bytes), window if window <= _LARGEST_WINDOW else 0)
        if self._sent == 0:
            self._progress_s = now_s
        frames = []
        while self._sent < end:
            data = bytes(self._bytes[self._sent : min(end, self._sent + MAX_DATA_BYTES)])
            frames.append(Data(self._radio, self._acknowledged + self._sent & _MASK, data))
            self._sent += len(data)
        return frames

    def _send_again(self) -> None:
        self.resent_bytes += self._sent
        self._sent = 0


class FromRadio:
    """What one radio has for the host."""

    def __init__(self, radio: int) -> None:
        self._radio = radio
        self._bytes = bytearray()
        self._received = 0
        self._told: Acknowledge | None = None
        self._missing = False

    @property
    def is_empty(self) -> bool:
        return not self._bytes

    def receive(self, frame: Data) -> None:
        known = self._received - frame.offset & _MASK
        news = frame.data[known:]
        if not news or len(self._bytes) + len(news) > FROM_RADIO_BYTES:
            self._told = None  # it came twice, something before it is missing, or there is no room: say what is here
            self._missing = known > _LARGEST_WINDOW
            return
        self._bytes += news
        self._received = self._received + len(news) & _MASK

    def read(self) -> bytes:
        data = bytes(self._bytes)
        self._bytes.clear()
        return data

    def acknowledgement(self, always: bool) -> Acknowledge | None:
        """What the transceiver should know by now; None when that is no news."""
        limit = self._received + FROM_RADIO_BYTES - len(self._bytes) & _MASK
        frame = Acknowledge(self._radio, self._received, limit, int(self._missing))
        if not always and self._told is not None and not self._is_news(frame, self._told):
            return None
        self._told = frame
        self._missing = False
        return frame

    @staticmethod
    def _is_news(frame: Acknowledge, told: Acknowledge) -> bool:
        opened = frame.limit - told.limit & _MASK
        return frame.received != told.received or opened >= FROM_RADIO_BYTES // 4
