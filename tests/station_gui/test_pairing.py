"""The station speaks by the pairing file that its configuration names."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from shared.link.base import LinkError
from shared.link.pairing import read_pairing, write_new_pairing
from shared.link.radio_config import RadioConfig
from shared.link.tcp import TcpServerLink
from shared.runtime.clock import ManualClock
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
