"""`simulator`: the simulated robot in real time. A station connects to it as to a robot."""

from __future__ import annotations

import argparse
import logging
import secrets
import sys
import threading
from dataclasses import replace
from pathlib import Path

from robot_app.app import RobotApp
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import DeviceError
from robot_app.link import OpenLink, open_link
from robot_app.mission_store import open_store
from robot_app.run import run_robot, stop_on_signals
from robot_app.service import ServiceManager
from shared.command_line import Parser, Refused, port_number, run, seed, set_up_logging
from shared.runtime.clock import MonotonicClock
from tools.simulator.drivers import RealTimePump, SimulatedHardware
from tools.simulator.parent import stop_with_parent
from tools.simulator.robots import with_robot
from tools.simulator.scenario import ROBOT_NAMES, Scenario, find_scenario, scenario_names
from tools.simulator.truth import write_truth
from tools.simulator.world import World

_log = logging.getLogger("simulator")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="simulator",
        description="A simulated robot in a simulated room, in real time: the same app as on the Raspberry Pi.",
        epilog="example: simulator --scenario lab --seed 1 &  station-gui --connect 127.0.0.1:47100",
    )
    parser.add_argument(
        "--scenario", default="lab", help=f"one of {', '.join(scenario_names())}, or a TOML file (default: lab)"
    )
    parser.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    parser.add_argument("--robot", choices=ROBOT_NAMES, help="which robot (default: that of --config, or car)")
    parser.add_argument("--config", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument(
        "--port", type=port_number, help="listen here instead of on the port in robot.toml; 0 takes a free one"
    )
    parser.add_argument("--bind", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write the ground truth here at the end")
    parser.add_argument(
        "--port-file", metavar="FILE", type=Path, help="write the port here once the robot is ready; 0 without Wi-Fi"
    )
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends, as when a parent dies")
    parser.add_argument("--verbose", action="store_true", help="log everything")
    return parser


def simulate(scenario: Scenario, config: AnyRobotConfig, args: argparse.Namespace, stop: threading.Event) -> None:
    """Run the robot until `stop` is set. The car stops first, then the threads, then the world."""
    clock = MonotonicClock()
    port = config.link.port if args.port is None else args.port
    opened = open_link(replace(config, link=replace(config.link, port=port, bind=args.bind)), clock)
    link = opened.link
    try:
        world = World(scenario, args.seed, start_s=clock.now_s())
        hardware = SimulatedHardware(world, waits=True).hardware
        store = open_store(config.mission.state_folder, None)
        app = RobotApp(hardware, link, clock, config, secrets.randbits(32), store)
        _log.info("compiling; this takes a while the first time")
        app.warm_up()
        pump = RealTimePump(world, clock)
        pump.start()
        try:
            run_robot(app, clock, stop, ServiceManager(None), lambda: _announce(scenario, opened, args))
        finally:
            pump.stop()
        if args.out is not None:
            write_truth(world, args.out)
        _log.info("%d collisions, %.1f m driven", world.collisions.count, world.truth.distance_m)
    finally:
        link.close()


def _announce(scenario: Scenario, opened: OpenLink, args: argparse.Namespace) -> None:
    _log.info("ready: %s, seed %d, listening on %s", scenario.name, args.seed, opened.where)
    if args.port_file is not None:
        args.port_file.write_text(f"{opened.port or 0}\n", "utf-8")


def _work(args: argparse.Namespace) -> int:
    scenario, config = with_robot(find_scenario(args.scenario), args.robot, args.config)
    for folder in (args.out, args.port_file.parent if args.port_file is not None else None):
        _make(folder)
    stop = stop_on_signals()
    if args.until_eof:
        stop_with_parent(stop)
    simulate(scenario, config, args, stop)
    return 0


def _make(folder: Path | None) -> None:
    try:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Refused(f"{folder}: cannot be made: {error.strerror}") from error


def main() -> int:
    args = _parser().parse_args()
    set_up_logging(args.verbose)
    return run("simulator", lambda: _work(args), also=(DeviceError,))


if __name__ == "__main__":
    sys.exit(main())
