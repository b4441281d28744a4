"""Throw bytes at the transceiver's firmware core and at the host's parser: random, mutated, truncated, replayed.

`python -m tools.fuzz_transceiver --bytes 10000000`. The core is compiled with sanitizers: undefined behaviour or a
stray access ends the program with a report.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.protocol.transceiver_session import TransceiverSession
from shared.protocol.transceiver_stream import FROM_RADIO_BYTES, TO_RADIO_BYTES
from tools.simulator.devices.mega import MegaError, StepMega
from tools.simulator.devices.mega_build import MegaUnavailableError, build_core_library, build_mega
from tools.simulator.devices.mega_core import Core

_CHUNK_BYTES = 50_000
_REMEMBERED = 200
_TURN_US, _US_PER_USB_BYTE = 1_000, 25
_MOST_OF = {"B": 0xFF, "H": 0xFFFF, "I": 0xFFFFFFFF}


@dataclass(frozen=True, slots=True)
class FuzzResult:
    offered_bytes: int
    core_frames: int  # sound ones that the core counted
    core_answer_bytes: int
    host_frames: int
    host_sessions: int


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


def fuzz(core: Core, byte_count: int, rng: np.random.Generator) -> FuzzResult:
    """Both sides take the same bytes. Raises `AssertionError` when a bound is broken or the core stops."""
    source = foreign_bytes(rng)
    host = _Host(rng)
    answered = offered = 0
    while offered < byte_count:
        chunk = bytearray()
        while len(chunk) < _CHUNK_BYTES:
            chunk += next(source)
        _settle(core)
        core.open_session(int(rng.integers(10, 1 << 32)))
        answered += core.flood(bytes(chunk), int(rng.integers(1, 200)))
        host.take(bytes(chunk))
        offered += len(chunk)
        _check(core.stopped()[0] == -1, f"the core stopped: {core.stopped()}")
    _settle(core)
    core.open_session(9)
    core.tell(t.Ping(1))
    core.run(5)
    (own,) = [f for f in core.heard() if isinstance(f, t.Health)]
    return FuzzResult(offered, own.frames_in, answered, host.reader.frames, host.session.health.sessions)


def _settle(core: Core) -> None:
    """End the frame that the flood left half said."""
    core.run(10)
    core.arrive(t.Port.USB, b"\0")
    core.run(1)
    core.heard()


def fuzz_hex(mega: StepMega, byte_count: int, rng: np.random.Generator) -> int:
    """The hex takes the bytes on all three wires; how many it said on USB. Raises `AssertionError` on a reset."""
    source = foreign_bytes(rng)
    mega.run(20_000)
    offered = answered = 0
    while offered < byte_count:
        usb = b"".join(next(source) for _ in range(40))
        offered += len(usb)
        out = mega.run(_TURN_US + _US_PER_USB_BYTE * len(usb), usb, (rng.bytes(100), usb[:100]))
        answered += len(out.usb)
        _check(not {"reset", "crashed"} & {event.kind for event in out.events}, "the firmware began anew")
    mega.run(2_000_000, b"\0")  # its last session times out
    return answered


class _Host:
    """The Python side; time goes on by 1 ms with each portion."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.session = TransceiverSession(0)
        self.reader = FrameReader()
        self._own = FrameReader()
        self._rng = rng
        self._now_s = 0.0

    def take(self, data: bytes) -> None:
        at = 0
        while at < len(data):
            portion = data[at : at + int(self._rng.integers(1, 400))]
            at += len(portion)
            self._now_s += 0.001
            self.reader.feed(portion)
            self.session.feed(portion, self._now_s)
            for radio in range(t.RADIOS):
                self.session.write(radio, portion)
                _check(len(self.session.read(radio)) <= FROM_RADIO_BYTES, "a stream grew over its bound")
            self._answer(self.session.take_output())

    def _answer(self, output: bytes) -> None:
        _check(len(output) < 4 * TO_RADIO_BYTES, "the host said too much at once")
        for frame in self._own.feed(output):
            if isinstance(frame, t.Hello):
                self.session.feed(encode(t.Welcome(frame.session, *t.VERSION, 0, 0)), self._now_s)


def _check(holds: bool, complaint: str) -> None:
    if not holds:
        raise AssertionError(complaint)


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz_transceiver", description=__doc__)
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hex", action="store_true", help="the hex on an emulated Mega instead; half real time")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    try:
        if arguments.hex:
            with StepMega(build_mega()) as mega:
                print(f"{fuzz_hex(mega, arguments.bytes, rng)} bytes answered")
        else:
            print(fuzz(Core(build_core_library()), arguments.bytes, rng))
    except (MegaUnavailableError, MegaError, OSError) as error:
        print(f"fuzz_transceiver: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
