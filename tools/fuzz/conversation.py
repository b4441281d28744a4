"""Everything of the radio link and of the failover that reads foreign bytes.

Both sides of a conversation go on meanwhile: what was sent arrives once and in order, and nothing else does.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from shared.link.base import Lane, LinkPath
from shared.link.radio_pair import items
from shared.link.radio_pair.conversation import Conversation
from shared.link.radio_pair.lanes import Lanes
from shared.protocol.auth import Answerer, Caller
from shared.protocol.fragment import Assembler, StreamError
from tools.fuzz.base import Verdict, require
from tools.fuzz.foreign import Strangers
from tools.simulator.radio.failover_rig import FailoverRig

_PACKET_BYTES = 50
_KEY = bytes(range(32))
_REMEMBERED = 200
_FOREIGN_TO_AN_EXCHANGE = 20
_EXCHANGES_A_SESSION = 1_000
_FRAMES_A_ROUND = 100
_MOST_DATAGRAM_BYTES = 65_000
_MOST_WAITING_BYTES = 500


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
        require(heard is not None and heard.answer is not None, "the station does not answer a genuine call")
        assert heard is not None
        assert heard.answer is not None
        self.robot.hear(heard.answer)
        self._remember(call)
        self._remember(heard.answer)
        self.exchange()

    def forget(self) -> None:
        """Only what is remembered is known from now on."""
        self.known = set(self.genuine)

    def exchange(self) -> None:
        """A packet or two each way."""
        self._now_s += 1.0
        for side, other in ((self.robot, self.station), (self.station, self.robot)):
            size = int(self._rng.integers(4, 90))
            if side.lanes.waiting_bytes < _MOST_WAITING_BYTES:
                side.lanes.queue(self._sent[side].to_bytes(4, "little") + bytes(size), Lane.BULK, 0)
                self._sent[side] += 1
            for turn in (False, True):
                packet = side.next_packet(0, turn=turn)
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


class Packets:
    """Sealed packets and greetings at both sides."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._pair = _Pair(rng)
        self._strangers = Strangers(rng, _PACKET_BYTES + 1)
        self._foreign = self._forgeries = self._rounds = 0

    def throw(self) -> int:
        pair, offered = self._pair, 0
        for _ in range(_FOREIGN_TO_AN_EXCHANGE):
            genuine = pair.genuine[int(self._rng.integers(len(pair.genuine)))]
            self._strangers.remember(genuine)
            packet = self._strangers.next(genuine)
            offered += len(packet)
            is_forged = packet not in pair.known
            self._foreign += is_forged
            for side in (pair.robot, pair.station):
                self._forgeries += side.hear(packet) is not None and is_forged
        pair.exchange()
        self._rounds += 1
        if self._rounds % _EXCHANGES_A_SESSION == 0:
            pair.forget()
            pair.greet()
        return offered

    def verdict(self) -> Verdict:
        delivered = self._pair.delivered
        self._pair.exchange()
        require(self._pair.delivered > delivered, "the conversation does not go on")
        return Verdict(self._foreign, self._forgeries, self._pair.delivered, self._pair.wrong)


class Items:
    """What stands behind the seal is parsed as carefully, although nobody else can have written it."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._lanes = Lanes(4_096, _MOST_DATAGRAM_BYTES)
        self._held = Assembler(1_000)
        self._foreign = 0

    def throw(self) -> int:
        offered = 0
        for _ in range(_FRAMES_A_ROUND):
            body = self._rng.bytes(int(self._rng.integers(1, _PACKET_BYTES)))
            offered += len(body)
            self._foreign += 1
            for item in items.read(body)[0]:
                require(items.read(items.write(item))[0] == [item], f"{item} is read otherwise than it is written")
            self._take(body)
        return offered

    def _take(self, body: bytes) -> None:
        try:
            self._lanes.take_items(body)
        except StreamError:
            self._lanes.reset()
        self._lanes.delivered.clear()
        try:
            self._held.feed(body)
        except StreamError:
            self._held = Assembler(1_000)

    def verdict(self) -> Verdict:
        return Verdict(self._foreign, 0, 0, 0)


class FailoverFrames:
    """Frames that came over a path that is trusted and make no sense."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._rig = FailoverRig(1)
        self._rig.run(10.0)
        self._foreign = 0

    def throw(self) -> int:
        offered, station = 0, self._rig.station
        for _ in range(_FRAMES_A_ROUND):
            frame = self._rng.bytes(int(self._rng.integers(1, 60)))
            offered += len(frame)
            self._foreign += 1
            for path in LinkPath:
                station._take(path, frame, 10.0)  # noqa: SLF001 - the one place where foreign frames come in
            station._delivered.clear()  # noqa: SLF001
        return offered

    def verdict(self) -> Verdict:
        return Verdict(self._foreign, 0, 0, 0)
