from __future__ import annotations

import pytest

from shared.link.base import Link, LinkError
from shared.runtime.clock import ManualClock
from tools.simulator.links import LINK_NAMES, LinkName, open_links

_TICK_S = 0.02


def conversation(name: LinkName, seed: int, seconds: float) -> list[tuple[float, bytes]]:
    """What the station hears, and when, of a robot that says something five times a second."""
    clock = ManualClock()
    joint = open_links(name, clock, seed)
    station = joint.make_station("robot", 1)
    heard: list[tuple[float, bytes]] = []
    for tick in range(round(seconds / _TICK_S)):
        joint.advance_to(tick * _TICK_S)
        if tick % 10 == 0 and joint.robot.connected and joint.robot.has_room:
            joint.robot.send(tick.to_bytes(2, "big") + bytes(40))
        received(joint.robot)
        heard += [(clock.now_s(), datagram) for datagram in received(station)]
    return heard


def received(link: Link) -> list[bytes]:
    datagrams = []
    try:
        while (datagram := link.receive(0.0)) is not None:
            datagrams.append(datagram)
    except LinkError:
        pass
    return datagrams


@pytest.mark.parametrize("name", LINK_NAMES)
def test_a_seed_gives_the_same_conversation_again(name: LinkName) -> None:
    heard = conversation(name, 3, 8.0)
    assert len(heard) > 15
    assert [datagram for _, datagram in heard] == sorted(datagram for _, datagram in heard)
    assert heard == conversation(name, 3, 8.0)


@pytest.mark.parametrize("name", LINK_NAMES)
def test_a_cut_link_carries_nothing_until_it_is_mended(name: LinkName) -> None:
    clock = ManualClock()
    joint = open_links(name, clock, 1)
    station = joint.make_station("robot", 1)
    while not (joint.robot.connected and station.connected):
        joint.advance_to(clock.now_s() + _TICK_S)
        received(joint.robot)
        received(station)
    joint.cut()
    until_s = clock.now_s() + 8.0
    while clock.now_s() < until_s:
        joint.advance_to(clock.now_s() + _TICK_S)
        received(joint.robot)
        received(station)
    assert not joint.robot.connected
    joint.mend()
    while not joint.robot.connected:
        if not station.mends_itself and not station.connected:
            station = joint.make_station("robot", 1)
        joint.advance_to(clock.now_s() + _TICK_S)
        received(joint.robot)
        received(station)
        assert clock.now_s() < until_s + 20.0


def test_wifi_is_cut_by_itself_again_and_again() -> None:
    clock = ManualClock()
    joint = open_links("switch", clock, 1)
    station = joint.make_station("robot", 1)
    while clock.now_s() < 20.0:
        joint.advance_to(clock.now_s() + _TICK_S)
        received(joint.robot)
        received(station)
    assert len(joint.cuts) > 2
    assert all(cut.from_s < cut.to_s for cut in joint.cuts)
