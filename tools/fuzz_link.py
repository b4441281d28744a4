"""Throw bytes at everything of the link that reads foreign ones: random, mutated, truncated, replayed.

`python -m tools.fuzz_link --bytes 10000000`. Both sides of a conversation go on meanwhile: at the end everything that
was sent has arrived once and in order, and nothing else has.
"""

from __future__ import annotations

import argparse
import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shared.link.failover.lanes import Path
from shared.link.radio_pair import items
from shared.link.radio_pair.conversation import Conversation
from shared.link.radio_pair.lanes import Lanes
from shared.protocol.auth import Answerer, Caller
from shared.protocol.fragment import Assembler, StreamError
from tools.simulator.radio.failover_rig import FailoverRig

_PACKET_BYTES = 50
_KEY = bytes(range(32))
_REMEMBERED = 200
_MOST_DATAGRAM_BYTES = 65_000


@dataclass(slots=True)
class FuzzResult:
    offered_bytes: int = 0
    forged_packets: int = 0  # neither genuine nor genuine again
    accepted_forgeries: int = 0
    delivered: int = 0
    wrongly_delivered: int = 0
    sessions: int = 0


class _Pair:
    """Two sides that exchange numbered datagrams, packet by packet, without modules."""

    def __init__(self, rng: np.random.Generator) -> None:
        lanes = Lanes(4_096, _MOST_DATAGRAM_BYTES), Lanes(4_096, _MOST_DATAGRAM_BYTES)
        self.robot = Conversation(lanes[0], _PACKET_BYTES, Caller(_KEY, rng.bytes))
        self.station = Conversation(lanes[1], _PACKET_BYTES, Answerer(_KEY, rng.bytes))
        self.genuine: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._rng = rng
        self._now_s = 0.0
        self._sent = {self.robot: 0, self.station: 0}
        self._read = {self.robot: 0, self.station: 0}
        self.wrong = 0
        self.known: set[bytes] = set()
        self.greet()

    @property
    def delivered(self) -> int:
        return sum(self._read.values())

    def greet(self) -> None:
        call = self.robot.call()
        heard = self.station.hear(call)
        assert heard is not None
        assert heard.answer is not None
        self.robot.hear(heard.answer)
        self._remember(call)
        self._remember(heard.answer)
        self.exchange()

    def exchange(self) -> None:
        """A packet or two each way."""
        self._now_s += 1.0
        for side, other in ((self.robot, self.station), (self.station, self.robot)):
            size = int(self._rng.integers(4, 90))
            if side.lanes.waiting_bytes < 500:
                side.lanes.queue(self._sent[side].to_bytes(4, "little") + bytes(size), items.Lane.BULK, 0)
                self._sent[side] += 1
            for turn in (False, True):
                packet = side.next_packet(0, turn, report=turn)
                if packet is None:
                    continue
                self._remember(packet.data)
                side.lanes.left(packet.loads, self._now_s)
                other.hear(packet.data)
            other.lanes.settle(self._now_s - 0.5)
            self._check(other, side)

    def _check(self, reader: Conversation, writer: Conversation) -> None:
        while reader.lanes.delivered:
            datagram = reader.lanes.delivered.popleft()
            self.wrong += int.from_bytes(datagram[:4], "little") != self._read[writer] or any(datagram[4:])
            self._read[writer] += 1

    def _remember(self, packet: bytes) -> None:
        self.genuine.append(packet)
        self.known.add(packet)


def fuzz_conversation(rng: np.random.Generator, total_bytes: int) -> FuzzResult:
    """Sealed packets and greetings: none that was changed may be taken for the other side's."""
    pair, result = _Pair(rng), FuzzResult()
    for count, packet in enumerate(_foreign(pair.genuine, rng)):
        if result.offered_bytes >= total_bytes:
            break
        result.offered_bytes += len(packet)
        is_forged = packet not in pair.known
        result.forged_packets += is_forged
        for side in (pair.robot, pair.station):
            result.accepted_forgeries += side.hear(packet) is not None and is_forged
        if count % 20 == 0:
            pair.exchange()
        if count % 20_000 == 19_999:
            pair.known = set(pair.genuine)
            pair.greet()
    result.delivered, result.wrongly_delivered = pair.delivered, pair.wrong
    result.sessions = pair.robot.statistics.sessions
    return result


def fuzz_parsers(rng: np.random.Generator, total_bytes: int) -> int:
    """What stands behind the seal is parsed as carefully; returns how many bytes were offered."""
    offered, held = 0, Assembler(1_000)
    lanes = Lanes(4_096, _MOST_DATAGRAM_BYTES)
    while offered < total_bytes:
        body = rng.bytes(int(rng.integers(0, 50)))
        offered += len(body) + 1
        for item in items.read(body)[0]:
            assert items.read(items.write(item))[0] == [item]
        try:
            lanes.take_items(body)
        except StreamError:
            lanes.reset()
        lanes.delivered.clear()
        try:
            held.feed(body)
        except StreamError:
            held = Assembler(1_000)
    return offered


def fuzz_failover(rng: np.random.Generator, total_bytes: int) -> int:
    """Frames that came over a path that is trusted and make no sense."""
    rig = FailoverRig(1)
    rig.run(10.0)
    offered = 0
    while offered < total_bytes:
        frame = rng.bytes(int(rng.integers(1, 60)))
        offered += len(frame)
        for path in Path:
            rig.station._take(path, frame, 10.0)  # noqa: SLF001 - the one place where foreign frames come in
        rig.station._delivered.clear()  # noqa: SLF001
    return offered


def _foreign(genuine: deque[bytes], rng: np.random.Generator) -> Iterator[bytes]:
    """Without end: what a stranger can make of packets that he heard."""
    while True:
        packet = genuine[int(rng.integers(len(genuine)))]
        match rng.integers(5):
            case 0:
                yield rng.bytes(int(rng.integers(1, _PACKET_BYTES + 1)))
            case 1:
                changed = bytearray(packet)
                for _ in range(int(rng.integers(1, 4))):
                    changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
                yield bytes(changed)
            case 2:
                yield packet[: int(rng.integers(1, len(packet) + 1))]
            case 3:
                yield packet[:1] + rng.bytes(len(packet) - 1)
            case _:
                yield packet


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz_link", description=__doc__)
    parser.add_argument("--bytes", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    result = fuzz_conversation(rng, args.bytes)
    print(result)
    print(f"parsers: {fuzz_parsers(rng, args.bytes)} bytes")
    print(f"failover: {fuzz_failover(rng, args.bytes)} bytes")
    return 1 if result.accepted_forgeries or result.wrongly_delivered else 0


if __name__ == "__main__":
    sys.exit(main())
