"""Turns and lanes under random schedules: losses, bursts, delays, radios that come and go, restarts, an attacker who
jams and plays again. Modules are modelled as half duplex, with a pause after each packet and room for two."""

from __future__ import annotations

import random
from collections import defaultdict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from shared.link.base import Lane
from shared.link.radio_pair.config import PairConfig, Timing
from shared.link.radio_pair.conversation import Conversation, Packet
from shared.link.radio_pair.lanes import Lanes
from shared.link.radio_pair.turns import AnsweringTurns, AskingTurns, Turns
from shared.protocol.auth import Answerer, Caller, Kind, read_head

AIR_S, PAUSE_S, STEP_S = 0.0385, 0.05, 0.004
TIMING = Timing(AIR_S, 0.008, 10 / 115_200)
LANES = list(Lane)
ROBOT, STATION = 0, 1
OFTEN = [
    *((ROBOT, Lane.COMMAND, 30), (ROBOT, Lane.NEWEST, 25), (STATION, Lane.COMMAND, 18), (STATION, Lane.COMMAND, 200)),
    *((STATION, Lane.NEWEST, 12), (STATION, Lane.NOW, 10), (STATION, Lane.BULK, 60)),
]


@dataclass
class Module:
    is_up: bool = False
    waiting: deque[Packet] = field(default_factory=deque)
    sends: tuple[float, Packet, bool] | None = None  # until when, and whether it is in its pause


class Side:
    def __init__(self, world: World, side: int) -> None:
        self.world, self.side = world, side
        greeter = (Answerer if side else Caller)(bytes(32), world.rng.randbytes)
        self.lanes = Lanes(world.config.bulk_limit_bytes, 65_000)
        self.conversation = Conversation(self.lanes, 50, greeter)
        make = AnsweringTurns if side else AskingTurns
        self.turns: Turns = make(self.conversation, TIMING, world.config, 2)
        self.modules = [Module(), Module()]
        for radio in (0, 1):
            self.switch(radio, True)

    def switch(self, radio: int, is_up: bool) -> None:
        module, now_s = self.modules[radio], self.world.now_s
        if is_up == module.is_up:
            return
        for packet in [*module.waiting, *([module.sends[1]] if module.sends else [])]:
            self.turns.failed(radio, packet, now_s)
        self.modules[radio] = Module(is_up)
        self.turns.set_up(radio, is_up, now_s)

    def step(self) -> None:
        now_s = self.world.now_s
        for radio, module in enumerate(self.modules):
            while module.is_up and len(module.waiting) + (module.sends is not None) < 2:
                packet = self.turns.next_packet(radio, now_s)
                if packet is None:
                    break
                module.waiting.append(packet)
            if module.sends is not None and now_s >= module.sends[0]:
                _, packet, pauses = module.sends
                module.sends = None if pauses else (module.sends[0] + PAUSE_S, packet, True)
                if pauses:
                    self.turns.sent(radio, packet, now_s)
                else:
                    self.world.carry(1 - self.side, radio, packet.data)
            elif module.sends is None and module.waiting:
                packet = module.waiting.popleft()
                module.sends = now_s + TIMING.sense_s + AIR_S * (len(packet.data) + 15) / 65, packet, False


