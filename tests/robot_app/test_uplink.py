from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from robot_app.uplink import Uplink
from shared.link.base import ForRadio, Lane, LinkHealth, LinkPath, LinkStatistics, PathChanged
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.messages import (
    Ack,
    Command,
    Drive,
    EmergencyStop,
    GoTo,
    Heartbeat,
    Hello,
    KeyframeWanted,
    MissionState,
    NumberedCommand,
    Observation,
    Pulse,
    Start,
    Stop,
    Telemetry,
)
from shared.protocol.codec import Decoder, encode
from shared.protocol.observations import MessageDecoder
from tests.shared import samples
from tools.fuzz.room_drive import drive

HELLO = Hello("r", "0", ((0.0, 0.0),), 0.5)


class Robot:
    def __init__(self) -> None:
        self.link, self.station = loopback_pair()
        self.uplink = Uplink(self.link, HELLO, lambda o: o)
        self.handled: list[Command] = []
        self.heard = 0
        self.changed_hands = 0
        self.now_s = 0.0

    def tick(self) -> None:
        self.uplink.receive(self.now_s, self._handle, self._hear, self._change_hands)

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


class Radio:
    """A link over LoRa, or beside it: remembers what it was given."""

    mends_itself = connected = has_room = True

    def __init__(self) -> None:
        self.statistics = LinkStatistics()
        self.events: deque[PathChanged] = deque(maxlen=1)
        self.path = LinkPath.RADIO
        self.health = LinkHealth(wifi=False, lora=True)
        self.resets = 0
        self.sent: list[tuple[Lane, bytes, bytes | None]] = []
        self.incoming: deque[bytes] = deque()

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        self.sent.append((lane, datagram, None if for_radio is None else for_radio()))
        return True

    def receive(self, timeout_s: float) -> bytes | None:
        return self.incoming.popleft() if self.incoming else None

    def close(self) -> None: ...

    def on(self, lane: Lane) -> list[tuple[bytes, bytes | None]]:
        found = [(whole, short) for where, whole, short in self.sent if where is lane]
        self.sent = [s for s in self.sent if s[0] is not lane]
        return found


@pytest.fixture
def radio() -> Radio:
    return Radio()


@pytest.fixture
def on_lora(radio: Radio) -> Uplink:
    return Uplink(radio, HELLO, lambda o: o)


def test_over_lora_a_pulse_a_second_stands_for_the_telemetry(radio: Radio, on_lora: Uplink) -> None:
    for i in range(50):
        on_lora.report(samples.telemetry(stamp_s=i / 5))
    pulses = [short for _, short in radio.on(Lane.NEWEST)]
    assert len(pulses) == 10
    assert all(isinstance(Decoder().decode(short or b""), Pulse) for short in pulses)


def test_what_changes_in_the_telemetry_goes_whole_and_for_certain(radio: Radio, on_lora: Uplink) -> None:
    for i in range(50):
        state = MissionState.OBSERVE if i < 20 else MissionState.COMMAND
        on_lora.report(samples.telemetry(stamp_s=i / 5, state=state))
    told = [Decoder().decode(whole) for whole, _ in radio.on(Lane.COMMAND)]
    assert [t.state for t in told if isinstance(t, Telemetry)] == [MissionState.OBSERVE, MissionState.COMMAND]


def test_beside_wifi_all_telemetry_goes_there_and_a_pulse_keeps_lora_warm(radio: Radio, on_lora: Uplink) -> None:
    radio.path = LinkPath.WIFI
    for i in range(50):
        on_lora.report(samples.telemetry(stamp_s=i / 5))
    sent = radio.on(Lane.NEWEST)
    assert len(sent) == 50
    assert sum(short is not None for _, short in sent) == 10


