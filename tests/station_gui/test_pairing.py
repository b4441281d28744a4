"""The station speaks by the pairing file that its configuration names."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from robot_app.config import LinkConfig, load_config
from robot_app.link import open_link
from robot_app.uplink import Uplink
from shared.link.base import Lane, LinkError
from shared.link.pairing import read_pairing, write_new_pairing
from shared.link.radio_config import LinkUse, RadioConfig
from shared.link.tcp import TcpServerLink
from shared.messages import Ack, Command, Hello, NumberedCommand, Start
from shared.protocol.codec import Decoder, encode
from shared.runtime.clock import ManualClock, MonotonicClock
from station_gui.comms.connect import Connector
from station_gui.comms.target import Target


def test_a_missing_pairing_file_is_named_when_connecting(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="radio-config key new"):
        Connector(ManualClock(), 0.1, str(tmp_path / "pairing.pem"), RadioConfig())(Target("127.0.0.1", 1))


def test_lora_without_a_pairing_file_is_refused_with_what_to_do() -> None:
    with pytest.raises(LinkError, match=r"radio-config key new.*station\.toml"):
        Connector(ManualClock(), 0.1, "", RadioConfig())(Target(radio_ports=("/dev/ttyACM0:A",)))


def test_with_the_robots_file_it_is_let_in(tmp_path: Path) -> None:
    path = tmp_path / "pairing.pem"
    write_new_pairing(path)
    robot = TcpServerLink("127.0.0.1", 0, ManualClock(), pairing=read_pairing(path))
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            robot.receive(0.02)

    thread = threading.Thread(target=serve)
    thread.start()
    station = Connector(ManualClock(), 5.0, str(path), RadioConfig())(Target("127.0.0.1", robot.port))
    assert station.connected
    station.close()
    stop.set()
    thread.join(5.0)
    robot.close()


class Robot:
    """Greets, and carries out whatever it is told."""

    def __init__(self, pairing: Path, use: LinkUse) -> None:
        self.handled: list[Command] = []
        self._clock = MonotonicClock()
        link = LinkConfig(use, 0, "127.0.0.1", str(pairing))
        config = replace(load_config(None), link=link, radio=RadioConfig(("/dev/no-such-port",)))
        self._opened = open_link(config, self._clock)
        self._uplink = Uplink(self._opened.link, Hello("r", "0", ((0.0, 0.0),), 0.5), lambda o: o)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def target(self) -> Target:
        return Target("127.0.0.1", self._opened.port or 0)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self._opened.link.close()

    def _run(self) -> None:
        while not self._clock.wait(self._stop, self._clock.now_s() + 0.005):
            self._uplink.receive(self._clock.now_s(), self._handle, lambda: None, lambda: None)
            self._uplink.greet(self._clock.now_s())

    def _handle(self, command: Command) -> tuple[bool, str]:
        self.handled.append(command)
        return True, ""


@pytest.mark.parametrize("use", ["tcp", "both"])
def test_without_radios_it_speaks_with_either_kind_of_robot(tmp_path: Path, use: LinkUse) -> None:
    path = tmp_path / "pairing.pem"
    write_new_pairing(path)
    robot = Robot(path, use)
    station = Connector(MonotonicClock(), 5.0, str(path), RadioConfig())(robot.target)
    assert station.mends_itself == (use == "both")
    came: list[object] = []
    for _ in range(500):
        if (datagram := station.receive(0.01)) is not None:
            came.append(Decoder().decode(datagram))
            station.send(encode(NumberedCommand(7, Start())), Lane.COMMAND)
        if len(came) > 1:
            break
    assert [type(message) for message in came] == [Hello, Ack]
    assert robot.handled == [Start()]
    assert station.health.is_secret
    assert station.health.lora is None
    station.close()
    robot.close()


def test_a_robot_without_radios_is_spoken_with_over_wifi_although_both_are_chosen(tmp_path: Path) -> None:
    path = tmp_path / "pairing.pem"
    write_new_pairing(path)
    robot = Robot(path, "tcp")
    connect = Connector(MonotonicClock(), 5.0, str(path), RadioConfig())
    both = replace(robot.target, radio_ports=("/dev/no-such-port",))
    failover = connect(both)
    with pytest.raises(LinkError, match="Wi-Fi alone"):
        for _ in range(500):
            failover.receive(0.01)
    assert not failover.mends_itself
    failover.close()
    station = connect(both)
    greeting = station.receive(2.0)
    assert greeting is not None
    assert isinstance(Decoder().decode(greeting), Hello)
    station.close()
    robot.close()
