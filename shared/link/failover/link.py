"""Algorithm 3 of the paper, and beyond: Wi-Fi as long as its acknowledgements come, LoRa the moment they do not.

Both receive paths are always open, and LoRa stays hot: commands, stops and the newest values travel on both, whatever
comes first counts. Observations travel on one path; what was not acknowledged when it fails is sent again on the other.
A frame of ours is two bytes and the datagram:

    kind (3 bits) and the lowest bits of both sides' epochs (5)    number, lowest byte

An epoch is drawn when a side begins; `Hello` tells it on each path, and a path counts once both know both.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from shared.link.base import MAX_DATAGRAM_BYTES, ForRadio, Lane, Link, LinkError, LinkHealth, LinkPath, PathChanged
from shared.link.failover.base import FailoverStatistics, Kind, Radio, SpeaksPlainly
from shared.link.failover.lanes import Incoming, Kept, Newer, Outgoing
from shared.link.failover.watch import FailoverConfig, Watch
from shared.link.radio_pair.items import MOST_SHORT_BYTES
from shared.protocol.auth import RandomBytes
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_HEAD_BYTES = 2
_EPOCH_BYTES = 4
_EPOCH_TAG_BITS = 5
_PAST_EPOCHS = 16
_MOST_EVENTS = 256
_MOST_DELIVERED = 1_024
_DATAGRAMS_PER_STEP = 256
_WAIT_S = 0.005
_ACK_SLOT, _HELLO_SLOT = 31, 30  # of the radio's NEWEST lane; ours
MOST_SLOTS = 30


def is_greeting(datagram: bytes) -> bool:
    """Whether a failover speaks: what `codec` makes begins with its version, which is not 0."""
    return len(datagram) == _HEAD_BYTES + 2 * _EPOCH_BYTES and datagram[0] == Kind.HELLO and datagram[1] <= 1


class Failover:
    """A `Link`. `connect` makes the Wi-Fi link, now and whenever it is lost: the robot's gives its server again.

    Owns no thread: `step`, or `receive`, is called often.
    """

    def __init__(
        self,
        connect: Callable[[], Link | None],
        radio: Radio,
        clock: Clock,
        random_bytes: RandomBytes,
        config: FailoverConfig | None = None,
        when_closed: Callable[[], None] = lambda: None,
    ) -> None:
        """`connect` does not wait: None while there is nothing yet; it may raise `LinkError`. `SpeaksPlainly` is
        handed on, and ends it."""
        self.statistics = FailoverStatistics()
        self.path = LinkPath.RADIO
        self.resets = 0
        self.events: deque[PathChanged] = deque(maxlen=_MOST_EVENTS)
        self._connect = connect
        self._when_closed = when_closed
        self._radio = radio
        self._clock = clock
        self._config = config or FailoverConfig()
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._wifi: Link | None = None
        self._connected_s = -math.inf
        self._watch = Watch(self._config)
        self._random_bytes = random_bytes
        self._epoch = random_bytes(_EPOCH_BYTES)
        self._past_epochs: deque[bytes] = deque([bytes(_EPOCH_BYTES)], maxlen=_PAST_EPOCHS)
        self._peer_epoch = bytes(_EPOCH_BYTES)
        self._knows_us: set[LinkPath] = set()
        self._delivered: deque[bytes] = deque()
        self._radio_resets = 0
        self._radio_hello_s = self._radio_ack_s = -math.inf
        self._ack_due: set[LinkPath] = set()
        self._was_connected = False
        self._misfit: SpeaksPlainly | None = None
        self._reset_lanes()

    def _reset_lanes(self) -> None:
        self._out = {kind: Outgoing() for kind in (Kind.DATA, Kind.COMMAND, Kind.NOW)}
        self._in = {kind: Incoming() for kind in self._out}
        self._newer = Newer()
        self._newest_number = 0
        self._newest: dict[int, tuple[bytes, ForRadio | None]] = {}

    # ---- as a link

    @property
    def mends_itself(self) -> bool:
        return self._misfit is None

    @property
    def connected(self) -> bool:
        """The other side knows us on some path."""
        with self._lock:
            return any(self._is_open(path) for path in LinkPath)

    @property
    def health(self) -> LinkHealth:
        radio = self._radio.health
        with self._lock:
            wifi = self._is_open(LinkPath.WIFI) and self._watch.is_alive(self._clock.now_s())
            lora = None if radio.lora is None else self._is_open(LinkPath.RADIO)
            return replace(radio, wifi=wifi, lora=lora)

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        """As `Link`."""
        if not 0 < len(datagram) <= MAX_DATAGRAM_BYTES - _HEAD_BYTES:
            raise ValueError(f"a datagram of {len(datagram)} bytes; 1 to {MAX_DATAGRAM_BYTES - _HEAD_BYTES} allowed")
        with self._lock:
            self._fail_if_closed()
            if not any(self._is_open(path) for path in LinkPath) or not self._queue(datagram, lane, slot, for_radio):
                return False
            self.statistics.sent_datagrams += 1
            self.statistics.sent_bytes += len(datagram)
            self._send_due()
        return True

    @property
    def has_room(self) -> bool:
        with self._lock:
            waiting = len(self._out[Kind.DATA].unsent(self.path))
            open_ = self._is_open(self.path)
            return open_ and not waiting and (self.path is LinkPath.WIFI or self._radio.has_room)

    def receive(self, timeout_s: float) -> bytes | None:
        """As `Link`; the loss of both paths is raised once, and the link goes on by itself when one is back."""
        until_s = self._clock.now_s() + timeout_s
        while True:
            self.step()
            with self._lock:
                if self._delivered:
                    datagram = self._delivered.popleft()
                    self.statistics.received_datagrams += 1
                    self.statistics.received_bytes += len(datagram)
                    return datagram
                self._fail_if_closed()
                self._fail_if_lost()
            now_s = self._clock.now_s()
            if now_s >= until_s:
                return None
            self._clock.wait(self._stop, min(until_s, now_s + _WAIT_S))

    def close(self) -> None:
        with self._lock:
            self._stop.set()
            self._drop_wifi()
        self._radio.close()  # it takes a while: nobody who asks for anything waits for it
        self._when_closed()

    def step(self) -> None:
        """Take what has come, send what is due."""
        with self._lock:
            if self._stop.is_set():
                return
            now_s = self._clock.now_s()
            self._keep_wifi(now_s)
            self._read_all(now_s)
            self._choose_path(now_s)
            self._greet(now_s)
            self._send_due()
            self._acknowledge(now_s)
            self._was_connected |= self.connected

    # ---- paths

    def _is_open(self, path: LinkPath) -> bool:
        if path not in self._knows_us:
            return False
        return self._radio.connected if path is LinkPath.RADIO else self._wifi is not None

    def _keep_wifi(self, now_s: float) -> None:
        wifi = self._wifi
        if wifi is not None and min(self._watch.silent_s(now_s), now_s - self._connected_s) > self._config.give_up_s:
            self._drop_wifi()
        if self._wifi is None and now_s >= self._connected_s + self._config.reconnect_s:
            self._connected_s = now_s
            try:
                self._wifi = self._connect()
            except SpeaksPlainly as error:
                self._misfit = error
            except LinkError as error:
                _log.debug("Wi-Fi: %s", error)
            if self._wifi is not None:
                self.statistics.wifi_connects += 1
                self._watch.forget()

    def _drop_wifi(self) -> None:
        wifi, self._wifi = self._wifi, None
        self._knows_us.discard(LinkPath.WIFI)
        for lane in self._out.values():
            lane.forget_path(LinkPath.WIFI)
        if wifi is not None:
            wifi.close()

    def _choose_path(self, now_s: float) -> None:
        alive = self._watch.is_alive(now_s) and self._is_open(LinkPath.WIFI)
        if self.path is LinkPath.WIFI and not alive:
            self._change(LinkPath.RADIO, "its acknowledgements have stopped", now_s)
        elif (
            self.path is LinkPath.RADIO
            and alive
            and (self._watch.is_steady(now_s) or not self._is_open(LinkPath.RADIO))
        ):
            self._change(LinkPath.WIFI, "it is steadily there", now_s)
        if self._radio_resets != self._radio.resets:
            self._radio_resets = self._radio.resets
            for lane in self._out.values():
                lane.forget_path(LinkPath.RADIO)

    def _change(self, path: LinkPath, reason: str, now_s: float) -> None:
        self.path = path
        self.statistics.changes += 1
        if path is LinkPath.WIFI:  # what it had may have died with it; LoRa keeps what it was given
            for lane in self._out.values():
                lane.forget_path(path)
        text = f"Wi-Fi: {reason}; using {path.value}"
        _log.info("%s", text)
        self.events.append(PathChanged(now_s, path, text))

    # ---- out

    def _queue(self, datagram: bytes, lane: Lane, slot: int, for_radio: ForRadio | None) -> bool:
        if lane is Lane.NEWEST:
            self._newest[slot % MOST_SLOTS] = datagram, for_radio
            return True
        kind = {Lane.BULK: Kind.DATA, Lane.COMMAND: Kind.COMMAND, Lane.NOW: Kind.NOW}[lane]
        if not self._out[kind].has_room:
            return False
        self._out[kind].add(datagram, for_radio)
        return True

    def _send_due(self) -> None:
        for kind in (Kind.NOW, Kind.COMMAND):
            for path in LinkPath:
                self._send_lane(kind, path)
        self._send_newest()
        self._send_lane(Kind.DATA, self.path)
        if self.path is LinkPath.WIFI and self._watch.is_doubtful(self._clock.now_s()):
            self._send_lane(Kind.DATA, LinkPath.RADIO)

    def _send_lane(self, kind: Kind, path: LinkPath) -> None:
        if not self._is_open(path):
            return
        for kept in self._out[kind].unsent(path):
            if kind is Kind.DATA and path is LinkPath.RADIO and not self._radio.has_room:
                return
            if not self._send_kept(kind, kept, path):
                return
            kept.sent_on.add(path)

    def _send_kept(self, kind: Kind, kept: Kept, path: LinkPath) -> bool:
        frame = self._frame(kind, kept.seq, kept.on(path))
        lane = {Kind.DATA: Lane.BULK, Kind.COMMAND: Lane.COMMAND, Kind.NOW: Lane.NOW}[kind]
        return self._send_on(path, frame, lane)

    def _send_newest(self) -> None:
        for slot in list(self._newest):
            datagram, for_radio = self._newest.pop(slot)
            self._newest_number = (self._newest_number + 1) & 0xFF
            frame = self._frame(Kind.NEWEST, self._newest_number, bytes((slot,)) + datagram)
            self._send_on(LinkPath.WIFI, frame, Lane.NEWEST)
            if for_radio is not None:
                frame = self._frame(Kind.NEWEST, self._newest_number, bytes((slot,)) + for_radio())
            if self.path is LinkPath.RADIO or len(frame) <= MOST_SHORT_BYTES:
                self._send_on(LinkPath.RADIO, frame, Lane.NEWEST, slot)

    def _send_on(self, path: LinkPath, frame: bytes, lane: Lane, slot: int = 0) -> bool:
        try:
            if path is LinkPath.RADIO:
                return self._radio.send(frame, lane, slot)
            return self._wifi is not None and self._wifi.send(frame)
        except LinkError:
            if path is LinkPath.WIFI:
                self._drop_wifi()
            return False

    def _frame(self, kind: Kind, number: int, body: bytes) -> bytes:
        return bytes((kind << _EPOCH_TAG_BITS | self._epoch_tag(), number & 0xFF)) + body

    def _epoch_tag(self) -> int:
        return (self._epoch[0] ^ self._peer_epoch[0]) & (1 << _EPOCH_TAG_BITS) - 1

    def _greet(self, now_s: float) -> None:
        if self._wifi is not None and self._watch.due(now_s):
            if LinkPath.WIFI not in self._knows_us:
                self._send_on(LinkPath.WIFI, self._hello(LinkPath.WIFI), Lane.BULK)
            number = self._watch.probe(now_s)
            probe = self._frame(Kind.PROBE, number, bytes((self._watch.last_heard,)))
            self._send_on(LinkPath.WIFI, probe, Lane.BULK)
        if LinkPath.RADIO not in self._knows_us and now_s >= self._radio_hello_s + self._config.radio_hello_s:
            self._radio_hello_s = now_s
            self._send_on(LinkPath.RADIO, self._hello(LinkPath.RADIO), Lane.NEWEST, _HELLO_SLOT)

    def _hello(self, path: LinkPath) -> bytes:
        """Its number is 1 where it asks for one in return."""
        asks = path not in self._knows_us
        return bytes((Kind.HELLO << _EPOCH_TAG_BITS, asks)) + self._epoch + self._peer_epoch

    def _acknowledge(self, now_s: float) -> None:
        if not self._ack_due:
            return
        expected = bytes(self._in[kind].expected & 0xFF for kind in self._in)
        ack = self._frame(Kind.ACK, 0, expected)
        if self._send_on(LinkPath.WIFI, ack, Lane.NEWEST):
            self._ack_due.discard(LinkPath.WIFI)
        if LinkPath.RADIO in self._ack_due and now_s >= self._radio_ack_s + self._config.radio_ack_s:
            self._radio_ack_s = now_s
            if self._send_on(LinkPath.RADIO, ack, Lane.NEWEST, _ACK_SLOT):
                self._ack_due.discard(LinkPath.RADIO)

    # ---- in

    def _read_all(self, now_s: float) -> None:
        if self._wifi is not None:
            try:
                self._read(LinkPath.WIFI, self._wifi, now_s)
            except LinkError as error:
                _log.debug("Wi-Fi: %s", error)
                self._drop_wifi()
        try:
            self._read(LinkPath.RADIO, self._radio, now_s)
        except LinkError as error:
            _log.info("LoRa: %s", error)

    def _read(self, path: LinkPath, link: Link | Radio, now_s: float) -> None:
        for _ in range(_DATAGRAMS_PER_STEP):
            if len(self._delivered) >= _MOST_DELIVERED:
                return
            frame = link.receive(0.0)
            if frame is None:
                return
            self._take(path, frame, now_s)

    def _take(self, path: LinkPath, frame: bytes, now_s: float) -> None:
        kind = frame[0] >> _EPOCH_TAG_BITS
        if len(frame) <= _HEAD_BYTES or kind > Kind.NEWEST:
            self.statistics.dropped_bytes += len(frame)
            return
        number, body = frame[1], frame[_HEAD_BYTES:]
        if kind == Kind.HELLO:
            self._take_hello(path, body, asks=number == 1)
        elif path not in self._knows_us or frame[0] & (1 << _EPOCH_TAG_BITS) - 1 != self._epoch_tag():
            self.statistics.dropped_bytes += len(frame)
        elif kind == Kind.PROBE:
            self._watch.hear(number, body[0], now_s)
        elif kind == Kind.ACK:
            for lane, expected in zip(self._out.values(), body, strict=False):
                lane.acknowledge(expected)
        else:
            self._take_datagram(Kind(kind), path, number, body)

    def _take_datagram(self, kind: Kind, path: LinkPath, number: int, body: bytes) -> None:
        if kind is Kind.NEWEST:
            if self._newer.take(body[0], number) and len(body) > 1:
                self._delivered.append(body[1:])
            return
        lane = self._in[kind]
        before = lane.duplicates
        self._delivered.extend(lane.take(number, body))
        self.statistics.duplicates += lane.duplicates - before
        self._ack_due.add(path)

    def _take_hello(self, path: LinkPath, body: bytes, asks: bool) -> None:
        if len(body) != 2 * _EPOCH_BYTES:
            self.statistics.dropped_bytes += len(body)
            return
        theirs, ours = body[:_EPOCH_BYTES], body[_EPOCH_BYTES:]
        if theirs != self._peer_epoch:
            if any(self._peer_epoch):
                _log.info("the other side has begun anew")
                self.statistics.peer_restarts += 1
            self._peer_epoch = theirs
            self._forget()
        elif self._knows_us and ours != self._epoch and ours not in self._past_epochs:
            _log.warning("the other side has spoken with somebody else; beginning anew")
            self._past_epochs.append(self._epoch)
            self._epoch = self._random_bytes(_EPOCH_BYTES)
            self._forget()
        if ours == self._epoch:
            self._knows_us.add(path)
        if asks:
            self._send_on(path, self._hello(path), Lane.NEWEST, _HELLO_SLOT)

    def _forget(self) -> None:
        """What was on its way is meant for nobody any more."""
        self._knows_us.clear()
        self.resets += 1
        self._reset_lanes()

    def _fail_if_lost(self) -> None:
        if self._was_connected and not self.connected:
            self._was_connected = False
            raise LinkError("neither Wi-Fi nor LoRa reaches the other side any more")

    def _fail_if_closed(self) -> None:
        if self._stop.is_set():
            raise LinkError("the link is closed")
        if self._misfit is not None:
            raise self._misfit
