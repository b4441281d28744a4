"""The robot app with its real drive on an emulated PWM and a guardian of flesh and blood, to be killed and hung.

SIGUSR1: the control task hangs. SIGUSR2, SIGRTMIN: the time of day jumps an hour ahead, back.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from robot_app.app import RobotApp
from robot_app.config import RobotConfig, load_config
from robot_app.drivers.ackermann_drive import AckermannDrive
from robot_app.drivers.base import DeviceError, Drive, Setting
from robot_app.drivers.config import DriveConfig
from robot_app.link import open_link
from robot_app.mission_store import MissionStore
from robot_app.run import run_robot, stop_on_signals
from robot_app.service import ServiceManager
from shared.command_line import run, set_up_logging
from shared.runtime.runner import Task
from tools.evaluate.endurance.remote import RemoteSimulator, SharedClock
from tools.evaluate.faults.wires import WiredChip, let_kernel_calls_find
from tools.simulator.devices.pwm import PwmFolder
from tools.simulator.parent import stop_with_parent

_HOUR_S = 3600.0


class _Both:
    """The simulated car drives as the wires of the real drive say."""

    def __init__(self, real: Drive, simulated: Drive) -> None:
        self._real = real
        self._simulated = simulated

    def set(self, setting: Setting) -> Setting:
        return self._simulated.set(self._real.set(setting))

    def stop(self) -> None:
        self._real.stop()
        self._simulated.stop()

    def close(self) -> None:
        self._real.close()
        self._simulated.close()


class _HangingApp(RobotApp):
    def tasks(self) -> list[Task]:
        hangs = threading.Event()
        signal.signal(signal.SIGUSR1, lambda *_: hangs.set())

        def hanging(step: Callable[[], None]) -> Callable[[], None]:
            def stepped() -> None:
                while hangs.is_set():
                    time.sleep(1.0)
                step()

            return stepped

        return [Task(t.row, hanging(t.step)) if t.row.name == "control" else t for t in super().tasks()]


def _jump(seconds: float) -> None:
    now_s, now_ns = time.time, time.time_ns
    time.time = lambda: now_s() + seconds
    time.time_ns = lambda: now_ns() + int(seconds * 1e9)


def _work(folder: Path, says: Path) -> int:
    stop, start_s = stop_on_signals(), time.monotonic()
    signal.signal(signal.SIGUSR2, lambda *_: _jump(_HOUR_S))
    signal.signal(signal.SIGRTMIN, lambda *_: _jump(-_HOUR_S))
    clock, config = SharedClock(start_s), load_config(None)
    assert isinstance(config, RobotConfig)
    wires = DriveConfig(pwm_chip=str(PwmFolder(folder).path))
    gpiod = WiredChip(folder, wires).library()
    sys.modules.update({"gpiod": gpiod, "gpiod.line": gpiod.line})  # type: ignore[dict-item]
    simulator = RemoteSimulator("lab", 1, start_s)
    let_kernel_calls_find(folder)
    drive = AckermannDrive(wires, config.car, clock)
    hardware = replace(simulator.hardware, drive=_Both(drive, simulator.hardware.drive))
    opened = open_link(replace(config, link=replace(config.link, port=0, bind="127.0.0.1")), clock)
    app = _HangingApp(hardware, opened.link, clock, config, 1, MissionStore(folder))
    app.warm_up()

    def announce() -> None:
        simulator.start()
        says.write_text(json.dumps({"port": opened.port or 0, "robot": os.getpid()}) + "\n", "utf-8")

    stop_with_parent(stop)
    run_robot(app, clock, stop, ServiceManager(None), announce)
    simulator.close()
    opened.link.close()
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("says", type=Path)
    args = parser.parse_args()
    set_up_logging(verbose=False)
    return run("robot", lambda: _work(args.folder, args.says), also=(DeviceError,))


if __name__ == "__main__":
    sys.exit(main())
