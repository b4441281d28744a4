"""The portable core of the transceiver's firmware as a library of this machine, for tests and fuzzing.

It is compiled with the address and undefined-behaviour sanitizers: a fault in it ends the process with a report.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from shared.protocol.transceiver import FINGERPRINT, Frame, Hello, Welcome
from shared.protocol.transceiver_frame import FrameReader, encode

_MOST_BYTES = 255
_FUNCTIONS: tuple[tuple[str, list[Any], Any], ...] = (
    ("start", [ctypes.c_uint8, ctypes.c_uint8], None),
    ("advance", [ctypes.c_uint16], None),
    ("loop", [], None),
    ("arrive", [ctypes.c_uint8, ctypes.c_char_p, ctypes.c_size_t], ctypes.c_size_t),
    ("leave", [ctypes.c_uint8, ctypes.c_char_p, ctypes.c_size_t], ctypes.c_size_t),
    ("disturb", [ctypes.c_uint8, ctypes.c_bool, ctypes.c_bool], None),
    ("flood", [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t], ctypes.c_size_t),
    ("is_low", [ctypes.c_uint8], ctypes.c_bool),
    ("baud", [ctypes.c_uint8], ctypes.c_uint32),
    ("fed", [], ctypes.c_uint32),
    ("stop_cause", [], ctypes.c_int),
    ("stop_detail", [], ctypes.c_int),
)


class Core:
    """The portable core, its wires and its time in the test's hands."""

    def __init__(self, path: Path) -> None:
        """`path`: of the library that `build_core_library` makes. Raises `OSError`."""
        library = ctypes.CDLL(str(path))
        for name, arguments, result in _FUNCTIONS:
            function = getattr(library, f"host_{name}")
            function.argtypes, function.restype = arguments, result
        self._library = library
        self._reader = FrameReader()
        self.start()

    def start(self, cause: int = 0, detail: int = 0) -> None:
        self._library.host_start(cause, detail)

    def arrive(self, port: int, data: bytes) -> int:
        """Bytes come in on a wire; how many the ring took."""
        return int(self._library.host_arrive(port, data, len(data)))

    def leave(self, port: int) -> bytes:
        buffer = ctypes.create_string_buffer(_MOST_BYTES)
        count = self._library.host_leave(port, buffer, _MOST_BYTES)
        return buffer.raw[:count]

    def tell(self, *frames: Frame) -> None:
        for frame in frames:
            data = encode(frame)
            self.arrive(0, data)
            self.run(0)  # a long frame takes two turns
            self.run(0)

    def run(self, ms: int) -> None:
        self._library.host_loop()
        for _ in range(ms):
            self._library.host_advance(1)
            self._library.host_loop()

    def heard(self) -> list[Frame]:
        """The frames that have come since the last call, by loops in which no time passes."""
        frames: list[Frame] = []
        while data := self.leave(0):
            frames += self._reader.feed(data)
            self.run(0)
        return frames

    def flood(self, data: bytes, portion: int) -> int:
        """Bytes into USB and radio A, a millisecond after each portion; how many came out on all wires."""
        return int(self._library.host_flood(data, len(data), portion))

    def open_session(self, number: int = 5) -> None:
        self.heard()
        self.tell(Hello(FINGERPRINT, number))
        if number not in {frame.session for frame in self.heard() if isinstance(frame, Welcome)}:
            raise AssertionError("the firmware did not welcome its host")

    def disturb(self, port: int, framing: bool, overrun: bool) -> None:
        """A byte comes in with these errors."""
        self._library.host_disturb(port, framing, overrun)

    def baud(self, port: int) -> int:
        return int(self._library.host_baud(port))

    def is_low(self, radio: int) -> bool:
        """The radio's reset pin is pulled."""
        return bool(self._library.host_is_low(radio))

    def fed(self) -> int:
        """How often the watchdog was fed."""
        return int(self._library.host_fed())

    def stopped(self) -> tuple[int, int]:
        """Cause and detail of the first stop; the cause is -1 when there was none."""
        return int(self._library.host_stop_cause()), int(self._library.host_stop_detail())
