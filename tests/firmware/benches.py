"""The firmware in two forms: its core as a library with sanitizers, its hex on an emulated Mega."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from shared.protocol.transceiver import FINGERPRINT, Frame, Hello, Welcome
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.protocol.transceiver_session import TransceiverSession
from tools.simulator.devices.mega import MegaEvent, StepMega

Spoil = Callable[[bytes], bytes]
_MOST_BYTES = 255
_STEP_US = 2_000


class Core:
    """The portable core, its wires and its time in the test's hands."""

    def __init__(self, library: ctypes.CDLL) -> None:
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
            assert self.arrive(0, data) == len(data)
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

    def open_session(self, number: int = 5) -> None:
        self.heard()
        self.tell(Hello(FINGERPRINT, number))
        assert Welcome(number) in self.heard()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, f"host_{name}")


class Bench:
    """The emulated Mega and the host's session in virtual time; the radios' wires end here."""

    def __init__(self, mega: StepMega) -> None:
        self.mega = mega
        self.session = TransceiverSession(first_session=7)
        self.now_s = 0.0
        self.sent = [bytearray(), bytearray()]  # by the host, arrived at the radios
        self.events: list[MegaEvent] = []
        self.usb_bytes = 0
        self.spoil: Spoil = bytes  # what happens on USB to bytes from the host
        self.spoil_back: Spoil = bytes  # and to it

    def step(self, radios: tuple[bytes, bytes] = (b"", b""), us: int = _STEP_US) -> None:
        out = self.mega.run(us, self.spoil(self.session.take_output()), radios)
        self.now_s = out.now_us / 1e6
        self.usb_bytes += len(out.usb)
        self.events += out.events
        for radio, data in enumerate(out.radios):
            self.sent[radio] += data
        if out.usb:
            self.session.feed(self.spoil_back(out.usb), self.now_s)
        self.session.tick(self.now_s)

    def run(self, seconds: float) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.step()

    def until(self, condition: Callable[[], object], limit_s: float = 5.0) -> None:
        until_s = self.now_s + limit_s
        while not condition():
            assert self.now_s < until_s, f"not in {limit_s} s: {self.session.state}, {self.session.trouble}"
            self.step()

    def bring_up(self) -> None:
        self.until(lambda: self.session.is_up)
