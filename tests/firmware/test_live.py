"""The station's `Transceiver` on an emulated Mega that runs by the wall's time, on pseudo-terminals."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shared.link.base import LinkError
from shared.link.transceiver import RadioPort, Transceiver
from shared.protocol.transceiver import ResetCause
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.mega import LiveMega, MegaEvent
from tools.simulator.devices.mega_build import MegaFiles

PATIENCE_S = 20.0  # the machine may be busy


class RadioEnd:
    """The far end of a radio's wire."""

    def __init__(self, name: str) -> None:
        self._fd = os.open(name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def write(self, data: bytes) -> None:
        while data:
            assert select.select([], [self._fd], [], PATIENCE_S)[1]
            data = data[os.write(self._fd, data) :]

    def read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            assert select.select([self._fd], [], [], PATIENCE_S)[0], f"{len(data)} of {count} bytes came"
            data += os.read(self._fd, 4_096)
        return data

    def close(self) -> None:
        os.close(self._fd)


def read(port: RadioPort, count: int) -> bytes:
    data = b""
    while len(data) < count:
        some = port.read(PATIENCE_S)
        assert some, f"{len(data)} of {count} bytes came"
        data += some
    return data


def lose(port: RadioPort) -> None:
    """Read until the loss is reported."""
    with pytest.raises(LinkError):
        while port.read(PATIENCE_S):
            pass


@pytest.fixture
def mega(mega_files: MegaFiles) -> Iterator[LiveMega]:
    with LiveMega(mega_files) as mega:
        yield mega


@pytest.fixture
def ends(mega: LiveMega) -> Iterator[tuple[RadioEnd, RadioEnd]]:
    ends = RadioEnd(mega.radio_a), RadioEnd(mega.radio_b)
    yield ends
    for end in ends:
        end.close()


@pytest.fixture
def transceiver(mega: LiveMega, ends: object) -> Iterator[Transceiver]:
    transceiver = Transceiver(mega.usb, MonotonicClock(), PATIENCE_S)
    yield transceiver
    transceiver.close()


def test_bytes_go_both_ways_at_full_rate_on_both_radios(
    transceiver: Transceiver, ends: tuple[RadioEnd, RadioEnd], rng: np.random.Generator
) -> None:
    down, up = [rng.bytes(10_000) for _ in range(2)], [rng.bytes(10_000) for _ in range(2)]
    arrived: list[bytes] = [b"", b""]

    def far_end(radio: int) -> None:
        ends[radio].write(up[radio])
        arrived[radio] = ends[radio].read(10_000)

    def near_end(radio: int) -> None:
        transceiver.radios[radio].write(down[radio])

    threads = [threading.Thread(target=task, args=(radio,)) for task in (far_end, near_end) for radio in range(2)]
    for thread in threads:
        thread.start()
    heard = [read(port, 10_000) for port in transceiver.radios]
    for thread in threads:
        thread.join(PATIENCE_S)

    assert heard == up
    assert arrived == down
    assert [(p.statistics.written_bytes, p.statistics.read_bytes) for p in transceiver.radios] == [(10_000, 10_000)] * 2


def test_pulling_the_usb_plug_is_reported_once_and_recovered_from(
    transceiver: Transceiver, mega: LiveMega, ends: tuple[RadioEnd, RadioEnd]
) -> None:
    port, other = transceiver.radios
    mega.unplug()
    lose(port)
    with pytest.raises(LinkError):
        port.write(b"into the void")
    mega.plug()
    assert transceiver.wait_until_up(PATIENCE_S)
    port.write(b"hello again")
    assert ends[0].read(11) == b"hello again"
    with pytest.raises(LinkError, match="lost"):  # this one has not been told yet
        other.read(0.0)
    ends[1].write(b"and back")
    assert read(other, 8) == b"and back"
    assert transceiver.health.losses == 1


def test_a_reset_of_the_mega_is_recovered_from(
    transceiver: Transceiver, mega: LiveMega, ends: tuple[RadioEnd, RadioEnd]
) -> None:
    mega.reset()
    lose(transceiver.radios[1])
    assert transceiver.wait_until_up(PATIENCE_S)
    transceiver.radios[1].write(b"still here")
    assert ends[1].read(10) == b"still here"
    assert transceiver.health.reset_cause is ResetCause.RESET_PIN


def test_a_hung_firmware_is_recovered_from(transceiver: Transceiver, mega: LiveMega) -> None:
    mega.hang()
    lose(transceiver.radios[0])
    assert transceiver.wait_until_up(PATIENCE_S)
    assert transceiver.health.reset_cause is ResetCause.HUNG


def test_rate_and_reset_pin_reach_the_radio(mega_files: MegaFiles) -> None:
    events: list[MegaEvent] = []
    with LiveMega(mega_files, on_event=events.append) as mega:
        transceiver = Transceiver(mega.usb, MonotonicClock(), PATIENCE_S)
        port = transceiver.radios[1]
        assert port.set_baud_rate(38_400)
        assert not port.set_baud_rate(230_400)
        port.reset()
        transceiver.close()
    told = [event for event in events if event.kind != "reset"]
    assert told[-3:] == [MegaEvent("baud", (2, 38_461)), MegaEvent("resetb", (1, 0)), MegaEvent("resetb", (1, 1))]


def test_a_closed_transceiver_says_so_and_may_be_closed_twice(transceiver: Transceiver) -> None:
    port = transceiver.radios[0]
    transceiver.close()
    transceiver.close()
    with pytest.raises(LinkError, match="closed"):
        port.read(1.0)
    port.close()
    port.close()
    with pytest.raises(LinkError, match="closed"):
        port.write(b"x")


def test_a_port_where_nothing_speaks_is_no_transceiver(tmp_path: Path) -> None:
    master, slave = os.openpty()
    try:
        with pytest.raises(LinkError, match="no transceiver"):
            Transceiver(os.ttyname(slave), MonotonicClock(), 0.1)
    finally:
        os.close(master)
        os.close(slave)
    with pytest.raises(LinkError, match="no such port"):
        Transceiver(str(tmp_path / "ttyACM9"), MonotonicClock(), 0.1)


def test_the_emulation_ends_with_whoever_started_it(mega_files: MegaFiles) -> None:
    mega = LiveMega(mega_files)
    process = mega._program._process
    mega.close()
    mega.close()
    assert process.returncode == 0
