"""The transceiver's USB wire: the firmware's core and hex, and the host's parser and session.

The core is compiled with sanitizers: undefined behaviour or a stray access ends the process with a report.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.protocol.transceiver_session import TransceiverSession
from shared.protocol.transceiver_stream import FROM_RADIO_BYTES, TO_RADIO_BYTES
from tools.fuzz.base import Verdict, require
from tools.simulator.devices.mega import StepMega
from tools.simulator.devices.mega_core import Core

_CHUNK_BYTES = 50_000
_REMEMBERED = 200
_TURN_US, _US_PER_USB_BYTE = 1_000, 25
_FRAMES_A_TURN = 40
_RADIO_BYTES = 100
_MOST_OF = {"B": 0xFF, "H": 0xFFFF, "I": 0xFFFFFFFF}


def foreign_bytes(rng: np.random.Generator) -> Iterator[bytes]:
    """Without end: sound frames of any content, and what can become of frames on a bad wire."""
    remembered = [encode(t.Ping(1))]
    while True:
        frame = _sound_frame(rng)
        match rng.integers(8):
            case 0:
                yield rng.bytes(int(rng.integers(1, 100)))
            case 1:
                yield _mutated(frame, rng)
            case 2:
                yield frame[: rng.integers(1, len(frame))]
            case 3:
                yield remembered[rng.integers(len(remembered))]
            case 4:
                yield bytes(rng.integers(0, 3, int(rng.integers(1, 120)), dtype=np.uint8))
            case _:
                yield frame
        if len(remembered) < _REMEMBERED:
            remembered.append(frame)
        else:
            remembered[rng.integers(_REMEMBERED)] = frame


def _sound_frame(rng: np.random.Generator) -> bytes:
    layout = list(t.LAYOUTS.values())[rng.integers(len(t.LAYOUTS))]
    values: dict[str, Any] = {name: _number(code, rng) for name, code in layout.codes}
    if "fingerprint" in values and rng.random() < 0.8:
        values["fingerprint"] = t.FINGERPRINT
    if "session" in values:
        values["session"] = int(rng.integers(1, 4))
    if layout.has_data:
        values["data"] = rng.bytes(int(rng.integers(1, t.MAX_DATA_BYTES + 1)))
    return encode(layout.kind(**values))


def _number(code: str, rng: np.random.Generator) -> int:
    """Often small: there are two radios, and streams begin at 0."""
    most = _MOST_OF[code]
    return int(rng.integers(min(most, 4 if rng.random() < 0.5 else 300) if rng.random() < 0.7 else most))


def _mutated(frame: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(frame)
    for _ in range(rng.integers(1, 4)):
        data[rng.integers(len(data))] = rng.integers(256)
    return bytes(data)


class FirmwareCore:
    """The wire has a CRC-16 and no key: a frame that passes is the host's. What the radios carry is sealed."""

    def __init__(self, rng: np.random.Generator, core: Core) -> None:
        self._rng = rng
        self._core = core
        self._source = foreign_bytes(rng)
        self._foreign = self._answered = 0

    def throw(self) -> int:
        chunk = bytearray()
        while len(chunk) < _CHUNK_BYTES:
            chunk += next(self._source)
            self._foreign += 1
        _settle(self._core)
        self._core.open_session(int(self._rng.integers(10, 1 << 32)))
        self._answered += self._core.flood(bytes(chunk), int(self._rng.integers(1, 200)))
        require(self._core.stopped()[0] == -1, f"the core stopped: {self._core.stopped()}")
        return len(chunk)

    def verdict(self) -> Verdict:
        _settle(self._core)
        self._core.open_session(9)
        self._core.tell(t.Ping(1))
        self._core.run(5)
        (own,) = [f for f in self._core.heard() if isinstance(f, t.Health)]
        require(self._answered > 0, "the core answered nothing")
        return Verdict(self._foreign, 0, own.frames_in, 0)


def _settle(core: Core) -> None:
    """End the frame that the flood left half said."""
    core.run(10)
    core.arrive(t.Port.USB, b"\0")
    core.run(1)
    core.heard()


class FirmwareHex:
    """The same on the emulated Mega, on all three of its wires."""

    def __init__(self, rng: np.random.Generator, mega: StepMega) -> None:
        self._rng = rng
        self._mega = mega
        self._source = foreign_bytes(rng)
        self._foreign = self._answered = 0
        mega.run(20_000)

    def throw(self) -> int:
        usb = b"".join(next(self._source) for _ in range(_FRAMES_A_TURN))
        self._foreign += _FRAMES_A_TURN
        radios = (self._rng.bytes(_RADIO_BYTES), usb[:_RADIO_BYTES])
        out = self._mega.run(_TURN_US + _US_PER_USB_BYTE * len(usb), usb, radios)
        self._answered += len(out.usb)
        require(not {"reset", "crashed"} & {event.kind for event in out.events}, "the firmware began anew")
        return len(usb)

    def verdict(self) -> Verdict:
        self._mega.run(2_000_000, b"\0")  # its last session times out
        require(self._answered > 0, "the firmware answered nothing")
        return Verdict(self._foreign, 0, self._answered, 0)


class Host:
    """The Python side; time goes on by 1 ms with each portion."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._session = TransceiverSession(0)
        self._reader = FrameReader()
        self._own = FrameReader()
        self._source = foreign_bytes(rng)
        self._rng = rng
        self._now_s = 0.0
        self._foreign = 0

    def throw(self) -> int:
        portion = bytearray()
        while len(portion) < self._rng.integers(1, 400):
            portion += next(self._source)
            self._foreign += 1
        self._take(bytes(portion))
        return len(portion)

    def _take(self, portion: bytes) -> None:
        self._now_s += 0.001
        self._reader.feed(portion)
        self._session.feed(portion, self._now_s)
        for radio in range(t.RADIOS):
            self._session.write(radio, portion)
            require(len(self._session.read(radio)) <= FROM_RADIO_BYTES, "a stream grew over its bound")
        self._answer(self._session.take_output())

    def _answer(self, output: bytes) -> None:
        require(len(output) < 4 * TO_RADIO_BYTES, "the host said too much at once")
        for frame in self._own.feed(output):
            if isinstance(frame, t.Hello):
                self._session.feed(encode(t.Welcome(frame.session, *t.VERSION, 0, 0)), self._now_s)

    def verdict(self) -> Verdict:
        require(self._session.health.sessions > 1, "no session came about")
        return Verdict(self._foreign, 0, self._reader.frames, 0)
