"""Two sides with two emulated modules each, on a manual clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from shared.link.base import Lane, LinkError
from shared.link.radio_pair import items
from shared.link.radio_pair.config import PairConfig
from shared.link.radio_pair.lanes import Lanes
from shared.link.radio_pair.link import RadioPair
from shared.protocol.auth import Kind, read_head
from tools.simulator.radio.loss import Bursts, Independent, LossModel
from tools.simulator.radio.pair_rig import PairRig, link_settings


class Traffic:
    """Numbered observations as fast as the link takes them, and a numbered command a second the other way."""

    def __init__(self, rig: PairRig, size: int = 110, lane: Lane = Lane.COMMAND) -> None:
        self.rig = rig
        self.size = size
        self.lane = lane
        self.sent = self.ordered = 0
        self.observations: list[int] = []
        self.commands: list[int] = []
        self.waited_s: list[float] = []
        self.stopped = False
        self._sent_s: dict[int, float] = {}
        self._next_s = rig.clock.now_s()
        rig.at_each_event = self.step

    def step(self) -> None:
        rig, now_s = self.rig, self.rig.clock.now_s()
        while not self.stopped and rig.robot.waiting_bytes < 200 and rig.robot.send(self._numbered(self.sent)):
            self.sent += 1
        if now_s >= self._next_s and not self.stopped:
            self._next_s += 1.0
            if rig.station.send(self.ordered.to_bytes(4, "little") + bytes(8), self.lane):
                self._sent_s[self.ordered] = now_s
                self.ordered += 1
        self.observations += taken(rig.station)
        for number in taken(rig.robot):
            self.commands.append(number)
            self.waited_s.append(now_s - self._sent_s[number])

    def _numbered(self, number: int) -> bytes:
        return number.to_bytes(4, "little") + bytes(self.size - 4)

    def finish(self, seconds: float = 30.0) -> None:
        """Nothing new; what was taken arrives."""
        self.stopped = True
        self.rig.run(seconds, lambda: len(self.observations) == self.sent and len(self.commands) == self.ordered)
        assert self.observations == list(range(self.sent))
        assert self.commands == list(range(self.ordered))


def taken(link: RadioPair) -> list[int]:
    found: list[int] = []
    while True:
        try:
            datagram = link.receive(0.0)
        except LinkError:
            continue
        if datagram is None:
            return found
        found.append(int.from_bytes(datagram[:4], "little"))


def connected(seed: int = 1, **arguments: object) -> PairRig:
    rig = PairRig(seed, **arguments)  # type: ignore[arg-type]
    rig.connect()
    return rig


def test_without_losses_the_radios_are_nearly_always_on_the_air() -> None:
    rig = connected()
    traffic = Traffic(rig)
    before = rig.channel.statistics.per_antenna_s.copy()
    rig.run(15.0)
    after = rig.channel.statistics.per_antenna_s
    packets = sum(after[n] - before.get(n, 0.0) for n in ("robot 0", "robot 1")) / 0.03853
    assert packets * 400 / 15.0 > 0.85 * 9_040  # of what two modules could send
    assert len(traffic.observations) * traffic.size * 8 / 15.0 > 0.75 * 9_040
    traffic.finish()
    assert rig.channel.statistics.lost_to_collision == 0
    assert max(traffic.waited_s) < 1.2


@pytest.mark.parametrize(
    "loss",
    [lambda: Independent(0.2), lambda: Independent(0.5), lambda: Bursts(1.0, 0.3)],
    ids=["a fifth", "half", "bursts"],
)
def test_nothing_is_lost_or_doubled_on_a_bad_channel(loss: Callable[[], LossModel]) -> None:
    rig = connected(loss=loss)
    traffic = Traffic(rig)
    rig.run(10.0)
    traffic.finish(110.0)
    assert traffic.sent > 20


def test_only_what_was_lost_is_sent_again_and_no_radio_is_given_up_for_it() -> None:
    rig = connected(loss=lambda: Independent(0.2))
    traffic = Traffic(rig)
    rig.run(20.0)
    airtime_s = rig.channel.statistics.per_antenna_s
    assert rig.station.statistics.lanes.duplicates == 0
    assert min(airtime_s["robot 0"], airtime_s["robot 1"]) > 6.0  # of 8.0 without a turn
    traffic.finish()


def test_a_question_that_was_announced_is_answered_although_it_was_not_heard() -> None:
    rig = connected()
    traffic = Traffic(rig)
    rig.run(2.0)
    hear = rig.station._turns.heard

    def heard(radio: int, data: bytes, now_s: float) -> bool:
        kind, turn, _ = read_head(data[0])
        return False if kind is Kind.ITEMS and turn else hear(radio, data, now_s)

    rig.station._turns.heard = heard  # type: ignore[method-assign]
    turns, lost = rig.robot.statistics.turns.turns, rig.robot.statistics.turns.lost_turns
    rig.run(5.0)
    assert rig.robot.statistics.turns.turns - turns >= 4
    assert rig.robot.statistics.turns.lost_turns == lost
    rig.station._turns.heard = hear  # type: ignore[method-assign]
    traffic.finish()


@pytest.mark.parametrize("side", ["robot", "station"])
@pytest.mark.parametrize("which", [0, 1])
def test_one_radio_may_fail_and_come_back(side: str, which: int) -> None:
    rig = connected()
    traffic = Traffic(rig)
    module = (rig.robot_modules if side == "robot" else rig.station_modules)[which]
    rig.run(2.0)
    module.power_off()
    rig.run(4.0)
    before = len(traffic.observations)
    rig.run(5.0)
    assert (len(traffic.observations) - before) * traffic.size * 8 / 5.0 > 0.3 * 9_040
    module.power_on()
    rig.run(8.0)
    before = len(traffic.observations)
    rig.run(5.0)
    assert (len(traffic.observations) - before) * traffic.size * 8 / 5.0 > 0.65 * 9_040
    traffic.finish()


def test_trying_a_dead_radio_holds_nothing_up_on_the_living_one() -> None:
    rig = connected()
    traffic = Traffic(rig)
    rig.station_modules[0].power_off()  # the robot's own modules say that they are up
    rig.run(4.0)
    came_s: list[float] = []

    def step() -> None:
        before = len(traffic.observations)
        traffic.step()
        if len(traffic.observations) > before:
            came_s.append(rig.clock.now_s())

    rig.at_each_event = step
    rig.run(10.0)
    assert len(came_s) > 25
    assert max(np.diff(came_s)) < 0.5
    traffic.finish()


@pytest.mark.parametrize("settings", [(500_000, 7), (125_000, 9)])
def test_one_radio_of_each_side_is_a_link_too(settings: tuple[int, int]) -> None:
    rig = connected(radios=1, settings=link_settings(*settings))
    traffic = Traffic(rig, size=60)
    rig.run(20.0)
    traffic.finish(60.0)


def test_an_emergency_stop_overtakes_everything() -> None:
    rig = connected()
    rig.robot.send(bytes(2_000))
    rig.station.send(b"path" * 400, Lane.COMMAND)
    rig.run(1.0)
    asked_s = rig.clock.now_s()
    assert rig.station.send(b"STOP", Lane.NOW)
    assert rig.run(1.5, lambda: rig.robot.receive(0.0) == b"STOP")
    assert rig.clock.now_s() - asked_s < 1.2


def test_the_newest_takes_the_place_of_what_waits() -> None:
    rig = connected()
    for value in range(50):
        assert rig.station.send(bytes((value,)), Lane.NEWEST, slot=1)
    rig.run(1.0)
    assert rig.robot.receive(0.0) == b"\x31"
    assert rig.robot.receive(0.0) is None


@pytest.mark.parametrize("restarted", ["robot", "station"])
def test_a_side_that_begins_anew_is_found_again(restarted: str) -> None:
    rig = connected()
    Traffic(rig)
    rig.run(3.0)
    rig.at_each_event = lambda: None
    (rig.make_robot if restarted == "robot" else rig.make_station)()
    rig.run(0.1)
    rig.connect()
    survivor = rig.station if restarted == "robot" else rig.robot
    assert rig.run(6.0, lambda: survivor.statistics.security.peer_restarts == 1)
    Traffic(rig).finish()


def test_after_a_long_silence_nothing_is_missing() -> None:
    rig = connected()
    traffic = Traffic(rig)
    rig.run(3.0)
    rig.channel.use_loss(lambda: Independent(1.0))
    rig.run(15.0)
    assert not rig.robot.connected
    rig.channel.use_loss(Independent)
    rig.run(5.0)
    traffic.finish()
    assert rig.robot.statistics.security.peer_restarts == 0


def test_what_was_newest_before_the_way_was_lost_does_not_come_after_it() -> None:
    rig = connected()
    rig.channel.use_loss(lambda: Independent(1.0))
    rig.run(1.0)  # the station is not asked any more
    assert rig.station.send(b"heartbeat", Lane.NEWEST)
    assert rig.station.send(b"order", Lane.COMMAND)
    rig.run(5.0)
    with pytest.raises(LinkError):
        rig.station.receive(0.0)
    rig.channel.use_loss(Independent)
    came: list[bytes | None] = []
    rig.at_each_event = lambda: came.append(rig.robot.receive(0.0)) if rig.robot.connected else None
    rig.run(5.0)
    assert [datagram for datagram in came if datagram] == [b"order"]


def test_the_loss_of_the_other_side_is_raised_once() -> None:
    rig = connected()
    rig.channel.use_loss(lambda: Independent(1.0))
    rig.run(5.0)
    with pytest.raises(LinkError, match="not heard any more"):
        rig.station.receive(0.0)
    assert rig.station.receive(0.0) is None
    assert not rig.station.send(b"x")


def test_another_key_is_another_world() -> None:
    rig = PairRig(1, keys=(bytes(32), b"\1" * 32))
    rig.run(5.0)
    assert not rig.robot.connected
    assert not rig.station.connected
    assert rig.station.statistics.security.refused_packets > 0


def test_packets_played_again_are_refused() -> None:
    rig = connected()
    turns = rig.robot._turns
    played: list[bytes] = []
    hear = turns.heard
    turns.heard = lambda radio, data, now_s: played.append(data) or hear(radio, data, now_s)  # type: ignore[method-assign,func-returns-value]
    for value in range(20):
        rig.station.send(bytes((value,)), Lane.NOW)
        rig.run(0.5)
        assert rig.robot.receive(0.0) == bytes((value,))
    rig.run(0.5)
    for data in played:
        assert not hear(0, data, rig.clock.now_s())
    assert rig.robot.receive(0.0) is None
    assert rig.robot.statistics.security.refused_packets == len(played)


def test_questions_that_somebody_kept_from_coming_and_plays_later_harm_nothing() -> None:
    rig = connected()
    traffic = Traffic(rig)
    rig.run(2.0)
    turns, kept = rig.station._turns, list[tuple[int, bytes]]()
    hear = turns.heard

    def heard(radio: int, data: bytes, now_s: float) -> bool:
        if read_head(data[0])[0] is not Kind.ITEMS:
            return hear(radio, data, now_s)
        kept.append((radio, data))
        return False

    turns.heard = heard  # type: ignore[method-assign]
    rig.run(8.0)  # announced questions are answered: more than half of what a byte can count goes by
    turns.heard = hear  # type: ignore[method-assign]
    for radio, data in kept:
        hear(radio, data, rig.clock.now_s())
    rig.run(10.0)
    traffic.finish()
    assert len(kept) > 5
    assert rig.station.statistics.security.stream_errors == 0


def test_an_announced_question_that_is_played_again_makes_nobody_speak() -> None:
    rig = connected()
    traffic = Traffic(rig)
    announced: list[tuple[int, bytes]] = []
    turns = rig.station._turns
    hear = turns.heard

    def heard(radio: int, data: bytes, now_s: float) -> bool:
        kind, turn, _ = read_head(data[0])
        if kind is Kind.DATA and turn:
            announced.append((radio, data))
        return hear(radio, data, now_s)

    turns.heard = heard  # type: ignore[method-assign]
    rig.run(4.0)
    traffic.finish()
    assert announced
    for radio, data in announced:
        assert not hear(radio, data, rig.clock.now_s())
        assert turns.due_s(radio, rig.clock.now_s()) == np.inf


def test_what_was_overtaken_is_not_the_newest() -> None:
    lanes, other = Lanes(2_048, 65_000), Lanes(2_048, 65_000)
    packets: list[bytes] = []
    for value in b"ab":
        lanes.queue(bytes((value,)), Lane.NEWEST, 1)
        lanes.queue(bytes((value,)), Lane.COMMAND, 0)
        filled = lanes.fill(45, 0, report=False)
        assert filled is not None
        packets.append(filled.body)
    other.take_items(packets[1])
    other.take_items(packets[0], is_late=True)
    assert list(other.delivered) == [b"b", b"a", b"b"]  # the newest; then the orders, of which none is missing


def test_a_stop_that_is_not_confirmed_keeps_its_name() -> None:
    lanes, other = Lanes(2_048, 65_000), Lanes(2_048, 65_000)
    assert lanes.queue(b"first", Lane.NOW, 0)
    taken_count = 1
    for _ in range(60):
        taken_count += lanes.queue(b"more", Lane.NOW, 0)
        for identifier in [name for name in lanes._now if name]:  # all but the first are confirmed
            lanes.take_items(items.write(items.NowHasCome(identifier)))
    lanes.settle(0.0)
    filled = lanes.fill(45, 0, report=False)
    assert filled is not None
    other.take_items(filled.body)
    assert other.delivered[0] == b"first"
    assert taken_count == 8


def test_after_a_greeting_the_station_is_asked_at_once() -> None:
    rig = connected()
    Traffic(rig)
    rig.run(3.0)
    rig.channel.use_loss(lambda: Independent(1.0))
    rig.run(4.0)
    rig.channel.use_loss(Independent)
    security, turns = rig.robot.statistics.security, rig.robot.statistics.turns
    sessions = security.sessions
    assert rig.run(5.0, lambda: security.sessions > sessions)
    asked = turns.turns
    assert rig.run(0.3, lambda: turns.turns > asked)  # one that is due comes after 1 s


def test_foreign_packets_are_counted_and_change_nothing() -> None:
    rig = connected(config=PairConfig())
    rng = np.random.default_rng(8)
    traffic = Traffic(rig)
    rig.run(2.0)
    for _ in range(3_000):
        noise = rng.bytes(int(rng.integers(1, 51)))
        assert not rig.station._turns.heard(0, noise, rig.clock.now_s())
        assert not rig.robot._turns.heard(1, noise, rig.clock.now_s())
    rig.run(2.0)
    traffic.finish()


def test_a_side_that_nobody_reads_turns_the_other_away() -> None:
    rig = connected()
    for _ in range(40):
        rig.run(0.5)
        while rig.robot.send(bytes(3)):
            pass
    assert len(rig.station._lanes.delivered) < 300
    assert rig.robot.waiting_bytes <= 2_048 + 128 * 45  # the lane, and a window of what was turned away


def test_what_is_no_datagram_is_refused() -> None:
    rig = connected()
    with pytest.raises(ValueError, match="65001"):
        rig.robot.send(bytes(65_001))
    with pytest.raises(ValueError, match="0 bytes"):
        rig.robot.send(b"")
