"""TCP between those who have the same pairing file, and strangers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shared.link.base import LinkError
from shared.link.pairing import Pairing, PairingError, read_pairing, write_new_pairing
from shared.link.tcp import TcpClientLink, TcpServerLink
from shared.link.tls import TlsStream
from shared.protocol.frame import pack
from shared.runtime.clock import ManualClock


@pytest.fixture(scope="module")
def pairing(tmp_path_factory: pytest.TempPathFactory) -> Pairing:
    path = tmp_path_factory.mktemp("ours") / "pairing.pem"
    write_new_pairing(path)
    return read_pairing(path)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Pairing:
    path = tmp_path_factory.mktemp("theirs") / "pairing.pem"
    write_new_pairing(path)
    return read_pairing(path)


class Served:
    """The robot's end, with somebody who calls `receive` on it."""

    def __init__(self, pairing: Pairing) -> None:
        self.clock = ManualClock()
        self.link = TcpServerLink("127.0.0.1", 0, self.clock, b"busy", pairing)
        self.came: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            if (datagram := self.link.receive(0.02)) is not None:
                self.came.append(datagram)
                self.link.send(b"got " + datagram)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self.link.close()


@pytest.fixture
def robot(pairing: Pairing) -> Iterator[Served]:
    served = Served(pairing)
    yield served
    served.close()


def answer(link: TcpClientLink) -> bytes | None:
    return next((d for _ in range(50) if (d := link.receive(0.1)) is not None), None)


def test_those_with_the_same_file_talk(robot: Served, pairing: Pairing) -> None:
    station = TcpClientLink("127.0.0.1", robot.link.port, 5.0, pairing)
    for datagram in (b"hello", bytes(range(256)) * 50):
        assert station.send(datagram)
        assert answer(station) == b"got " + datagram
    station.close()


def test_one_with_another_file_is_turned_away_on_both_sides(robot: Served, other: Pairing) -> None:
    with pytest.raises(LinkError, match="same pairing file"):
        TcpClientLink("127.0.0.1", robot.link.port, 5.0, other)
    assert robot.came == []
    assert not robot.link.connected


def test_who_knocks_again_and_again_is_told_once(
    robot: Served, pairing: Pairing, other: Pairing, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(3):
        with pytest.raises(LinkError):
            TcpClientLink("127.0.0.1", robot.link.port, 5.0, other)
    TcpClientLink("127.0.0.1", robot.link.port, 5.0, pairing).close()
    assert [r.levelname for r in caplog.records if "turned away" in r.getMessage()] == ["WARNING"]


def test_a_station_without_a_file_is_not_heard(robot: Served) -> None:
    station = TcpClientLink("127.0.0.1", robot.link.port, 5.0)
    with pytest.raises(LinkError):
        for _ in range(50):
            station.send(b"drive")
            station.receive(0.1)
    station.close()
    assert robot.came == []


def test_strangers_who_say_nothing_do_not_keep_the_station_out(robot: Served, pairing: Pairing) -> None:
    strangers = [socket.create_connection(("127.0.0.1", robot.link.port), 2.0) for _ in range(3)]
    station = TcpClientLink("127.0.0.1", robot.link.port, 5.0, pairing)
    assert station.send(b"hello")
    assert answer(station) == b"got hello"
    for stranger in strangers:
        stranger.close()
    station.close()


def test_where_only_the_station_has_a_file_pairing_is_named(pairing: Pairing) -> None:
    station = TlsStream(pairing.tls_context(False), False, "robot")
    with pytest.raises(PairingError, match="pairing: the other side speaks without a pairing file"):
        station.feed(pack(b"hello from a robot without a pairing file"))


def test_where_only_the_robot_has_a_file_pairing_is_named(robot: Served) -> None:
    station = TcpClientLink("127.0.0.1", robot.link.port, 5.0)
    station.send(b"hello")
    with pytest.raises(PairingError, match="Pairing: has it a pairing file"):
        answer(station)
    station.close()


def test_noise_is_turned_away(pairing: Pairing) -> None:
    rng = np.random.default_rng(3)
    context = pairing.tls_context(True)
    refused = 0
    for _ in range(300):
        stream = TlsStream(context, True, "x")
        try:
            for _ in range(5):
                assert stream.feed(rng.bytes(int(rng.integers(1, 200)))) == b""
        except LinkError:
            refused += 1
        assert not stream.ready
    assert refused > 250


def test_a_changed_byte_ends_the_connection(pairing: Pairing) -> None:
    robot, station = TlsStream(pairing.tls_context(True), True, "r"), TlsStream(pairing.tls_context(False), False, "s")
    while not (robot.ready and station.ready):
        robot.feed(station.take_output())
        station.feed(robot.take_output())
    station.encrypt(pack(b"drive on"))
    sealed = bytearray(station.take_output())
    assert b"drive" not in sealed
    sealed[-3] ^= 1
    with pytest.raises(LinkError):
        robot.feed(bytes(sealed))


def test_what_is_said_in_secret_costs_22_bytes_a_datagram(pairing: Pairing) -> None:
    robot, station = TlsStream(pairing.tls_context(True), True, "r"), TlsStream(pairing.tls_context(False), False, "s")
    while not (robot.ready and station.ready):
        robot.feed(station.take_output())
        station.feed(robot.take_output())
    station.encrypt(bytes(932))
    assert len(station.take_output()) == 932 + 22


def test_a_file_that_others_may_read_is_refused(pairing: Pairing, tmp_path: Path) -> None:
    path = tmp_path / "pairing.pem"
    path.write_bytes(pairing.path.read_bytes())
    path.chmod(0o644)
    with pytest.raises(LinkError, match="chmod 600"):
        read_pairing(path)


@pytest.mark.parametrize("content", [b"", b"\xff" * 100, b"-----BEGIN CERTIFICATE-----\nx\n-----END CERTIFICATE-----"])
def test_a_file_that_is_no_pairing_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "pairing.pem"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(LinkError, match="no pairing file"):
        read_pairing(path)


def test_a_file_that_is_missing_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="radio-config key new"):
        read_pairing(tmp_path / "pairing.pem")


def test_the_same_file_gives_the_same_radio_key_and_says_nothing_of_it(pairing: Pairing, other: Pairing) -> None:
    assert read_pairing(pairing.path).radio_key == pairing.radio_key != other.radio_key
    assert pairing.fingerprint != other.fingerprint
    assert pairing.radio_key.hex() not in repr(pairing)


@pytest.mark.parametrize("damage", ["key", "certificate", "other key"])
def test_a_pairing_file_that_is_damaged_is_refused_also_for_lora(
    pairing: Pairing, other: Pairing, tmp_path: Path, damage: str
) -> None:
    text = pairing.path.read_text("ascii")
    key = "-----BEGIN PRIVATE KEY-----" + text.split("-----BEGIN PRIVATE KEY-----")[1].split("-----END")[0]
    others = other.path.read_text("ascii").replace(other.certificate, pairing.certificate)
    path = tmp_path / "pairing.pem"
    path.touch(0o600)
    path.write_text(
        {
            "key": text.replace(key, "-----BEGIN PRIVATE KEY-----\n"),
            "certificate": text.replace(pairing.certificate, pairing.certificate.replace("MI", "M", 1)),
            "other key": others,
        }[damage],
        "ascii",
    )
    with pytest.raises(LinkError, match=r"pairing\.pem: is damaged .*; make a new one"):
        read_pairing(path)
