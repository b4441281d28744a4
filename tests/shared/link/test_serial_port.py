"""The serial port, on pseudo-terminals: what the operating system does to it."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from shared.link.base import LinkError
from shared.link.pairing import Pairing
from shared.link.radio_config import RadioConfig
from shared.link.radios import open_pair
from shared.link.serial_port import SerialPort
from shared.runtime.clock import MonotonicClock


class Wire:
    """The other end."""

    def __init__(self) -> None:
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._open = True

    def unplug(self) -> None:
        if self._open:
            self._open = False
            os.close(self.master)
            os.close(self._slave)

    def read(self, size: int) -> bytes:
        data = b""
        while len(data) < size and select.select([self.master], [], [], 5.0)[0]:
            data += os.read(self.master, size - len(data))
        return data


@pytest.fixture
def wire() -> Iterator[Wire]:
    made = Wire()
    yield made
    made.unplug()


@pytest.fixture
def port(wire: Wire) -> Iterator[SerialPort]:
    made = SerialPort(wire.path, 115_200)
    yield made
    made.close()


def test_all_bytes_go_through_unchanged(port: SerialPort, wire: Wire) -> None:
    every = bytes(range(256))
    port.write(every)
    assert wire.read(256) == every
    os.write(wire.master, every)
    heard = b""
    while len(heard) < 256:
        heard += port.read(5.0)
    assert heard == every
    assert (port.statistics.written_bytes, port.statistics.read_bytes) == (256, 256)


def test_what_is_there_is_given_at_once(port: SerialPort, wire: Wire) -> None:
    os.write(wire.master, b"a")
    assert port.read(60.0) == b"a"
    assert port.read(0.0) == b""
    assert port.read(-1.0) == b""


@pytest.mark.parametrize("baud_rate", [9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 500_000])
def test_rates_can_be_changed(port: SerialPort, baud_rate: int) -> None:
    assert port.set_baud_rate(baud_rate)


def test_a_port_has_one_user(port: SerialPort) -> None:
    with pytest.raises(LinkError, match=f"{port.name}: in use by another program"):
        SerialPort(port.name, 115_200)


def test_what_cannot_be_opened_is_named_with_the_remedy(tmp_path: object) -> None:
    with pytest.raises(LinkError, match=r"/dev/ttyNOPE: there is no such port. `radio-config list`"):
        SerialPort("/dev/ttyNOPE", 9_600)
    with pytest.raises(LinkError, match=f"{tmp_path}: cannot be opened"):
        SerialPort(str(tmp_path), 9_600)
    with pytest.raises(LinkError, match="/dev/null: cannot be opened"):
        SerialPort("/dev/null", 9_600)


def test_a_pulled_plug_is_an_error_for_reader_and_writer(port: SerialPort, wire: Wire) -> None:
    wire.unplug()
    with pytest.raises(LinkError, match=r"lost: .*Is the cable still plugged in\?"):
        port.read(1.0)
    with pytest.raises(LinkError, match="lost: "):
        port.write(b"x")
    with pytest.raises(LinkError, match="lost: "):
        port.set_baud_rate(9_600)


def test_a_plug_that_is_pulled_while_somebody_waits_ends_the_wait(port: SerialPort, wire: Wire) -> None:
    caught: list[LinkError] = []

    def wait() -> None:
        try:
            port.read(30.0)
        except LinkError as error:
            caught.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    wire.unplug()
    thread.join(10.0)
    assert len(caught) == 1


def test_a_port_that_takes_nothing_is_an_error(port: SerialPort) -> None:
    with pytest.raises(LinkError, match="takes no bytes"):
        port.write(bytes(200_000))


def test_a_closed_port_says_so(port: SerialPort) -> None:
    port.close()
    port.close()
    for action in (lambda: port.read(0.0), lambda: port.write(b"x"), lambda: port.set_baud_rate(9_600)):
        with pytest.raises(LinkError, match="the port is closed"):
            action()


def test_a_link_that_is_closed_lets_go_of_a_port_that_takes_no_bytes(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stuck(port: SerialPort, data: bytes) -> None:
        raise LinkError(f"{port.name}: takes no bytes")

    monkeypatch.setattr(SerialPort, "write", stuck)
    clock = MonotonicClock()
    pair = open_pair(RadioConfig((wire.path,)), Pairing(Path(), "", bytes(32)), clock, is_robot=False, has_wifi=False)
    until_s = clock.now_s() + 20.0
    while not pair.health.radios[0].fault and clock.now_s() < until_s:
        pair.receive(0.01)
    assert "takes no bytes" in pair.health.radios[0].fault
    pair.close()
    SerialPort(wire.path, 115_200).close()


def test_a_stuck_adapter_does_not_hold_up_a_change_of_the_rate(
    port: SerialPort, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial.Serial, "out_waiting", property(lambda _: 5))
    monkeypatch.setattr("shared.link.serial_port._WRITE_TIMEOUT_S", 0.02)
    with pytest.raises(LinkError, match="stuck"):
        port.set_baud_rate(9_600)
