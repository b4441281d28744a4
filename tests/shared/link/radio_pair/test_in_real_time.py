"""The threads of a radio pair, by the wall's time, on pseudo-terminals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
import pytest

from shared.link.base import Lane
from shared.link.es920lr.driver import Es920lr
from shared.link.radio_pair.link import RadioPair, robot_radios, station_radios
from shared.link.radio_pair.pump import OpenRadio
from shared.link.serial_port import SerialPort
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.pair_rig import link_settings
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

SETTINGS = link_settings()
Ends = tuple[RadioPair, RadioPair]


def opener(path: str, clock: MonotonicClock) -> OpenRadio:
    return lambda: Es920lr(SerialPort(path, SETTINGS.baud_rate), SETTINGS, clock)


@pytest.fixture
def ends() -> Iterator[Ends]:
    clock = MonotonicClock()
    timeline = Timeline(clock)
    air = RadioChannel(timeline, np.random.default_rng(1))
    modules = [
        EmulatedEs920lr(
            timeline,
            air,
            f"{side} {pair}",
            dataclasses.replace(SETTINGS, channel=1 + 4 * pair, own_id=own + 2 * pair, destination_id=to + 2 * pair),
            (0.0, 0.0),
        )
        for side, own, to in (("robot", 1, 2), ("station", 2, 1))
        for pair in (0, 1)
    ]
    with PtyRadios(clock, timeline, modules) as radios:
        openers = [opener(path, clock) for path in radios.paths]
        robot = robot_radios(openers[:2], SETTINGS, bytes(32), clock)
        station = station_radios(openers[2:], SETTINGS, bytes(32), clock)
        yield robot, station
        robot.close()
        station.close()


def test_datagrams_of_all_lanes_cross_both_ways(ends: Ends) -> None:
    robot, station = ends
    for _ in range(600):
        if robot.connected and station.connected:
            break
        robot.receive(0.05)
    sent = [bytes([i]) * 40 for i in range(12)]
    assert all(robot.send(datagram) for datagram in sent)
    assert station.send(b"go there", Lane.COMMAND)
    assert station.send(b"stop", Lane.NOW)
    assert [station.receive(10.0) for _ in sent] == sent
    assert {robot.receive(10.0), robot.receive(10.0)} == {b"go there", b"stop"}
    assert all(robot.operating + station.operating)
    assert not math.isnan(station.rssi_dbm[0])
