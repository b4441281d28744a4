"""The robot app as a process of its own, its simulator in another; at the end it writes how it kept its schedule."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

from robot_app.app import RobotApp
from robot_app.config import RobotConfig, load_config
from robot_app.drivers.base import DeviceError
from robot_app.link import open_link
from robot_app.real_time import ask_for_real_time, take_priority
from robot_app.run import run_robot, stop_on_signals
from robot_app.service import ServiceManager
from shared.command_line import run, set_up_logging
from shared.runtime.runner import TaskHealth
from tools.evaluate.endurance.remote import RemoteSimulator, SharedClock
from tools.simulator.parent import stop_with_parent

_NICE = -10


def _figures(health: tuple[TaskHealth, ...], ran_s: float) -> dict[str, object]:
    rows = {
        h.row.name: {
            "rate_hz": h.row.rate_hz,
            "ticks": h.ticks,
            "skipped": h.skipped,
            "late": h.late,
            "latest_s": h.latest_s,
            "over_budget": h.over_budget,
            "longest_s": h.longest_s,
            "busy_s": h.busy_s,
        }
        for h in health
    }
    return {"ran_s": ran_s, "rows": rows, "nice": os.nice(0)}


def _work(args: argparse.Namespace) -> int:
    stop, start_s = stop_on_signals(), time.monotonic()
    clock = SharedClock(start_s)
    config = load_config(None)
    assert isinstance(config, RobotConfig)
    simulator = RemoteSimulator(args.scenario, args.seed, start_s)
    opened = open_link(replace(config, link=replace(config.link, port=0, bind="127.0.0.1")), clock)
    app = RobotApp(simulator.hardware, opened.link, clock, config, boot_id=1)
    app.warm_up()
    _go_first()
    ask_for_real_time()
    began_s = clock.now_s()

    def announce() -> None:
        nonlocal began_s
        began_s = clock.now_s()
        simulator.start()
        ready = {"port": opened.port or 0, "robot": os.getpid(), "simulator": simulator.process_id}
        args.says.write_text(json.dumps(ready) + "\n", "utf-8")

    stop_with_parent(stop)
    health = run_robot(app, clock, stop, ServiceManager(None), announce, take_priority)
    figures = _figures(health, clock.now_s() - began_s)
    args.figures.write_text(json.dumps({**figures, "simulator": simulator.close()}), "utf-8")
    opened.link.close()
    return 0


def _go_first() -> None:
    """As a service its tasks that drive have FIFO priority; this is what may be had without."""
    with contextlib.suppress(PermissionError):
        os.nice(_NICE)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="lab")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("figures", type=Path)
    parser.add_argument("says", type=Path)
    args = parser.parse_args()
    set_up_logging(verbose=False)
    return run("robot", lambda: _work(args), also=(DeviceError,))


if __name__ == "__main__":
    sys.exit(main())