def test_observations_carry_their_compact_form_and_begin_anew_with_the_other_side(
    radio: Radio, on_lora: Uplink, rng: np.random.Generator
) -> None:
    decoder = MessageDecoder(compact=True)
    for i, observation in enumerate(drive(8, rng)):
        if i == 4:
            radio.resets += 1
            decoder = MessageDecoder(compact=True)
        on_lora.greet(i / 10)
        assert on_lora.observe(observation, i / 10)
        ((_, compact),) = radio.on(Lane.BULK)
        received = decoder.decode(compact or b"")
        assert received is not None
        assert isinstance(received.message, Observation)


def test_a_keyframe_is_sent_when_it_is_wanted_but_not_again_and_again(
    radio: Radio, on_lora: Uplink, rng: np.random.Generator
) -> None:
    keyframes = 0
    on_lora.greet(0.0)
    for i, observation in enumerate(drive(30, rng)):
        if i >= 10:
            radio.incoming.append(encode(KeyframeWanted()))
        on_lora.receive(0.0, lambda _: (True, ""), lambda: None, lambda: None)
        on_lora.observe(observation, i / 10)
        ((_, compact),) = radio.on(Lane.BULK)
        keyframes += MessageDecoder(compact=True).decode(compact or b"") is not None
    assert keyframes == 3


def test_a_wish_for_a_keyframe_is_no_sign_of_an_operator(radio: Radio, on_lora: Uplink) -> None:
    heard: list[bool] = []
    radio.incoming.append(encode(KeyframeWanted()))
    on_lora.receive(0.0, lambda _: (True, ""), lambda: heard.append(True), lambda: None)
    assert not heard


def test_without_room_no_observation_is_encoded(radio: Radio, on_lora: Uplink, rng: np.random.Generator) -> None:
    radio.has_room = False
    assert not on_lora.observe(drive(1, rng)[0], 0.0)
    assert not radio.sent


def test_a_hand_on_the_wheel_that_a_later_order_has_overtaken_is_refused(robot: Robot) -> None:
    path = np.zeros((2, 3), np.float32)
    for number, command in ((10, Drive(0.1, 0.0)), (12, GoTo(1, path)), (11, Drive(0.0, 0.0))):
        robot.station.send(encode(NumberedCommand(number, command)))
    robot.tick()
    assert [type(c) for c in robot.handled] == [Drive, GoTo]
    assert robot.answers()[-1] == Ack(11, False, "it is older than the last order")


def test_an_order_that_is_older_than_the_last_stop_is_refused(robot: Robot) -> None:
    for number, command in ((10, Start()), (12, Stop()), (11, Start())):
        robot.station.send(encode(NumberedCommand(number, command)))
    robot.tick()
    assert robot.handled == [Start(), Stop()]
    assert robot.answers()[-1] == Ack(11, False, "it is older than the last stop")
    robot.station.send(encode(NumberedCommand(13, Start())))
    robot.tick()
    assert robot.handled[-1] == Start()


def test_a_late_copy_of_a_stop_lets_no_order_in_that_a_later_stop_has_overtaken(robot: Robot) -> None:
    for number, command in ((10, EmergencyStop()), (20, Stop()), (10, EmergencyStop()), (15, Start())):
        robot.station.send(encode(NumberedCommand(number, command)))
    robot.tick()
    assert Start() not in robot.handled
    assert robot.answers()[-1] == Ack(15, False, "it is older than the last stop")


def test_an_order_that_lay_in_the_link_through_a_long_silence_is_refused(robot: Robot) -> None:
    def say(now_s: float, *commands: tuple[int, Command]) -> None:
        robot.now_s = now_s
        for number, command in commands:
            robot.station.send(encode(NumberedCommand(number, command)))
        robot.tick()

    say(0.0, (1, Heartbeat()))
    say(60.0, (2, Start()), (5, Heartbeat()), (3, Start()))
    assert robot.handled == []
    assert [a.reason for a in robot.answers()] == 2 * ["it was given before the link was lost"]
    say(60.2, (6, Start()))
    say(120.0, (7, Stop()))
    assert robot.handled == [Start(), Stop()], "a stop is never too late"
