"""The station's driver, the protocol, the real hex, serial wires, radio modules, the air, and back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from shared.link.base import LinkError
from shared.link.es920lr.core import Event, Heard
from shared.link.es920lr.driver import Es920lr
from shared.link.transceiver import Transceiver
from shared.runtime.clock import MonotonicClock
from tests.shared.link.radio_rig import ROBOT, STATION, Rig, operating
from tools.simulator.devices.mega_build import MegaFiles
from tools.simulator.devices.mega_radios import MegaRadios, VirtualTransceiver
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

PACKET = bytes(range(50))
PATIENCE_S = 20.0


class Station:
    """A robot's radio and the station's two, one of them on the robot's channel, behind the real firmware."""

    def __init__(self, files: MegaFiles) -> None:
        self.rig = Rig()
        self.robot = self.rig.driver(self.rig.module("robot"), ROBOT)
        self.modules = self.rig.module("station A"), self.rig.module("station B")
        self.transceiver = VirtualTransceiver(files, self.rig.clock, self.rig.timeline.run, self.modules)
        assert self.transceiver.wait_until_up(1.0)
        self.port = self.transceiver.radios[0]
        self.radio = Es920lr(self.port, STATION, self.rig.clock, reset=self.port.reset)
        self.radio.wait_until_operating(5.0)
        self.robot.wait_until_operating(5.0)

    def run(self, seconds: float) -> tuple[list[Event], list[Event]]:
        """What the robot's and the station's drivers tell in this time."""
        told: tuple[list[Event], list[Event]] = ([], [])
        until_s = self.rig.clock.now_s() + seconds
        while self.rig.clock.now_s() < until_s:
            told[0].extend(self.robot.poll(0.001))
            with contextlib.suppress(LinkError):
                told[1].extend(self.radio.poll(0.001))
        return told


@pytest.fixture
def station(mega_files: MegaFiles) -> Iterator[Station]:
    station = Station(mega_files)
    yield station
    station.transceiver.close()


def payloads(events: list[Event]) -> list[bytes]:
    return [event.payload for event in events if isinstance(event, Heard)]


def test_packets_cross_the_air_both_ways_through_the_firmware(station: Station) -> None:
    station.robot.submit(PACKET)
    _, heard = station.run(0.3)
    assert payloads(heard) == [PACKET]
    station.radio.submit(PACKET[::-1])
    heard, _ = station.run(0.3)
    assert payloads(heard) == [PACKET[::-1]]


def test_the_firmware_pulls_the_reset_pin_of_a_module(station: Station) -> None:
    assert station.modules[0].state.name == "OPERATION"
    station.port.reset(0.02)
    assert station.modules[0].state.name in {"BOOTING", "CONFIGURATION"}
    station.run(2.0)
    assert station.radio.operating


def test_a_module_that_lost_its_power_is_brought_up_again_through_the_firmware(station: Station) -> None:
    station.modules[0].power_off()
    station.run(0.5)
    station.modules[0].power_on()
    station.run(8.0)
    station.robot.submit(PACKET)
    _, heard = station.run(0.5)
    assert payloads(heard) == [PACKET]


@pytest.mark.parametrize("what", ["reset", "hang", "power_cycle"])
def test_a_mega_that_begins_anew_costs_only_what_was_under_way(station: Station, what: str) -> None:
    getattr(station.transceiver.mega, what)()
    station.run(3.0)
    station.robot.submit(PACKET)
    _, heard = station.run(0.5)
    assert payloads(heard) == [PACKET]
    assert station.transceiver.health.losses == 1


def test_by_the_walls_time_it_is_the_same(mega_files: MegaFiles) -> None:
    clock = MonotonicClock()
    timeline = Timeline(clock)
    rig = Rig()
    channel = RadioChannel(timeline, rig.channel._rng)
    rig.timeline, rig.channel = timeline, channel
    modules = [rig.module(name, operating(STATION)) for name in ("station A", "station B")]
    robot = rig.module("robot", operating(ROBOT))
    with (
        MegaRadios(mega_files, (modules[0], modules[1])) as megas,
        PtyRadios(clock, timeline, [robot], megas.wires) as air,
    ):
        megas.on_air = air.do
        transceiver = Transceiver(megas.mega.usb, clock, PATIENCE_S)
        transceiver.radios[0].write(bytes((50, *PACKET)))
        arrived = b""
        while b"\x02OK" not in arrived:
            some = transceiver.radios[0].read(PATIENCE_S)
            assert some, f"only {arrived!r} came"
            arrived += some
        transceiver.close()
