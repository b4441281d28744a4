"""The station speaks by the pairing file that its configuration names."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from shared.link.base import LinkError
from shared.link.pairing import read_pairing
from shared.link.tcp import TcpServerLink
from shared.runtime.clock import ManualClock
from station_gui.build import _connect_tcp
from tools.radio_config.key import write_new_pairing


def test_a_missing_pairing_file_is_named_when_connecting(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="radio-config key new"):
        _connect_tcp("127.0.0.1", 1, 0.1, str(tmp_path / "pairing.pem"))


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
    station = _connect_tcp("127.0.0.1", robot.port, 5.0, str(path))
    assert station.connected
    station.close()
    stop.set()
    thread.join(5.0)
    robot.close()
