"""Two pairs of modules by the wall's time: the robot's on pseudo-terminals, the station's behind the real firmware.

with LiveRadios(link_settings(), seed) as radios:
    radios.robot_ports, radios.station_port     what robot.toml and station.toml are told
    radios.pull_plug()                          what may happen to them
"""

from __future__ import annotations

import dataclasses
from contextlib import ExitStack

import numpy as np

from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.devices.mega_build import build_mega
from tools.simulator.devices.mega_radios import MegaRadios
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.pair_rig import CHANNELS
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

_APART_M = 5.0


class LiveRadios:
    """Raises `MegaUnavailableError` or `MegaError` where the Mega cannot be emulated."""

    def __init__(self, settings: RadioSettings, seed: int) -> None:
        clock = MonotonicClock()
        self._timeline = Timeline(clock)
        self._channel = RadioChannel(self._timeline, np.random.default_rng(seed))
        robots = [self._module("robot", i, settings, own=1, to=2) for i in range(2)]
        self._station = tuple(self._module("station", i, settings, own=2, to=1) for i in range(2))
        with ExitStack() as stack:
            radios = stack.enter_context(MegaRadios(build_mega(), (self._station[0], self._station[1])))
            self._air = stack.enter_context(PtyRadios(clock, self._timeline, robots, radios.wires))
            radios.on_air = self._air.do
            self.mega = radios.mega
            self.robot_ports = tuple(self._air.paths[: len(robots)])
            self.station_port = radios.mega.usb
            self._stack = stack.pop_all()

    def __enter__(self) -> LiveRadios:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def packets(self) -> int:
        """That have been on air so far."""
        return self._channel.statistics.packets

    def pull_plug(self) -> None:
        self.mega.unplug()

    def plug_in(self) -> None:
        self.mega.plug()

    def reset_mega(self) -> None:
        self.mega.reset()

    def switch_off(self, radio: int) -> None:
        """One of the station's modules loses its power."""
        self._air.do(self._station[radio].power_off)

    def switch_on(self, radio: int) -> None:
        self._air.do(self._station[radio].power_on)

    def _module(self, name: str, pair: int, settings: RadioSettings, own: int, to: int) -> EmulatedEs920lr:
        flash = dataclasses.replace(
            settings, channel=CHANNELS[pair], own_id=own + 2 * pair, destination_id=to + 2 * pair
        )
        position_m = (0.0, 0.0 if own == 1 else _APART_M)
        return EmulatedEs920lr(self._timeline, self._channel, f"{name} {pair}", flash, position_m)
