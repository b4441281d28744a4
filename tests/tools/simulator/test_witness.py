from __future__ import annotations

from shared.link.base import Lane, LinkPath
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.runtime.clock import ManualClock
from tools.simulator.witness import Side, Witness


class Careless(LoopbackLink):
    """Loses what begins with an l, says twice what begins with a t."""

    def __init__(self, inner: LoopbackLink) -> None:
        super().__init__(inner._outgoing, inner._incoming)

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: object = None) -> bool:
        said = for_radio() if callable(for_radio) else datagram
        if not said.startswith(b"l"):
            super().send(said, lane)
        return super().send(said, lane) if said.startswith(b"t") else True


def test_losses_and_doubles_are_counted_by_who_sent() -> None:
    clock, witness = ManualClock(), Witness()
    robot, station = loopback_pair()
    there = witness.watch(Careless(robot), Side.ROBOT, clock)
    here = witness.watch(station, Side.STATION, clock)
    for datagram in (b"one", b"two", b"lost", b"four"):
        there.send(datagram)
    clock.advance(1.0)
    while here.receive(0.0) is not None:
        pass
    account = witness.accounts[Side.ROBOT]
    assert account.lost(before_s=0.5) == 1
    assert account.lost(before_s=0.0) == 0
    assert account.duplicated == 1
    assert [sent.took_s for sent in account.sent if sent.came] == [1.0] * 3
    assert witness.accounts[Side.STATION].sent == []


def test_the_version_for_lora_counts_as_what_it_stands_for() -> None:
    clock, witness = ManualClock(), Witness()
    robot, station = loopback_pair()
    there = witness.watch(Careless(robot), Side.ROBOT, clock)
    here = witness.watch(station, Side.STATION, clock)
    there.send(b"a long story", for_radio=lambda: b"short")
    there.send(b"wi-fi only")
    assert here.receive(0.0) == b"short"
    here.receive(0.0)
    sent = witness.accounts[Side.ROBOT].of(Lane.BULK)
    assert [s.over for s in sent] == [LinkPath.RADIO, LinkPath.WIFI]
    assert sent[0].arrived == b"short"


def test_the_same_said_twice_comes_twice_and_the_newest_are_only_counted() -> None:
    clock, witness = ManualClock(), Witness()
    robot, station = loopback_pair()
    there, here = witness.watch(robot, Side.ROBOT, clock), witness.watch(station, Side.STATION, clock)
    for lane in (Lane.COMMAND, Lane.COMMAND, Lane.NEWEST):
        there.send(b"again", lane)
    while here.receive(0.0) is not None:
        pass
    account = witness.accounts[Side.ROBOT]
    assert (account.lost(before_s=1.0), account.duplicated, account.newest_sent, account.newest_came) == (0, 0, 1, 1)
