"""Carries packets between the turns and one radio, which may come and go."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from threading import Condition

from shared.link.base import LinkError
from shared.link.es920lr.core import Lost, Ready, SendFailed, Sent
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import Heard
from shared.link.radio_pair.conversation import Packet
from shared.link.radio_pair.turns import Turns
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_REOPEN_S = 0.5
_SMOOTHING = 0.2  # of the power of a new packet

OpenRadio = Callable[[], Es920lr]


class Pump:
    """One radio. `step` is called from one thread; what it shares with others is touched under `changed`."""

    def __init__(
        self,
        radio: int,
        open_radio: OpenRadio,
        turns: Turns,
        clock: Clock,
        changed: Condition,
        heard_good: Callable[[], None],
    ) -> None:
        """`open_radio` is called by `step`, and again when the radio's port is lost or could not be opened."""
        self.rssi_dbm = math.nan  # smoothed, of the other side's packets
        self.heard = 0
        self._radio = radio
        self._open = open_radio
        self._turns = turns
        self._clock = clock
        self._changed = changed
        self._heard_good = heard_good
        self._driver: Es920lr | None = None
        self._reopen_s = -math.inf
        self._fault = ""
        self._on_the_way: dict[int, Packet] = {}  # at most two, as the driver takes no more
        self._held: Packet | None = None  # the band does not allow it yet

    @property
    def driver(self) -> Es920lr | None:
        """None while its port is lost."""
        return self._driver

    @property
    def fault(self) -> str:
        """Why its port is not open; empty when it is."""
        return self._fault

    @property
    def operating(self) -> bool:
        return self._driver is not None and self._driver.operating

    def step(self, timeout_s: float) -> None:
        """Do what is due, and wait no longer than that for news."""
        driver = self._driver or self._reopened()
        if driver is None:
            return
        try:
            self._submit(driver)
            with self._changed:
                wait_s = self._turns.due_s(self._radio, self._clock.now_s()) - self._clock.now_s()
            events = driver.poll(min(timeout_s, max(wait_s, 0.0)) if driver.can_submit else timeout_s)
        except LinkError as error:
            self._lose(error)
            return
        for event in events:
            self._handle(event)

    def close(self) -> None:
        self._reopen_s = math.inf
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    def _submit(self, driver: Es920lr) -> None:
        while driver.can_submit:
            packet, self._held = self._held, None
            if packet is None:
                with self._changed:
                    packet = self._turns.next_packet(self._radio, self._clock.now_s())
            if packet is None:
                return
            handle = driver.submit(packet.data)
            if handle is None:
                self._held = packet
                return
            self._on_the_way[handle] = packet

    def _handle(self, event: object) -> None:
        now_s = self._clock.now_s()
        with self._changed:
            match event:
                case Heard():
                    self._hear(event, now_s)
                case Sent():
                    if (packet := self._on_the_way.pop(event.handle, None)) is not None:
                        self._turns.sent(self._radio, packet, now_s)
                case SendFailed():
                    if (packet := self._on_the_way.pop(event.handle, None)) is not None:
                        self._turns.failed(self._radio, packet, now_s)
                case Ready():
                    self._turns.set_up(self._radio, True, now_s)
                case Lost():
                    self._give_up(now_s)

    def _hear(self, heard: Heard, now_s: float) -> None:
        if not self._turns.heard(self._radio, heard.payload, now_s):
            return
        self.heard += 1
        before = heard.rssi_dbm if math.isnan(self.rssi_dbm) else self.rssi_dbm
        self.rssi_dbm = before + _SMOOTHING * (heard.rssi_dbm - before)
        self._heard_good()
        self._changed.notify_all()

    def _give_up(self, now_s: float) -> None:
        packets = [*self._on_the_way.values(), *([self._held] if self._held else [])]
        self._on_the_way.clear()
        self._held = None
        for packet in packets:
            self._turns.failed(self._radio, packet, now_s)
        self._turns.set_up(self._radio, False, now_s)

    def _lose(self, error: LinkError) -> None:
        if str(error) != self._fault:
            self._fault = str(error)
            _log.warning("radio %d: %s", self._radio, error)
        self._driver = None
        self._reopen_s = self._clock.now_s() + _REOPEN_S
        with self._changed:
            self._give_up(self._clock.now_s())

    def _reopened(self) -> Es920lr | None:
        now_s = self._clock.now_s()
        if now_s < self._reopen_s:
            return None
        self._reopen_s = now_s + _REOPEN_S
        try:
            self._driver = self._open()
        except LinkError as error:
            self._lose(error)
            return None
        if self._fault:
            _log.info("radio %d: its port is there again", self._radio)
        self._fault = ""
        if self._driver.operating:
            with self._changed:
                self._turns.set_up(self._radio, True, now_s)
        return self._driver
