"""Two or more emulated modules on a manual clock, for tests of the driver and of the modules."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.settings import BootMode, Format, RadioSettings
from shared.runtime.clock import ManualClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import EmulatedPort
from tools.simulator.radio.timeline import Timeline

LINK = RadioSettings(bandwidth_hz=500_000, acknowledge=False, show_rssi=True, show_sender=True, format=Format.BINARY)
ROBOT = dataclasses.replace(LINK, own_id=1, destination_id=2)
STATION = dataclasses.replace(LINK, own_id=2, destination_id=1)


def operating(settings: RadioSettings) -> RadioSettings:
    """The same as flash memory of a module that boots into operation."""
    return dataclasses.replace(settings, boot_mode=BootMode.OPERATION)


class Rig:
    """Modules by name; `port(name)` is the host's end of a serial line, whose reads move the clock."""

    def __init__(self, seed: int = 1, **air: Any) -> None:
        self.clock = ManualClock()
        self.timeline = Timeline(self.clock)
        self.channel = RadioChannel(self.timeline, np.random.default_rng(seed), **air)

    def module(
        self, name: str, flash: RadioSettings | None = None, position_m: tuple[float, float] = (0.0, 0.0)
    ) -> EmulatedEs920lr:
        module = EmulatedEs920lr(self.timeline, self.channel, name, flash, position_m)
        module.power_on()
        return module

    def port(self, module: EmulatedEs920lr) -> EmulatedPort:
        return EmulatedPort(module, self.timeline, self.clock)

    def driver(self, module: EmulatedEs920lr, settings: RadioSettings, with_reset: bool = False) -> Es920lr:
        return Es920lr(self.port(module), settings, self.clock, reset=module.reset if with_reset else None)

    def run(self, seconds: float) -> None:
        """Let time pass, event by event."""
        until_s = self.clock.now_s() + seconds
        while self.timeline.next_s < until_s:
            self.clock.advance_to(max(self.timeline.next_s, self.clock.now_s()))
            self.timeline.run()
        self.clock.advance_to(until_s)
        self.timeline.run()


def exchange(port: EmulatedPort, said: bytes, seconds: float = 0.3) -> bytes:
    """All that the module says within a stretch of time after it was told something."""
    port.write(said)
    return listen(port, seconds)


def listen(port: EmulatedPort, seconds: float) -> bytes:
    heard, clock = b"", port._clock
    assert clock is not None
    until_s = clock.now_s() + seconds
    while (left_s := until_s - clock.now_s()) > 0:
        heard += port.read(left_s)
    return heard
