"""The contract of a link, run on every kind."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path as FilePath

import pytest

from shared.link.base import Lane, Link, LinkError, LinkHealth, LinkPath
from shared.link.failover.link import Failover
from shared.link.loopback import loopback_pair
from shared.link.pairing import read_pairing, write_new_pairing
from shared.link.radio_pair.link import RadioPair
from shared.link.tcp import TcpClientLink, TcpServerLink
from shared.runtime.clock import ManualClock
from tools.simulator.radio.failover_rig import FailoverRig
from tools.simulator.radio.pair_rig import PairRig

Ends = tuple[Link, Link]


class SteppedEnd:
    """One side of an emulated network, whose waits move the manual clock."""

    def __init__(self, rig: PairRig | FailoverRig, link: RadioPair | Failover) -> None:
        self._rig = rig
        self._link = link
        self.statistics, self.events, self.mends_itself = link.statistics, link.events, link.mends_itself
        self.send, self.close = link.send, link.close

    @property
    def connected(self) -> bool:
        return self._link.connected

    @property
    def has_room(self) -> bool:
        return self._link.has_room

    @property
    def path(self) -> LinkPath:
        return self._link.path

    @property
    def resets(self) -> int:
        return self._link.resets

    @property
    def health(self) -> LinkHealth:
        return self._link.health

    def receive(self, timeout_s: float) -> bytes | None:
        until_s = self._rig.clock.now_s() + timeout_s
        while (datagram := self._link.receive(0.0)) is None and self._rig.clock.now_s() < until_s:
            self._rig.run(min(0.05, until_s - self._rig.clock.now_s()))
        return datagram


def failover_ends() -> Ends:
    rig = FailoverRig(1)
    assert rig.run(20.0, lambda: rig.robot.path is rig.station.path is LinkPath.WIFI and rig.radios.robot.connected)
    return SteppedEnd(rig, rig.robot), SteppedEnd(rig, rig.station)


def secret_ends(folder: FilePath) -> Ends:
    write_new_pairing(folder / "pairing.pem")
    pairing = read_pairing(folder / "pairing.pem")
    robot = TcpServerLink("127.0.0.1", 0, ManualClock(), pairing=pairing)
    made: list[Link] = []
    station = threading.Thread(target=lambda: made.append(TcpClientLink("127.0.0.1", robot.port, 5.0, pairing)))
    station.start()
    while station.is_alive() or not robot.connected:
        robot.receive(0.02)
    station.join()
    return robot, made[0]


def radio_ends() -> Ends:
    rig = PairRig(1)
    rig.connect()
    return SteppedEnd(rig, rig.robot), SteppedEnd(rig, rig.station)


@pytest.fixture(params=["loopback", "tcp", "tls", "radio", "failover"])
def ends(request: pytest.FixtureRequest, tmp_path: FilePath) -> Iterator[Ends]:
    robot: Link
    station: Link
    if request.param == "loopback":
        robot, station = loopback_pair()
    elif request.param == "radio":
        robot, station = radio_ends()
    elif request.param == "failover":
        robot, station = failover_ends()
    elif request.param == "tls":
        robot, station = secret_ends(tmp_path)
    else:
        robot = TcpServerLink("127.0.0.1", 0, ManualClock())
        station = TcpClientLink("127.0.0.1", robot.port, 2.0)
        robot.receive(1.0)  # takes the connection
    yield robot, station
    robot.close()
    station.close()


def test_datagrams_arrive_whole_and_in_order(ends: Ends) -> None:
    robot, station = ends
    sent = [bytes([i]) * (i + 1) for i in range(50)]
    for datagram in sent:
        assert robot.send(datagram)
    assert [station.receive(1.0) for _ in sent] == sent


def test_both_directions_work_at_once(ends: Ends) -> None:
    robot, station = ends
    assert robot.send(b"there")
    assert station.send(b"back")
    assert station.receive(1.0) == b"there"
    assert robot.receive(1.0) == b"back"


def test_a_link_without_news_returns_nothing_after_its_time_out(ends: Ends) -> None:
    assert ends[1].receive(0.01) is None


def test_a_peer_that_does_not_read_makes_send_say_no(ends: Ends) -> None:
    robot, _ = ends
    assert any(not robot.send(bytes(60_000)) for _ in range(1000))


@pytest.mark.parametrize("lane", list(Lane))
def test_every_lane_delivers(ends: Ends, lane: Lane) -> None:
    robot, station = ends
    for end, other in ((robot, station), (station, robot)):
        assert end.send(b"word", lane, slot=3)
        assert other.receive(3.0) == b"word"


def test_over_a_radio_the_short_version_travels(ends: Ends) -> None:
    robot, station = ends
    assert robot.send(b"the whole story", for_radio=lambda: b"news")
    assert station.receive(3.0) == (b"news" if robot.path is LinkPath.RADIO else b"the whole story")


def test_a_link_that_carries_nothing_has_room_and_one_that_is_closed_has_none(ends: Ends) -> None:
    robot, _ = ends
    assert robot.has_room
    robot.close()
    assert not robot.has_room
    assert not robot.connected


def test_a_link_tells_of_its_state(ends: Ends) -> None:
    robot, station = ends
    before = robot.resets
    assert robot.send(b"x")
    station.receive(1.0)
    assert robot.resets == before
    assert not robot.events or robot.events[-1].path is robot.path
    assert len(robot.health.radios) == (0 if robot.health.lora is None else 2)


def test_an_oversized_datagram_is_refused(ends: Ends) -> None:
    with pytest.raises(ValueError, match="65001"):
        ends[1].send(bytes(65_001))


def test_the_statistics_count_both_directions(ends: Ends) -> None:
    robot, station = ends
    robot.send(b"abc")
    station.receive(1.0)
    assert robot.statistics.sent_datagrams == station.statistics.received_datagrams == 1
    assert robot.statistics.sent_bytes == station.statistics.received_bytes >= 3


def test_a_closed_link_raises_and_may_be_closed_again(ends: Ends) -> None:
    station = ends[1]
    station.close()
    station.close()
    with pytest.raises(LinkError):
        station.receive(0.0)
    with pytest.raises(LinkError):
        station.send(b"x")


def test_the_station_notices_that_the_robot_is_gone(ends: Ends) -> None:
    robot, station = ends
    robot.close()
    with pytest.raises(LinkError):
        for _ in range(40):
            station.receive(0.1)


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def server(clock: ManualClock) -> Iterator[TcpServerLink]:
    link = TcpServerLink("127.0.0.1", 0, clock, farewell=b"busy")
    yield link
    link.close()


def test_a_refused_connection_names_the_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    with pytest.raises(LinkError, match=rf"127\.0\.0\.1:{port}: connection refused"):
        TcpClientLink("127.0.0.1", port, 0.5)


def test_a_port_that_is_no_port_is_named() -> None:
    with pytest.raises(LinkError, match="70000"):
        TcpClientLink("127.0.0.1", 70_000, 0.5)


def test_a_port_in_use_is_named(server: TcpServerLink) -> None:
    with pytest.raises(LinkError, match=f"cannot listen on 127.0.0.1:{server.port}: another program"):
        TcpServerLink("127.0.0.1", server.port, ManualClock())


def test_a_robot_without_a_station_drops_what_it_sends(server: TcpServerLink) -> None:
    assert not server.send(b"nobody")
    assert not server.connected


def test_the_next_station_is_served_when_the_first_has_gone(server: TcpServerLink) -> None:
    first = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    first.close()
    server.receive(1.0)
    second = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    assert server.send(b"hello")
    assert second.receive(1.0) == b"hello"
    second.close()


def test_a_second_station_is_turned_away_while_the_first_one_talks(server: TcpServerLink) -> None:
    first = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    second = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(0.2)
    assert second.receive(1.0) == b"busy"
    with pytest.raises(LinkError):
        for _ in range(20):
            second.receive(0.1)
    assert server.send(b"still yours")
    assert first.receive(1.0) == b"still yours"
    first.close()
    second.close()


def test_a_silent_station_gives_way_to_a_new_one(server: TcpServerLink, clock: ManualClock) -> None:
    silent = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    clock.advance(2.0)
    new = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    assert server.send(b"hello")
    assert new.receive(1.0) == b"hello"
    silent.close()
    new.close()


def test_foreign_bytes_are_dropped_and_counted(server: TcpServerLink) -> None:
    with socket.create_connection(("127.0.0.1", server.port), 2.0) as stranger:
        server.receive(1.0)
        stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
        assert server.receive(1.0) is None
        assert server.statistics.dropped_bytes > 0
    with contextlib.suppress(LinkError):
        server.receive(0.0)


def test_on_a_stalled_network_little_is_queued(server: TcpServerLink) -> None:
    station = TcpClientLink("127.0.0.1", server.port, 2.0)
    server.receive(1.0)
    taken = 0
    while server.send(bytes(1000)):
        taken += 1
        assert taken < 8000
    # What the two kernels' own buffers hold cannot be helped; ours adds no more than 16 of these.
    peer = server._peer
    assert peer is not None
    assert len(peer._out) <= 16_384
    station.close()
