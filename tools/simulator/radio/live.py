"""Two pairs of modules by the wall's time: the robot's on pseudo-terminals, the station's behind the real firmware.

with LiveRadios(link_settings(), seed) as radios:
    radios.robot_ports, radios.station_port     what robot.toml and station.toml are told
    radios.pull_plug()                          what may happen to them
"""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
from contextlib import ExitStack
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.devices.mega import MegaError
from tools.simulator.devices.mega_build import MegaUnavailableError, build_mega
from tools.simulator.devices.mega_radios import MegaRadios
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.pair_rig import CHANNELS
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

_APART_M = 5.0
_END_S = 5.0


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


class LiveRadiosProcess:
    """`LiveRadios` in a process of its own: nobody's computations hold up the air. It ends with its maker."""

    def __init__(self, settings: RadioSettings, seed: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(settings, seed, theirs), daemon=True)
        self._process.start()
        theirs.close()
        self.robot_ports, self.station_port = self._answer()

    def __enter__(self) -> LiveRadiosProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._process.join(_END_S)
        self._process.kill()

    def do(self, action: str, *values: int) -> None:
        """A method of `LiveRadios`."""
        self._pipe.send((action, values))
        self._answer()

    def _answer(self) -> Any:
        """Raises `MegaUnavailableError` or `MegaError` as `LiveRadios` did."""
        try:
            said = self._pipe.recv()
        except EOFError as error:
            raise MegaError("the emulated radios have ended") from error
        if isinstance(said, Exception):
            raise said
        return said


def _serve(settings: RadioSettings, seed: int, pipe: Connection) -> None:
    try:
        with LiveRadios(settings, seed) as radios, contextlib.suppress(EOFError):
            pipe.send((radios.robot_ports, radios.station_port))
            while True:
                action, values = pipe.recv()
                getattr(radios, action)(*values)
                pipe.send(None)
    except (MegaError, MegaUnavailableError) as error:
        pipe.send(error)
