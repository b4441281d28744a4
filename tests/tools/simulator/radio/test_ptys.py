"""Modules at pseudo-terminals in real time: the driver, the serial port and the air, as with real ones."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np
import pytest

from shared.link.base import LinkError
from shared.link.es920lr.core import Event, Lost, Ready, Sent
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import Heard
from shared.link.serial_port import SerialPort
from shared.runtime.clock import MonotonicClock
from tests.shared.link.radio_rig import ROBOT, STATION, operating
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

PATIENCE_S = 20.0


class Desk:
    """Two modules that operate, each with its driver on a serial port."""

    def __init__(self) -> None:
        self.clock = MonotonicClock()
        timeline = Timeline(self.clock)
        self.channel = RadioChannel(timeline, np.random.default_rng(3))
        self.modules = [
            EmulatedEs920lr(timeline, self.channel, name, operating(settings))
            for name, settings in (("robot", ROBOT), ("station", STATION))
        ]
        self.radios = PtyRadios(self.clock, timeline, self.modules)
        self.drivers = [
            Es920lr(SerialPort(path, 115_200), settings, self.clock)
            for path, settings in zip(self.radios.paths, (ROBOT, STATION), strict=True)
        ]

    def close(self) -> None:
        for driver in self.drivers:
            with contextlib.suppress(LinkError):
                driver.close()
        self.radios.close()

    def until(self, driver: Es920lr, kind: type[Event]) -> Event:
        until_s = self.clock.now_s() + PATIENCE_S
        while self.clock.now_s() < until_s:
            for event in driver.poll(0.1):
                if isinstance(event, kind):
                    return event
        raise AssertionError(f"no {kind.__name__}")


@pytest.fixture
def desk() -> Iterator[Desk]:
    made = Desk()
    yield made
    made.close()


def test_packets_go_both_ways(desk: Desk) -> None:
    robot, station = desk.drivers
    for driver in desk.drivers:
        driver.wait_until_operating(PATIENCE_S)
    for sender, receiver in ((robot, station), (station, robot)):
        handle = sender.submit(bytes(range(50)))
        assert desk.until(sender, Sent) == Sent(handle or 0)
        heard = desk.until(receiver, Heard)
        assert isinstance(heard, Heard)
        assert heard.payload == bytes(range(50))


def test_a_module_that_was_without_power_is_back_by_itself(desk: Desk) -> None:
    robot = desk.drivers[0]
    robot.wait_until_operating(PATIENCE_S)
    desk.radios.do(desk.modules[0].power_off)
    desk.radios.do(desk.modules[0].power_on)
    desk.until(robot, Lost)
    if not robot.operating:
        desk.until(robot, Ready)
    assert robot.submit(b"back") is not None
    desk.until(robot, Sent)


def test_a_pulled_plug_is_an_error_and_leaves_the_others_alone(desk: Desk) -> None:
    desk.radios.unplug(0)
    with pytest.raises(LinkError, match="Is the cable still plugged in"):
        desk.drivers[0].wait_until_operating(PATIENCE_S)
    desk.drivers[1].wait_until_operating(PATIENCE_S)
