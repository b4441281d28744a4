"""Wi-Fi that is cut again and again, two emulated radios each, on a manual clock."""

from __future__ import annotations

import numpy as np
import pytest

from shared.link.base import Lane, LinkError, LinkPath
from shared.link.failover.lanes import WINDOW, Incoming, Newer, Outgoing
from shared.link.failover.watch import FailoverConfig, Watch
from tools.simulator.radio.failover_rig import FailoverRig
from tools.simulator.radio.loss import Independent

PERIOD_S = 0.2


class Mission:
    """Five observations a second, large on Wi-Fi and small on LoRa, and as many commands."""

    def __init__(self, rig: FailoverRig) -> None:
        self.rig = rig
        self.sent = self.ordered = 0
        self.observations: list[int] = []
        self.commands: list[int] = []
        self.sent_s: list[float] = []
        self.came_s: list[float] = []
        self._next_s = rig.clock.now_s()
        self.stopped = False
        rig.at_each_event = self._step

    def _step(self) -> None:
        now_s = self.rig.clock.now_s()
        if now_s >= self._next_s and not self.stopped:
            self._next_s += PERIOD_S
            number = self.sent.to_bytes(4, "little")
            assert self.rig.robot.send(number + bytes(928), for_radio=lambda: number + bytes(106))
            self.sent_s.append(now_s)
            self.sent += 1
            assert self.rig.station.send(self.ordered.to_bytes(4, "little"), Lane.COMMAND)
            self.ordered += 1
        while (datagram := self.rig.station.receive(0.0)) is not None:
            self.observations.append(int.from_bytes(datagram[:4], "little"))
            self.came_s.append(now_s)
        while (datagram := self.rig.robot.receive(0.0)) is not None:
            self.commands.append(int.from_bytes(datagram[:4], "little"))

    def finish(self) -> None:
        self.stopped = True
        self.rig.run(10.0, lambda: len(self.observations) == self.sent and len(self.commands) == self.ordered)
        assert self.observations == list(range(self.sent))
        assert self.commands == list(range(self.ordered))


def on_wifi(rig: FailoverRig) -> bool:
    return rig.robot.path is LinkPath.WIFI and rig.station.path is LinkPath.WIFI


def ready(seed: int = 1) -> FailoverRig:
    rig = FailoverRig(seed)
    assert rig.run(20.0, lambda: on_wifi(rig) and len(rig.robot._knows_us) == len(rig.station._knows_us) == 2)
    return rig


def test_cuts_at_any_moment_lose_nothing_and_interrupt_for_less_than_half_a_second() -> None:
    rig, rng = ready(), np.random.default_rng(2)
    mission = Mission(rig)
    for _ in range(6):
        rig.run(float(rng.uniform(0.3, 1.0)))
        rig.wifi.cut()
        rig.run(float(rng.uniform(0.1, 2.5)))
        rig.wifi.restore()
        assert rig.run(10.0, lambda: on_wifi(rig))
    mission.finish()
    assert float(np.diff(mission.came_s).max()) < 0.5
    assert rig.robot.statistics.changes >= 10


def test_the_operator_is_told_of_every_change() -> None:
    rig = ready()
    rig.station.events.clear()
    rig.wifi.cut()
    assert rig.run(1.0, lambda: rig.station.path is LinkPath.RADIO)
    rig.wifi.restore()
    assert rig.run(5.0, lambda: rig.station.path is LinkPath.WIFI)
    assert [e.path for e in rig.station.events] == [LinkPath.RADIO, LinkPath.WIFI]
    assert "acknowledgements have stopped" in rig.station.events[0].reason


def test_a_stop_comes_through_when_wifi_dies_under_it() -> None:
    rig = ready()
    rig.wifi.cut()
    asked_s = rig.clock.now_s()
    assert rig.station.send(b"STOP", Lane.NOW)
    assert rig.run(1.0, lambda: rig.robot.receive(0.0) == b"STOP")
    assert rig.clock.now_s() - asked_s < 0.6


def test_the_newest_comes_once_and_never_an_older_one() -> None:
    rig = ready()
    came: list[int] = []
    for value in range(40):
        rig.station.send(bytes((value,)), Lane.NEWEST, slot=3)
        rig.run(0.1)
        while (datagram := rig.robot.receive(0.0)) is not None:
            came.append(datagram[0])
    assert came == sorted(set(came))
    assert len(came) > 35


