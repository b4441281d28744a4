"""The wires of a real drive on emulated outputs: what was on them, and how the simulated car drives by it.

The kernel's PWM is a folder and its two direction lines are a file, so that they stay as they are when the process that
has set them is gone. Whoever sets lines by the kernel's own call gets a library preloaded that finds the file.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_app.drivers.base import DriveSetting
from robot_app.drivers.config import DriveConfig
from shared.command_line import Refused
from tools.simulator.devices.gpio import GpioChip
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World

_SOURCE = Path(__file__).with_name("gpio_lines.c")
_LINES = "lines"
_BUILDS_WITHIN_S = 60.0
_STANDS_MPS = 0.01
_STANDS_FOR_S = 0.3
_STEP_S = 0.002


class WiredChip(GpioChip):
    """Its direction lines of the car's drive are in a file as well."""

    def __init__(self, folder: Path, config: DriveConfig) -> None:
        super().__init__()
        self._of_drive = config.forward_line, config.reverse_line
        self._file = os.open(folder / _LINES, os.O_RDWR | os.O_CREAT, 0o600)
        os.pwrite(self._file, b"00", 0)

    def set(self, line: int, level: int, lost: bool = False) -> None:
        """In the file too where the level is the one that it had, for somebody else may have set that."""
        super().set(line, level, lost)
        if line in self._of_drive:
            os.pwrite(self._file, b"1" if level else b"0", self._of_drive.index(line))


def let_kernel_calls_find(folder: Path) -> None:
    """For the processes that this one starts from now on."""
    os.environ |= {"LD_PRELOAD": str(_built(folder)), "GPIO_LINES": str(folder / _LINES)}


def _built(folder: Path) -> Path:
    compiler, library = shutil.which("cc"), folder / "gpio_lines.so"
    if compiler is None:
        raise Refused("the lines of the bridge need a C compiler: install gcc")
    command = [compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(_SOURCE)]
    subprocess.run(command, check=True, timeout=_BUILDS_WITHIN_S)
    return library


@dataclass(frozen=True, slots=True)
class Reading:
    """What was on the wires from `time_s` on."""

    time_s: float
    setting: DriveSetting


class Wires:
    """`folder`: that of the robot, with the PWM chip and the lines."""

    def __init__(self, folder: Path, config: DriveConfig) -> None:
        chip = folder / "pwmchip0"
        self._config = config
        self._motor = chip / f"pwm{config.motor_channel}" / "duty_cycle"
        self._servo = chip / f"pwm{config.servo_channel}" / "duty_cycle"
        self._lines = folder / _LINES

    def read(self) -> DriveSetting:
        c = self._config
        levels = self._lines.read_bytes()[:2]
        way = (levels == b"10") - (levels == b"01")
        steering_us = _number(self._servo) / 1000 - c.servo_centre_us - c.servo_trim_us
        return DriveSetting(way * _number(self._motor) * 1e-9 * c.motor_hz, steering_us / c.servo_us_per_rad)


def _number(file: Path) -> int:
    return int(file.read_text("ascii").split("\n")[0] or 0)


@dataclass(frozen=True, slots=True)
class Ride:
    """`driven_s`: since the fault the motor pushed along the way; `moved_s`: until the car stood."""

    speed_mps: float
    driven_s: float
    moved_s: float


def ride(readings: Sequence[Reading], began_s: float) -> Ride:
    """The simulated car set by what was on the wires, from standing; the fault struck at `began_s`."""
    world = World(find_scenario("lab"), 1)
    zero_s = readings[0].time_s
    waiting = list(readings)
    speed_mps = driven_s = moved_s = 0.0
    while waiting or world.elapsed_s + zero_s - began_s < moved_s + _STANDS_FOR_S:
        elapsed_s = world.elapsed_s + zero_s - began_s
        while waiting and waiting[0].time_s - began_s <= elapsed_s:
            world.set_drive(waiting.pop(0).setting)
        world.advance_to(world.time_s + _STEP_S)
        if elapsed_s <= 0:
            speed_mps = world.speed_mps()
            continue
        if moved_s == 0.0 or elapsed_s - moved_s <= _STANDS_FOR_S:
            if abs(world.speed_mps()) > _STANDS_MPS:
                moved_s = elapsed_s
            if world.motor_command_radps() * speed_mps > 0:
                driven_s = elapsed_s
    return Ride(speed_mps, driven_s, moved_s)


def watch(wires: Wires, until_s: float, now_s: Callable[[], float], rest: Callable[[], None]) -> list[Reading]:
    """What changes on them; `rest` is called after each look."""
    found: list[Reading] = []
    while (time_s := now_s()) < until_s:
        setting = wires.read()
        if not found or setting != found[-1].setting:
            found.append(Reading(time_s, setting))
        rest()
    return found
