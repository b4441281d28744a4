from __future__ import annotations

import numpy as np
import pytest

from robot_app.uplink import Uplink
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.messages import Ack, Command, EmergencyStop, Heartbeat, Hello, NumberedCommand, Start, Stop
from shared.protocol.codec import Decoder, encode
from tests.shared import samples

HELLO = Hello("r", "0", ((0.0, 0.0),), 0.5)


class Robot:
    def __init__(self) -> None:
        self.link, self.station = loopback_pair()
        self.uplink = Uplink(self.link, HELLO)
        self.handled: list[Command] = []
        self.heard = 0
        self.changed_hands = 0

    def tick(self) -> None:
        self.uplink.receive(self._handle, self._hear, self._change_hands)

    def answers(self) -> list[Ack]:
        return [m for m in messages(self.station) if isinstance(m, Ack)]

    def _handle(self, command: Command) -> tuple[bool, str]:
        self.handled.append(command)
        return True, ""

    def _change_hands(self) -> None:
        self.changed_hands += 1

    def _hear(self) -> None:
        self.heard += 1


def messages(link: LoopbackLink) -> list[object]:
    found: list[object] = []
    while (datagram := link.receive(0.0)) is not None:
        found.append(Decoder().decode(datagram))
    return found


@pytest.fixture
def robot() -> Robot:
    return Robot()


def test_a_command_is_carried_out_and_answered(robot: Robot) -> None:
    robot.station.send(encode(NumberedCommand(7, Start())))
    robot.tick()
    assert robot.handled == [Start()]
    assert robot.answers() == [Ack(7, True, "")]


def test_a_repeated_command_is_answered_again_and_not_carried_out_again(robot: Robot) -> None:
    for _ in range(3):
        robot.station.send(encode(NumberedCommand(7, Start())))
    robot.tick()
    assert len(robot.handled) == 1
    assert len(robot.answers()) == 3


def test_a_repeated_emergency_stop_stops_again(robot: Robot) -> None:
    for _ in range(2):
        robot.station.send(encode(NumberedCommand(8, EmergencyStop())))
    robot.tick()
    assert len(robot.handled) == 2


def test_a_heartbeat_is_heard_and_not_answered(robot: Robot) -> None:
    robot.station.send(encode(NumberedCommand(1, Heartbeat())))
    robot.tick()
    assert robot.heard == 1
    assert robot.handled == []
    assert robot.answers() == []


def test_foreign_bytes_are_not_heard(robot: Robot, rng: np.random.Generator) -> None:
    for _ in range(20):
        robot.station.send(rng.bytes(30))
    robot.station.send(encode(samples.telemetry()))
    robot.tick()
    assert robot.heard == 0


def test_the_robot_greets_at_once_and_then_now_and_then(robot: Robot) -> None:
    for i in range(100):
        robot.uplink.greet(i / 10)
    assert sum(isinstance(m, Hello) for m in messages(robot.station)) == 5


def test_an_observation_that_finds_no_room_is_skipped(robot: Robot, rng: np.random.Generator) -> None:
    observation = samples.observation(rng)
    sent = [robot.uplink.observe(observation, 0.0) for _ in range(300)]
    assert sent.count(False) == robot.uplink.observations_skipped > 0


def test_a_link_that_is_gone_does_no_harm(robot: Robot, rng: np.random.Generator) -> None:
    robot.station.close()
    robot.tick()
    robot.uplink.greet(0.0)
    assert not robot.uplink.observe(samples.observation(rng), 0.0)


def test_another_station_is_noticed_and_the_same_one_is_not(robot: Robot) -> None:
    for number in (0xFFFF_FFF0, 0xFFFF_FFF5, 3, 2_000, 1_500_000_000, 1_500_000_001):
        robot.station.send(encode(NumberedCommand(number, Heartbeat())))
    robot.tick()
    assert robot.changed_hands == 1


def test_an_order_that_is_older_than_the_last_stop_is_refused(robot: Robot) -> None:
    for number, command in ((10, Start()), (12, Stop()), (11, Start())):
        robot.station.send(encode(NumberedCommand(number, command)))
    robot.tick()
    assert robot.handled == [Start(), Stop()]
    assert robot.answers()[-1] == Ack(11, False, "it is older than the last stop")
    robot.station.send(encode(NumberedCommand(13, Start())))
    robot.tick()
    assert robot.handled[-1] == Start()