def test_wifi_alone_and_lora_alone_are_enough() -> None:
    rig = ready()
    mission = Mission(rig)
    rig.wifi.cut()
    rig.run(5.0)
    rig.radios.channel.use_loss(lambda: Independent(1.0))
    rig.wifi.restore()
    rig.run(8.0)
    assert not rig.radios.robot.connected
    mission.finish()


def test_a_station_that_begins_anew_starts_from_nothing() -> None:
    rig = ready()
    Mission(rig)
    rig.run(2.0)
    rig.at_each_event = lambda: None
    rig.restart_station()
    assert rig.run(10.0, lambda: on_wifi(rig) and rig.station.connected and rig.robot.statistics.peer_restarts == 1)
    mission = Mission(rig)
    rig.run(2.0)
    mission.finish()


@pytest.mark.parametrize("wifi", [True, False])
def test_a_robot_that_has_spoken_with_another_station_and_comes_back_is_understood(wifi: bool) -> None:
    """Both stations have the pairing file, and neither begins anew."""
    rig = ready()
    mission = Mission(rig)
    rig.run(2.0)
    mission.finish()
    rig.at_each_event = lambda: None
    if not wifi:
        rig.wifi.cut()
    rig.robot._take(LinkPath.WIFI, bytes((0, 1)) + b"ABCD" + rig.robot._epoch, rig.clock.now_s())
    resets = rig.robot.resets
    assert rig.run(10.0, lambda: rig.robot.resets > resets and rig.robot.connected and rig.station.connected)
    rig.run(3.0)
    settled = rig.robot.resets, rig.station.resets
    mission = Mission(rig)
    rig.run(2.0)
    mission.finish()
    assert (rig.robot.resets, rig.station.resets) == settled


def test_foreign_frames_are_counted_and_change_nothing() -> None:
    rig, rng = ready(), np.random.default_rng(4)
    mission = Mission(rig)
    for _ in range(2_000):
        rig.station._take(
            LinkPath.WIFI, bytes((int(rng.integers(0x20)) | 0xE0,)) + rng.bytes(int(rng.integers(0, 60))), 0.0
        )
    assert rig.station.statistics.dropped_bytes > 0
    rig.run(1.0)
    mission.finish()


def test_without_a_way_nothing_is_taken() -> None:
    rig = FailoverRig(1)
    rig.wifi.cut()
    assert not rig.robot.send(b"x")
    assert not rig.robot.connected


def test_a_closed_link_raises() -> None:
    rig = ready()
    rig.station.close()
    rig.station.close()
    with pytest.raises(LinkError):
        rig.station.send(b"x")
    with pytest.raises(LinkError):
        rig.station.receive(0.0)


def test_a_lane_keeps_no_more_than_its_window() -> None:
    lane = Outgoing()
    while lane.has_room:
        lane.add(b"x")
    assert len(lane) == WINDOW
    lane.acknowledge(30)
    lane.acknowledge(200)  # of nothing that was sent
    assert len(lane) == WINDOW - 30


def test_an_incoming_lane_restores_the_order_across_the_wrap_of_its_numbers() -> None:
    lane, rng = Incoming(), np.random.default_rng(1)
    came: list[bytes] = []
    for start in range(0, 1_000, 50):
        for i in rng.permutation(50):
            came += lane.take((start + int(i)) & 0xFF, bytes((start // 50, int(i))))
            lane.take((start + int(i)) & 0xFF, b"again")
    assert came == [bytes((n // 50, n % 50)) for n in range(1_000)]
    assert lane.duplicates == 1_000


def test_newer_is_newer_across_the_wrap() -> None:
    lane = Newer()
    assert lane.take(0, 250)
    assert lane.take(0, 3)
    assert not lane.take(0, 251)
    assert lane.take(1, 251)


def test_wifi_counts_as_steady_only_after_a_while_without_gaps() -> None:
    config = FailoverConfig()
    watch = Watch(config)
    now_s = 0.0
    while now_s < config.return_s:
        watch.hear(1, watch.probe(now_s), now_s + 0.001)
        assert not watch.is_steady(now_s)
        now_s += config.probe_s
    watch.hear(1, watch.probe(now_s), now_s + 0.01)
    assert watch.is_steady(now_s + 0.01)
    assert not watch.is_doubtful(now_s + 0.01)
    assert watch.is_doubtful(now_s + 0.1)
    assert watch.is_alive(now_s + 0.1)
    assert not watch.is_alive(now_s + 0.3)
