"""Wi-Fi that can be cut, on a manual clock: connections that stall, come back late, or are refused, as TCP's do."""

from __future__ import annotations

from collections import deque

import numpy as np

from shared.link.base import ForRadio, Lane, Link, LinkError, LinkHealth, LinkPath, LinkStatistics, PathChanged
from shared.runtime.clock import Clock

_LATENCY_S = (0.001, 0.008)
_BACKLOG_BYTES = 49_152  # of the program and of the kernel
_LONGEST_RESUME_S = 1.0  # a stalled connection tries again ever more seldom


class CuttableWifi:
    """Between one robot and one station."""

    def __init__(self, clock: Clock, rng: np.random.Generator) -> None:
        self.clock = clock
        self.rng = rng
        self.whole = True
        self.moves_from_s = 0.0  # stalled connections carry again from then on
        self.cut_s = 0.0
        self._robot: WifiEnd | None = None

    def cut(self) -> None:
        self.whole, self.cut_s = False, self.clock.now_s()

    def restore(self) -> None:
        now_s = self.clock.now_s()
        resume_s = float(self.rng.uniform(0.0, min(now_s - self.cut_s, _LONGEST_RESUME_S)))
        self.whole, self.moves_from_s = True, now_s + resume_s

    def connect(self) -> Link:
        """The station's end of a new connection. Raises `LinkError` while the network is cut."""
        if not self.whole:
            raise LinkError("cannot connect to the robot: no answer in time")
        station, self._robot = WifiEnd(self, self.clock.now_s()), WifiEnd(self, self.clock.now_s())
        station.peer, self._robot.peer = self._robot, station
        return station

    def robot_end(self) -> Link | None:
        """The robot's end of the newest connection, while it is open."""
        return self._robot if self._robot is not None and not self._robot.is_closed else None


class WifiEnd:
    path = LinkPath.WIFI
    mends_itself = False
    resets = 0

    def __init__(self, network: CuttableWifi, made_s: float) -> None:
        self.statistics = LinkStatistics()
        self.events: deque[PathChanged] = deque(maxlen=1)  # there are none
        self.peer: WifiEnd | None = None
        self.is_closed = False
        self._network = network
        self._made_s = made_s
        self.incoming: deque[tuple[float, bytes]] = deque()
        self.arrived_s = 0.0

    @property
    def connected(self) -> bool:
        return not self.is_closed

    @property
    def has_room(self) -> bool:
        return self.connected and self.peer is not None and not self.peer.incoming

    @property
    def health(self) -> LinkHealth:
        return LinkHealth(wifi=self.connected)

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del lane, slot, for_radio
        self._fail_if_closed()
        assert self.peer is not None
        if sum(len(d) for _, d in self.peer.incoming) + len(datagram) > _BACKLOG_BYTES:
            return False
        latency_s = float(self._network.rng.uniform(*_LATENCY_S))
        at_s = max(self._network.clock.now_s() + latency_s, self.peer.arrived_s)  # TCP keeps the order
        self.peer.arrived_s = at_s
        self.peer.incoming.append((at_s, datagram))
        return True

    def receive(self, timeout_s: float) -> bytes | None:
        del timeout_s
        self._fail_if_closed()
        now_s = self._network.clock.now_s()
        stalled = not self._network.whole or (now_s < self._network.moves_from_s and self._is_old())
        if stalled:
            return None
        if self.incoming and self.incoming[0][0] <= now_s:
            return self.incoming.popleft()[1]
        if self.peer is not None and self.peer.is_closed:
            raise LinkError("Wi-Fi: the other side closed the connection")
        return None

    def close(self) -> None:
        self.is_closed = True

    def _is_old(self) -> bool:
        """It was there before the last cut."""
        return self._made_s < self._network.cut_s

    def _fail_if_closed(self) -> None:
        if self.is_closed:
            raise LinkError("Wi-Fi: the connection is closed")
