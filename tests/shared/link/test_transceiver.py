"""The station's transceiver on a wire of the test's own: no Mega, no operating system's port."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from shared.link import transceiver as module
from shared.link.base import LinkError
from shared.link.byte_port import PortStatistics
from shared.link.transceiver import Transceiver
from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.runtime.clock import MonotonicClock

PATIENCE_S = 10.0


class EchoMega:
    """A wire to a firmware that gives each radio's bytes back to it; `window` is the room it offers."""

    def __init__(self, fingerprint: int = t.FINGERPRINT, window: int = 96) -> None:
        self.name = "a wire"
        self.statistics = PortStatistics()
        self.is_gone = False
        self.window = window
        self._fingerprint = fingerprint
        self._changed = threading.Condition()
        self._output = bytearray(encode(t.Announce(fingerprint, 1, 0, 0, 0)))
        self._reader = FrameReader()
        self._offset = [0] * t.RADIOS

    def write(self, data: bytes) -> None:
        self._fail_if_gone()
        with self._changed:
            for frame in self._reader.feed(data):
                for answer in self._answers(frame):
                    self._output += encode(answer)
            self._changed.notify_all()

    def read(self, timeout_s: float) -> bytes:
        with self._changed:
            self._changed.wait_for(lambda: self._output or self.is_gone, timeout_s)
            self._fail_if_gone()
            data = bytes(self._output)
            self._output.clear()
            return data

    def say(self, frame: t.Frame) -> None:
        with self._changed:
            self._output += encode(frame)
            self._changed.notify_all()

    def unplug(self) -> None:
        with self._changed:
            self.is_gone = True
            self._changed.notify_all()

    def set_baud_rate(self, baud_rate: int) -> bool:
        return baud_rate == t.USB_BAUD

    def close(self) -> None:
        self.is_gone = True

    def _fail_if_gone(self) -> None:
        if self.is_gone:
            raise LinkError("a wire: lost")

    def _answers(self, frame: t.Frame) -> list[t.Frame]:
        match frame:
            case t.Hello() if frame.fingerprint != self._fingerprint:
                return [t.Refuse(self._fingerprint)]
            case t.Hello():
                self._offset = [0] * t.RADIOS
                return [t.Welcome(frame.session, 1, 0, 0, 0), *(self._room(radio) for radio in range(t.RADIOS))]
            case t.SetBaud() | t.ResetRadio():
                return [t.Done(frame.tag, t.Result.DONE)]
            case t.Data() if frame.offset == self._offset[frame.radio]:
                self._offset[frame.radio] += len(frame.data)
                return [frame, self._room(frame.radio)]
            case t.Ping():
                return [self._room(radio) for radio in range(t.RADIOS)]
            case _:
                return []

    def _room(self, radio: int) -> t.Acknowledge:
        return t.Acknowledge(radio, self._offset[radio], self._offset[radio] + self.window)


class Socket:
    """Where a Mega is plugged in, and another after it."""

    def __init__(self) -> None:
        self.mega: EchoMega | None = EchoMega()

    def open(self) -> EchoMega:
        if self.mega is None:
            raise LinkError("a wire: there is no such port")
        return self.mega


@pytest.fixture
def socket() -> Socket:
    return Socket()


@pytest.fixture
def transceiver(socket: Socket, monkeypatch: pytest.MonkeyPatch) -> Iterator[Transceiver]:
    monkeypatch.setattr(module, "_REOPEN_S", 0.01)
    transceiver = Transceiver("the test", MonotonicClock(), PATIENCE_S, socket.open)
    yield transceiver
    transceiver.close()


def test_each_radio_has_its_own_bytes(transceiver: Transceiver) -> None:
    first, second = transceiver.radios
    first.write(b"to the first")
    second.write(b"and the second")
    assert first.read(PATIENCE_S) == b"to the first"
    assert second.read(PATIENCE_S) == b"and the second"
    assert first.read(0.0) == b""
    assert (second.statistics.written_bytes, second.statistics.read_bytes) == (14, 14)


def test_another_mega_in_the_socket_is_found_by_itself(transceiver: Transceiver, socket: Socket) -> None:
    port, other = transceiver.radios
    assert socket.mega is not None
    old, socket.mega = socket.mega, None
    old.unplug()
    with pytest.raises(LinkError, match="lost"):
        port.read(PATIENCE_S)
    with pytest.raises(LinkError, match="lost"):
        port.set_baud_rate(9_600)
    socket.mega = EchoMega()
    assert transceiver.wait_until_up(PATIENCE_S)
    port.write(b"hello")
    assert port.read(PATIENCE_S) == b"hello"
    with pytest.raises(LinkError, match="lost"):
        other.write(b"of before the loss")
    other.write(b"after it")
    assert other.read(PATIENCE_S) == b"after it"


def test_a_radio_that_takes_nothing_does_not_hold_its_writer_for_ever(
    transceiver: Transceiver, socket: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_WRITE_TIMEOUT_S", 0.05)
    assert socket.mega is not None
    socket.mega.window = 0
    with pytest.raises(LinkError, match="takes no bytes"):
        transceiver.radios[0].write(bytes(100_000))


def test_a_rate_the_firmware_has_not_is_refused_at_once(transceiver: Transceiver) -> None:
    assert transceiver.radios[0].set_baud_rate(9_600)
    assert not transceiver.radios[0].set_baud_rate(230_400)


def test_a_firmware_of_another_version_is_named_at_once(socket: Socket) -> None:
    socket.mega = EchoMega(fingerprint=t.FINGERPRINT ^ 1)
    with pytest.raises(LinkError, match="make flash-transceiver"):
        Transceiver("the test", MonotonicClock(), PATIENCE_S, socket.open)


def test_no_port_is_an_error_at_once() -> None:
    empty = Socket()
    empty.mega = None
    with pytest.raises(LinkError, match="no such port"):
        Transceiver("the test", MonotonicClock(), PATIENCE_S, empty.open)


def test_a_fault_that_goes_on_is_logged_once(
    transceiver: Transceiver, socket: Socket, caplog: pytest.LogCaptureFixture
) -> None:
    assert socket.mega is not None
    for total in range(1, 20):
        socket.mega.say(t.FaultReport(t.Fault.FRAMING, t.Port.RADIO_B, total))
    socket.mega.say(t.FaultReport(99, 99, 1))
    transceiver.radios[0].write(b"echo")
    assert transceiver.radios[0].read(PATIENCE_S) == b"echo"
    assert [r.getMessage() for r in caplog.records if r.levelname == "WARNING"] == [
        "the test: bytes without a stop bit at RADIO_B: 1 so far"
    ]


def test_closing_wakes_who_reads(transceiver: Transceiver) -> None:
    failures: list[str] = []

    def read() -> None:
        try:
            transceiver.radios[0].read(PATIENCE_S)
        except LinkError as error:
            failures.append(str(error))

    reader = threading.Thread(target=read)
    reader.start()
    transceiver.close()
    reader.join(PATIENCE_S)
    assert failures == ["the test: the transceiver is closed"]
