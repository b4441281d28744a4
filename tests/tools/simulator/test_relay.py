from __future__ import annotations

import socket

import numpy as np
import pytest

from tools.simulator.relay import Relay, RelayTimes

PATIENCE_S = 20.0


def test_bytes_pass_both_ways_until_the_network_is_cut_and_again_afterwards() -> None:
    times = RelayTimes(there_s=(1e6, 1e6), away_s=(1e6, 1e6))
    with socket.create_server(("127.0.0.1", 0)) as server:
        relay = Relay(("127.0.0.1", 0), server.getsockname()[:2], np.random.default_rng(1), times)
        with socket.create_connection(("127.0.0.1", relay.port), PATIENCE_S) as station:
            robot, _ = server.accept()
            with robot:
                robot.settimeout(PATIENCE_S)
                station.sendall(b"up")
                assert robot.recv(10) == b"up"
                robot.sendall(b"down")
                assert station.recv(10) == b"down"
                relay._is_whole = False
                station.sendall(b"later")
                robot.settimeout(0.1)
                with pytest.raises(TimeoutError):
                    robot.recv(10)
                relay._is_whole = True
                robot.settimeout(PATIENCE_S)
                assert robot.recv(10) == b"later"
                station.shutdown(socket.SHUT_RDWR)
                assert robot.recv(10) == b""
        relay.close()
