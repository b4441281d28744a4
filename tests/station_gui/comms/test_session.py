from __future__ import annotations

import dataclasses
import math
import threading
import zlib
from collections import deque

import numpy as np
import pytest

from shared.link.base import (
    ForRadio,
    Lane,
    Link,
    LinkError,
    LinkHealth,
    LinkPath,
    LinkStatistics,
    PathChanged,
    RadioHealth,
)
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.link.pairing import PairingError
from shared.messages import (
    Ack,
    Command,
    Drive,
    EmergencyStop,
    GoTo,
    Heartbeat,
    Hello,
    KeyframeWanted,
    NumberedCommand,
    Observation,
    Refusal,
    Report,
    Start,
    Stop,
    Telemetry,
)
from shared.protocol.codec import Decoder, encode
from shared.protocol.observations import ObservationEncoder, Received
from shared.runtime.clock import ManualClock
from station_gui.comms.session import Session, SessionConfig
from station_gui.comms.state import LinkState, Severity
from tests.shared import samples
from tools.fuzz.room_drive import drive


@dataclasses.dataclass
class Heard:
    reports: list[Report] = dataclasses.field(default_factory=list)
    datagrams: list[bytes] = dataclasses.field(default_factory=list)
    events: list[str] = dataclasses.field(default_factory=list)

    def on_datagram(self, received: Received, size: int) -> None:
        self.datagrams.append(received.datagram)

    def on_report(self, report: Report) -> None:
        self.reports.append(report)

    def on_event(self, severity: Severity, text: str) -> None:
        self.events.append(text)


HELLO = Hello("r", "0", ((0.0, 0.0),), 0.5)


class Robot:
    """The other end: what came, and answers."""

    def __init__(self) -> None:
        self.links: list[LoopbackLink] = []
        self.refuse = False
        self.tried = 0
        self.greets = True

    def connect(self) -> Link:
        self.tried += 1
        if self.refuse:
            raise LinkError("cannot connect to robot:47100: connection refused")
        robot, station = loopback_pair()
        self.links.append(robot)
        if self.greets:
            self.send(HELLO)
        return station

    def received(self) -> list[NumberedCommand]:
        commands = []
        while (datagram := self.links[-1].receive(0.0)) is not None:
            message = Decoder().decode(datagram)
            assert isinstance(message, NumberedCommand)
            if not isinstance(message.command, Heartbeat):
                commands.append(message)
        return commands

    def send(self, report: Report) -> None:
        assert self.links[-1].send(encode(report))


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.fixture
def session(clock: ManualClock, heard: Heard, robot: Robot) -> Session:
    session = Session(SessionConfig(), clock, heard, first_number=100)
    session.connect(robot.connect)
    session.step()
    return session