class World:
    """`epochs` count how often what a side had sent was forgotten."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.now_s = 0.0
        self.config = PairConfig(turn_s=self.rng.choice([0.18, 0.4, 1.0]))
        self.is_bad = True
        self.sent: dict[tuple[int, Lane, int], int] = defaultdict(int)
        self.came: dict[tuple[int, Lane, int], list[int]] = defaultdict(list)
        self.epochs = [0, 0]
        self._loss = self.rng.choice([0.0, 0.05, 0.2, 0.5])
        self._late_s = self.rng.choice([0.0, 0.05, 0.3])
        self._on_the_way: list[tuple[float, int, int, bytes]] = []
        self._recorded: deque[tuple[int, bytes]] = deque(maxlen=600)
        self._jammed_until_s, self._is_jammed = 0.0, (ROBOT, Kind.DATA)
        self.sides = [Side(self, ROBOT), Side(self, STATION)]

    def carry(self, to: int, radio: int, data: bytes) -> None:
        self._recorded.append((to, data))
        is_jammed = self.now_s < self._jammed_until_s and (to, read_head(data[0])[0]) == self._is_jammed
        if self.is_bad and (is_jammed or self.rng.random() < self._loss):
            return
        late_s = self.rng.random() * self._late_s if self.rng.random() < 0.1 else 0.0
        self._on_the_way.append((self.now_s + 0.012 + late_s, to, radio, data))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        end_s = self.now_s + seconds
        while self.now_s < end_s and not until():
            self.now_s += STEP_S
            self._deliver()
            if self.is_bad:
                self._order()
                self._disturb()
            for side in self.sides:
                side.step()
            self._take()
        return until()

    def _deliver(self) -> None:
        due = sorted(p for p in self._on_the_way if p[0] <= self.now_s)
        self._on_the_way = [p for p in self._on_the_way if p[0] > self.now_s]
        for _, to, radio, data in due:
            module = self.sides[to].modules[radio]
            if module.is_up and module.sends is None:
                self.sides[to].turns.heard(radio, data, self.now_s)
        for number, side in enumerate(self.sides):
            self.epochs[number] += side.conversation.peer_changed
            side.conversation.peer_changed = False

    def _order(self) -> None:
        if self.sides[ROBOT].lanes.waiting_bytes < 150:
            self._send(ROBOT, Lane.BULK, self.rng.randint(8, 160))
        for side, lane, size in OFTEN:
            if self.rng.random() < 0.006:
                self._send(side, lane, size)

    def _send(self, side: int, lane: Lane, size: int) -> None:
        key = side, lane, self.epochs[side]
        name = bytes((side, LANES.index(lane), self.epochs[side])) + self.sent[key].to_bytes(4, "little")
        sender = self.sides[side]
        if sender.conversation.has_session and sender.lanes.queue(name + bytes(size - len(name)), lane, 1):
            self.sent[key] += 1

    def _disturb(self) -> None:
        rng = self.rng
        if rng.random() < 0.0004:
            side, radio = rng.choice(self.sides), rng.randrange(2)
            side.switch(radio, not side.modules[radio].is_up)
        if rng.random() < 0.00005:
            number = rng.randrange(2)
            self.sides[number] = Side(self, number)
            self.epochs[number] += 1
        if self._recorded and rng.random() < 0.02:
            to, data = rng.choice(self._recorded)
            self._on_the_way.append((self.now_s, to, rng.randrange(2), data))
        if self.now_s > self._jammed_until_s and rng.random() < 0.001:
            self._jammed_until_s = self.now_s + rng.choice([1.0, 5.0, 20.0])
            self._is_jammed = rng.randrange(2), rng.choice([Kind.ITEMS, Kind.DATA])

    def _take(self) -> None:
        for number, side in enumerate(self.sides):
            while side.lanes.delivered:
                datagram = side.lanes.delivered.popleft()
                assert datagram[0] == 1 - number
                assert not any(datagram[7:])
                key = datagram[0], LANES[datagram[1]], datagram[2]
                self.came[key].append(int.from_bytes(datagram[3:7], "little"))

    def all_has_come(self) -> bool:
        now = [key for key in self.sent if key[2] == self.epochs[key[0]] and key[1] is not Lane.NEWEST]
        return all(len(self.came[key]) == self.sent[key] for key in now)


@pytest.mark.parametrize("seed", range(12))
def test_whatever_happens_on_the_air_everything_comes_once_and_in_order(seed: int) -> None:
    world = World(seed)
    world.run(20.0)
    world.is_bad = False
    for side in world.sides:
        for radio in (0, 1):
            side.switch(radio, True)
    assert world.run(60.0, world.all_has_come)
    for (_, lane, _), came in world.came.items():
        if lane in {Lane.BULK, Lane.COMMAND}:
            assert came == list(range(len(came)))
        elif lane is Lane.NEWEST:
            assert all(a < b for a, b in pairwise(came))
        assert len(set(came)) == len(came)
