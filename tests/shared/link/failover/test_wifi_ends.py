"""Failover over real sockets: the robot's server and the station's dialler."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from shared.link.base import Link, LinkError
from shared.link.failover.wifi_ends import Dialler, serve
from shared.link.loopback import loopback_pair
from shared.link.tcp import TcpClientLink, TcpServerLink
from shared.runtime.clock import ManualClock


@pytest.fixture
def server() -> Iterator[TcpServerLink]:
    link = TcpServerLink("127.0.0.1", 0, ManualClock())
    yield link
    link.close()


def served(server: TcpServerLink, tries: int = 200) -> Link:
    connect = serve(server)
    for _ in range(tries):
        if (link := connect()) is not None:
            return link
        server.receive(0.01)
    raise AssertionError("nobody came in")


def test_the_robots_end_carries_both_ways_and_closing_it_leaves_the_server(server: TcpServerLink) -> None:
    station = TcpClientLink("127.0.0.1", server.port, 2.0)
    end = served(server)
    assert end.send(b"down")
    assert station.receive(1.0) == b"down"
    station.send(b"up")
    assert end.receive(1.0) == b"up"
    end.close()
    with pytest.raises(LinkError):
        for _ in range(50):
            station.receive(0.05)
    station.close()
    again = TcpClientLink("127.0.0.1", server.port, 2.0)
    assert served(server).connected
    again.close()


def test_a_connection_that_gave_way_to_another_one_is_gone_for_who_held_it(server: TcpServerLink) -> None:
    first = TcpClientLink("127.0.0.1", server.port, 2.0)
    old = served(server)
    server.drop_peer()
    second = TcpClientLink("127.0.0.1", server.port, 2.0)
    new = served(server)
    with pytest.raises(LinkError, match="gone"):
        old.receive(0.0)
    old.close()
    assert new.connected, "closing the old one does not drop the new one"
    first.close()
    second.close()


def dialled(dialler: Dialler) -> Link | None:
    link = dialler()
    if dialler._thread is not None:
        dialler._thread.join(5.0)
    return link if link is not None else dialler()


def test_dialling_does_not_wait_and_gives_what_was_made() -> None:
    may_go_on = threading.Event()
    made, _ = loopback_pair()

    def make() -> Link:
        may_go_on.wait(5.0)
        return made

    dialler = Dialler(make)
    assert dialler() is None
    assert dialler() is None
    may_go_on.set()
    assert dialled(dialler) is made


def test_a_refused_attempt_is_told_once_and_another_one_begins() -> None:
    def make() -> Link:
        raise LinkError("no answer in time")

    dialler = Dialler(make)
    for _ in range(2):
        with pytest.raises(LinkError, match="no answer"):
            dialled(dialler)


def test_what_is_made_after_the_end_is_closed() -> None:
    may_go_on = threading.Event()
    made, _ = loopback_pair()

    def make() -> Link:
        may_go_on.wait(5.0)
        return made

    dialler = Dialler(make)
    assert dialler() is None
    thread = dialler._thread
    assert thread is not None
    dialler.close()
    may_go_on.set()
    thread.join(5.0)
    assert not made.connected
    assert dialler() is None