def run(session: Session, clock: ManualClock, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        clock.advance(0.02)
        session.step()


def test_a_connected_session_passes_reports_on(session: Session, robot: Robot, heard: Heard) -> None:
    assert session.state is LinkState.CONNECTED
    robot.send(samples.telemetry())
    session.step()
    assert isinstance(heard.reports[-1], Telemetry)
    assert len(heard.datagrams) == 2


def test_a_command_is_repeated_with_its_number_until_it_is_answered(
    session: Session, robot: Robot, clock: ManualClock
) -> None:
    session.send(Start())
    run(session, clock, 0.9)
    sent = robot.received()
    assert len(sent) >= 2
    assert {m.number for m in sent} == {sent[0].number}
    robot.send(Ack(sent[0].number, True))
    run(session, clock, 1.0)
    assert robot.received() == []
    assert session.round_trip_s < 1.0


def test_a_refused_command_is_told_with_its_reason(session: Session, robot: Robot, heard: Heard) -> None:
    session.send(Start())
    session.step()
    robot.send(Ack(robot.received()[0].number, False, "the mission is running already"))
    session.step()
    assert heard.events[-1] == "the robot refused Start: the mission is running already"


def test_a_command_that_is_never_answered_is_given_up(
    session: Session, robot: Robot, heard: Heard, clock: ManualClock
) -> None:
    session.send(Start())
    for _ in range(8):
        run(session, clock, 0.5)
        robot.send(samples.telemetry())
    assert heard.events[-1] == "Start was not answered after 5 tries"
    assert len(robot.received()) == 5


def beats(robot: Robot) -> int:
    count = 0
    while (datagram := robot.links[-1].receive(0.0)) is not None:
        message = Decoder().decode(datagram)
        count += isinstance(message, NumberedCommand) and isinstance(message.command, Heartbeat)
    return count


def test_a_stop_is_repeated_until_it_is_answered_and_holds_the_heartbeat_back(
    session: Session, robot: Robot, clock: ManualClock
) -> None:
    run(session, clock, 0.5)
    beats(robot)
    session.send(Stop())
    for _ in range(8):
        run(session, clock, 0.5)
        robot.send(samples.telemetry())
    stops = robot.received()
    assert len(stops) >= 8
    assert {type(m.command) for m in stops} == {Stop}
    robot.send(Ack(stops[0].number, True))
    run(session, clock, 0.5)
    assert beats(robot) > 0


def test_a_stop_takes_the_place_of_every_order_that_waits(session: Session, robot: Robot, clock: ManualClock) -> None:
    session.send(Start())
    session.step()
    robot.received()
    session.send(EmergencyStop())
    run(session, clock, 1.5)
    assert {type(m.command) for m in robot.received()} == {EmergencyStop}


def test_a_stop_given_while_the_link_is_lost_is_the_first_thing_sent_when_it_is_back(
    session: Session, robot: Robot, clock: ManualClock
) -> None:
    robot.links[-1].close()
    session.step()
    assert session.state is LinkState.LOST
    assert session.send(EmergencyStop())
    run(session, clock, 1.0)
    assert session.state is LinkState.CONNECTED
    first = Decoder().decode(robot.links[-1].receive(0.0) or b"")
    assert isinstance(first, NumberedCommand)
    assert isinstance(first.command, EmergencyStop)


def test_a_command_that_does_not_fit_on_the_wire_is_refused_and_blocks_nothing(session: Session, robot: Robot) -> None:
    with pytest.raises(ValueError, match="NaN"):
        session.send(Drive(float("nan"), 0.0))
    with pytest.raises(ValueError, match="bytes"):
        session.send(GoTo(1, np.zeros((6000, 3), np.float32)))
    session.send(Stop())
    session.step()
    assert [type(m.command) for m in robot.received()] == [Stop]


def test_nobody_at_the_window_means_no_heartbeat(clock: ManualClock, heard: Heard, robot: Robot) -> None:
    there = [True]
    session = Session(SessionConfig(), clock, heard, 1, operator_is_there=lambda: there[0])
    session.connect(robot.connect)
    run(session, clock, 1.0)
    assert beats(robot) >= 5
    there[0] = False
    run(session, clock, 1.0)
    assert beats(robot) == 0


def test_an_emergency_stop_jumps_what_waits(session: Session, robot: Robot) -> None:
    session.send(Drive(0.1, 0.0))
    session.send(EmergencyStop())
    session.step()
    assert isinstance(robot.received()[0].command, EmergencyStop)


def test_heartbeats_keep_coming(session: Session, robot: Robot, clock: ManualClock) -> None:
    run(session, clock, 1.0)
    assert beats(robot) in {5, 6}


def test_a_silent_robot_is_a_lost_link_and_is_connected_to_again(
    session: Session, robot: Robot, heard: Heard, clock: ManualClock
) -> None:
    run(session, clock, 2.2)
    assert "link lost: no word from the robot" in heard.events[-1]
    run(session, clock, 1.0)
    assert session.state is LinkState.CONNECTED
    assert len(robot.links) == 2


def test_a_closed_link_is_told_with_what_was_not_answered(
    session: Session, robot: Robot, heard: Heard, clock: ManualClock
) -> None:
    session.send(Start())
    session.step()
    robot.refuse = True
    robot.links[-1].close()
    session.step()
    assert session.state is LinkState.LOST
    assert "not answered: Start" in heard.events[-1]
    assert not session.send(Start())


def test_a_refused_connection_is_tried_again_more_and_more_slowly(
    clock: ManualClock, heard: Heard, robot: Robot
) -> None:
    robot.refuse = True
    session = Session(SessionConfig(), clock, heard, 1)
    session.connect(robot.connect)
    tried = robot.tried
    run(session, clock, 20.0)
    assert 5 <= robot.tried - tried <= 9
    assert session.state is LinkState.CONNECTING
    assert len(heard.events) == 1, "the same fault is told once"
    robot.refuse = False
    run(session, clock, 5.0)
    assert session.state is LinkState.CONNECTED


def test_disconnecting_lets_go_of_the_link_and_does_not_come_back(
    session: Session, robot: Robot, clock: ManualClock
) -> None:
    session.disconnect()
    run(session, clock, 10.0)
    assert session.state is LinkState.DISCONNECTED
    assert not robot.links[-1].connected
    assert len(robot.links) == 1


def test_a_robot_of_another_version_is_named_once(session: Session, robot: Robot, heard: Heard) -> None:
    body = b"\x63" + encode(samples.telemetry())[1:-4]
    for _ in range(3):
        robot.links[-1].send(body + zlib.crc32(body).to_bytes(4, "little"))
        session.step()
    told = [e for e in heard.events if "version" in e]
    assert told == ["the robot speaks protocol version 99, this station 2: update the older one"]


def test_garbage_is_survived(session: Session, robot: Robot, heard: Heard, rng: np.random.Generator) -> None:
    for _ in range(200):
        robot.links[-1].send(rng.bytes(int(rng.integers(1, 200))))
        session.step()
    robot.send(samples.telemetry())
    session.step()
    assert isinstance(heard.reports[-1], Telemetry)


def test_a_port_that_says_nothing_is_not_connected(clock: ManualClock, heard: Heard, robot: Robot) -> None:
    robot.greets = False
    session = Session(SessionConfig(), clock, heard, 1)
    session.connect(robot.connect)
    run(session, clock, 15.0)
    assert session.state is LinkState.CONNECTING
    assert "connected" not in heard.events
    assert len(heard.events) == 1
    robot.greets = True
    run(session, clock, 6.0)
    assert heard.events[-1] == "connected"


def test_a_robot_that_is_busy_says_so(clock: ManualClock, heard: Heard, robot: Robot) -> None:
    robot.greets = False
    session = Session(SessionConfig(), clock, heard, 1)
    session.connect(robot.connect)
    session.step()
    robot.send(Refusal("another station is connected to it"))
    session.step()
    assert heard.events == ["the robot refuses: another station is connected to it. Trying again until it works."]
    assert session.state is LinkState.CONNECTING


def test_a_stop_given_while_connecting_is_the_first_thing_sent(clock: ManualClock, heard: Heard, robot: Robot) -> None:
    robot.refuse = True
    session = Session(SessionConfig(), clock, heard, 1)
    session.connect(robot.connect)
    session.step()
    assert session.send(EmergencyStop())
    robot.refuse = False
    run(session, clock, 1.0)
    first = Decoder().decode(robot.links[-1].receive(0.0) or b"")
    assert isinstance(first, NumberedCommand)
    assert isinstance(first.command, EmergencyStop)


def test_a_stop_outlives_a_disconnection_and_an_order_does_not(
    session: Session, robot: Robot, heard: Heard, clock: ManualClock
) -> None:
    session.send(Start())
    session.send(EmergencyStop())
    session.disconnect()
    session.step()
    assert "not confirmed the stop" in heard.events[-1]
    session.connect(robot.connect)
    run(session, clock, 0.3)
    assert {type(m.command) for m in robot.received()} == {EmergencyStop}


def test_a_stop_does_not_weaken_an_emergency_stop(session: Session, robot: Robot) -> None:
    session.send(EmergencyStop())
    session.send(Stop())
    session.step()
    assert [type(m.command) for m in robot.received()] == [EmergencyStop]


def test_a_word_from_a_link_that_was_let_go_does_not_count(session: Session, robot: Robot, clock: ManualClock) -> None:
    session.disconnect()
    session._heard()
    assert session.state is LinkState.DISCONNECTED


class OverLora:
    """A link that mends itself; what was sent, by lane."""

    mends_itself = True

    def __init__(self) -> None:
        self.statistics = LinkStatistics()
        self.events: deque[PathChanged] = deque()
        self.path = LinkPath.RADIO
        self.health = LinkHealth(wifi=False, lora=True, is_secret=True)
        self.connected = self.has_room = True
        self.resets = 0
        self.closed = False
        self.sent: list[tuple[Lane, int, NumberedCommand | KeyframeWanted]] = []
        self.incoming: deque[bytes | LinkError] = deque()

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        message = Decoder().decode(datagram if for_radio is None else for_radio())
        assert isinstance(message, NumberedCommand | KeyframeWanted)
        self.sent.append((lane, slot, message))
        return True

    def receive(self, timeout_s: float) -> bytes | None:
        if not self.incoming:
            return None
        first = self.incoming.popleft()
        if isinstance(first, LinkError):
            raise first
        return first

    def close(self) -> None:
        self.closed = True

    def on(self, lane: Lane) -> list[Command]:
        return [m.command for where, _, m in self.sent if where is lane and isinstance(m, NumberedCommand)]


@pytest.fixture
def lora() -> OverLora:
    return OverLora()


@pytest.fixture
def over_lora(clock: ManualClock, heard: Heard, lora: OverLora) -> Session:
    session = Session(SessionConfig(), clock, heard, first_number=100)
    session.connect(lambda: lora)
    lora.incoming.append(encode(HELLO))
    session.step()
    return session


def test_each_command_takes_the_lane_that_it_needs(over_lora: Session, lora: OverLora, clock: ManualClock) -> None:
    for command in (Start(), Drive(0.1, 0.0), Drive(0.2, 0.0)):
        over_lora.send(command)
    run(over_lora, clock, 0.5)
    over_lora.send(EmergencyStop())
    over_lora.step()
    assert lora.on(Lane.COMMAND) == [Start()]
    assert lora.on(Lane.NOW) == [EmergencyStop()]
    newest = lora.on(Lane.NEWEST)
    assert [c for c in newest if isinstance(c, Drive)] == [Drive(0.2, 0.0)], "only the newest turn of the wheel counts"
    assert any(isinstance(c, Heartbeat) for c in newest)


def test_over_lora_a_path_has_few_points_and_keeps_its_cusp(over_lora: Session, lora: OverLora) -> None:
    x = np.concatenate((np.linspace(0, 1, 26), np.linspace(0.96, 0.5, 12)))
    path = np.stack((x, np.zeros_like(x), np.zeros_like(x)), axis=1).astype(np.float32)
    over_lora.send(GoTo(1, path))
    over_lora.step()
    (sent,) = lora.on(Lane.COMMAND)
    assert isinstance(sent, GoTo)
    assert len(sent.path) < 22
    assert float(sent.path[:, 0].max()) == pytest.approx(1.0, abs=0.002)
    np.testing.assert_allclose(sent.path[-1], path[-1], atol=0.002)
    assert float(np.abs(np.diff(sent.path[:, 0])).max()) <= 0.102


def test_lora_repeats_by_itself_so_the_session_waits_longer(
    over_lora: Session, lora: OverLora, clock: ManualClock
) -> None:
    over_lora.send(Start())
    run(over_lora, clock, 1.9)
    assert len(lora.on(Lane.COMMAND)) == 1


def test_a_link_that_mends_itself_is_kept_when_it_is_lost(
    over_lora: Session, lora: OverLora, heard: Heard, clock: ManualClock
) -> None:
    lora.incoming.append(LinkError("neither Wi-Fi nor LoRa reaches the other side any more"))
    over_lora.step()
    assert over_lora.state is LinkState.LOST
    assert over_lora.send(EmergencyStop()), "a stop waits for it"
    run(over_lora, clock, 20.0)
    assert not lora.closed
    assert sum("lost" in e for e in heard.events) == 1
    lora.incoming.append(encode(HELLO))
    over_lora.step()
    assert over_lora.state is LinkState.CONNECTED
    assert EmergencyStop() in lora.on(Lane.NOW)


def test_silence_over_lora_is_told_once_and_later(over_lora: Session, heard: Heard, clock: ManualClock) -> None:
    run(over_lora, clock, 3.0)
    assert over_lora.state is LinkState.CONNECTED
    run(over_lora, clock, 10.0)
    assert over_lora.state is LinkState.LOST
    assert sum("no word from the robot" in e for e in heard.events) == 1


def test_a_robot_that_never_speaks_over_lora_is_told_once(clock: ManualClock, heard: Heard, lora: OverLora) -> None:
    session = Session(SessionConfig(), clock, heard, first_number=100)
    session.connect(lambda: lora)
    run(session, clock, 20.0)
    assert session.state is LinkState.CONNECTING
    (event,) = heard.events
    assert event.startswith("no word from the robot for 4 s. Is it on, with the same pairing file")
    for cause in ("spreading factor", "channels", "ids", "ports"):
        assert cause in event
    assert session.problem in event
    lora.incoming.append(encode(HELLO))
    run(session, clock, 1.0)
    assert session.problem == ""


def test_a_pairing_file_that_is_wrong_is_not_said_to_mend_itself(clock: ManualClock, heard: Heard) -> None:
    def connect() -> Link:
        raise PairingError("pairing.pem: others may read it; run `chmod 600 pairing.pem`")

    session = Session(SessionConfig(), clock, heard, first_number=100)
    session.connect(connect)
    run(session, clock, 20.0)
    (event,) = heard.events
    assert event.endswith("`chmod 600 pairing.pem`. Mend that: it connects by itself then.")


def test_a_link_that_is_not_wanted_any_more_holds_nobody_up(clock: ManualClock, heard: Heard, lora: OverLora) -> None:
    session = Session(SessionConfig(), clock, heard, first_number=100)

    def connect() -> Link:
        session.disconnect()
        return lora

    lora.close = session.disconnect  # type: ignore[method-assign] # takes the lock, as a button does
    session.connect(connect)
    worker = threading.Thread(target=session.step, daemon=True)
    worker.start()
    worker.join(5.0)
    assert not worker.is_alive()


def test_changes_of_the_path_are_told(over_lora: Session, lora: OverLora, heard: Heard) -> None:
    lora.events.append(PathChanged(1.0, LinkPath.WIFI, "Wi-Fi: it is steadily there; using Wi-Fi"))
    over_lora.step()
    assert heard.events[-1] == "Wi-Fi: it is steadily there; using Wi-Fi"
    assert over_lora.path is LinkPath.RADIO


def test_the_operator_is_told_how_the_radios_do(
    over_lora: Session, lora: OverLora, heard: Heard, clock: ManualClock
) -> None:
    good, silent = RadioHealth(True, -70.0), RadioHealth(False, math.nan)
    gone = RadioHealth(False, math.nan, "/dev/ttyUSB1: there is no such port")
    for radios in ((silent, gone), (good, gone), (good, gone), (silent, good)):
        lora.health = LinkHealth(lora=True, radios=radios)
        run(over_lora, clock, 1.0)
    told = [e for e in heard.events if e.startswith("radio")]
    assert told == [
        "radio B: /dev/ttyUSB1: there is no such port",
        "radio A: operates",
        "radio A: the module does not answer",
        "radio B: operates",
    ]


def test_observations_that_cannot_be_followed_make_it_want_a_keyframe(
    over_lora: Session, lora: OverLora, heard: Heard, clock: ManualClock, rng: np.random.Generator
) -> None:
    encoder = ObservationEncoder(lambda o: o)
    _, second, third = (encoder.encode(o).compact or b"" for o in drive(3, rng))
    lora.incoming.extend((second, third))
    run(over_lora, clock, 1.0)
    wanted = [m for _, _, m in lora.sent if isinstance(m, KeyframeWanted)]
    assert len(wanted) == 1
    encoder.reset()
    lora.incoming.append(encoder.encode(drive(4, rng)[3]).compact or b"")
    run(over_lora, clock, 5.0)
    assert len([m for _, _, m in lora.sent if isinstance(m, KeyframeWanted)]) == 1
    assert isinstance(heard.reports[-1], Observation)
