"""Opens the radios that a configuration names: at serial ports or behind a transceiver."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from shared.link.byte_port import BytePort
from shared.link.es920lr.driver import Es920lr
from shared.link.pairing import Pairing
from shared.link.radio_config import RadioConfig, alone, beside_wifi
from shared.link.radio_pair.link import RadioPair, robot_radios, station_radios
from shared.link.radio_pair.pump import OpenRadio
from shared.link.serial_port import SerialPort
from shared.link.transceiver import Transceiver
from shared.runtime.clock import Clock

_RADIO_OF = {"A": 0, "B": 1}
_CLOSE_S = 0.2


def open_pair(config: RadioConfig, pairing: Pairing, clock: Clock, *, is_robot: bool, has_wifi: bool) -> RadioPair:
    """One side's radios as a link, each in a thread of its own. A port that cannot be opened is tried again and again
    while the other one carries all; `health` tells why.
    """
    ports = _Ports(config, clock)
    openers = [ports.opener(i, name) for i, name in enumerate(config.ports)]
    settings = config.settings(0)
    pair_config = (beside_wifi if has_wifi else alone)(settings)
    make = robot_radios if is_robot else station_radios
    return make(openers, settings, pairing.radio_key, clock, pair_config, when_closed=ports.close)


@contextmanager
def open_one(config: RadioConfig, radio: int, clock: Clock) -> Iterator[Es920lr]:
    """One module by itself, to look at it. Raises `LinkError`."""
    ports = _Ports(config, clock)
    try:
        driver = ports.opener(radio, config.ports[radio])()
        try:
            yield driver
        finally:
            driver.close()
    finally:
        ports.close()


class _Ports:
    """What is open: transceivers are shared by their two radios."""

    def __init__(self, config: RadioConfig, clock: Clock) -> None:
        self._config = config
        self._clock = clock
        self._transceivers: dict[str, Transceiver] = {}
        self._serial: dict[int, SerialPort] = {}  # of a radio; also one that was lost, until it is opened again
        self._is_closed = False
        self._lock = threading.Lock()

    def opener(self, radio: int, name: str) -> OpenRadio:
        path, colon, letter = name.rpartition(":")
        if colon and letter in _RADIO_OF:
            return lambda: self._behind_transceiver(radio, path, _RADIO_OF[letter])
        return lambda: self._at_serial_port(radio, name)

    def close(self) -> None:
        self._is_closed = True
        for port in list(self._serial.values()):
            port.close()
        if not self._lock.acquire(timeout=_CLOSE_S):
            return  # a transceiver is being opened, and closed as soon as it is
        try:
            for transceiver in self._transceivers.values():
                transceiver.close()
        finally:
            self._lock.release()

    def _at_serial_port(self, radio: int, name: str) -> Es920lr:
        if radio in self._serial:
            self._serial.pop(radio).close()
        port = self._serial[radio] = SerialPort(name, self._config.baud_rate)
        if self._is_closed:  # while it was being opened
            port.close()
        return self._driver(radio, port, None)

    def _behind_transceiver(self, radio: int, path: str, index: int) -> Es920lr:
        with self._lock:
            if path not in self._transceivers:
                transceiver = Transceiver(path, self._clock)
                if self._is_closed:  # while it was being opened
                    transceiver.close()
                self._transceivers[path] = transceiver
            port = self._transceivers[path].radios[index]
        return self._driver(radio, port, port.reset)

    def _driver(self, radio: int, port: BytePort, reset: Callable[[], None] | None) -> Es920lr:
        return Es920lr(port, self._config.settings(radio), self._clock, self._config.rule, reset)
