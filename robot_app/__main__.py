"""`robot-app`: the robot on its Raspberry Pi. A station connects to it."""

from __future__ import annotations

import argparse
import logging
import os
import secrets
import sys
from contextlib import ExitStack
from dataclasses import replace
from itertools import chain
from pathlib import Path

from robot_app.app import RobotApp
from robot_app.calibrate.command import PROCEDURES, calibrate
from robot_app.calibrate.guide import Terminal
from robot_app.check import check_devices, check_radios, table_row
from robot_app.check_system import check_system
from robot_app.config import AnyRobotConfig, load_any_config
from robot_app.drivers.base import DeviceError
from robot_app.drivers.raspberry_pi import open_hardware
from robot_app.kernel_cache import compile_all
from robot_app.link import open_link
from robot_app.mission_store import open_store
from robot_app.real_time import ask_for_real_time, take_priority
from robot_app.run import run_robot, stop_on_signals
from robot_app.service import ServiceManager
from shared.command_line import EXIT_FAILED, EXIT_OK, Parser, Refused, port_number, run, set_up_logging
from shared.link.base import LinkError
from shared.link.pairing import read_pairing, write_new_pairing
from shared.runtime.clock import MonotonicClock

_log = logging.getLogger("robot-app")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="robot-app",
        description="Runs the robot: reads its devices, drives, and tells the station what it sees.",
        epilog="example: robot-app check, and when all devices are found: robot-app",
    )
    parser.add_argument(
        "command",
        nargs="?",
        choices=("check", "calibrate"),
        help="check: open each device and radio in turn, print what it says, and end; no wheel turns. "
        "calibrate: measure what is named next and write it into --config",
    )
    parser.add_argument(
        "what", nargs="?", choices=tuple(PROCEDURES), help="to calibrate; docs/robot.md tells the order"
    )
    parser.add_argument("--config", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument(
        "--port", type=port_number, help="listen here instead of on the port in robot.toml; 0 takes a free one"
    )
    parser.add_argument("--bind", metavar="ADDR", help="address to listen on instead of the one in robot.toml")
    parser.add_argument(
        "--new-pairing",
        metavar="FILE",
        type=Path,
        help="write a new pairing file, for link.pairing; copy it to the station",
    )
    parser.add_argument("--verbose", action="store_true", help="log everything")
    return parser


def _check(config: AnyRobotConfig) -> int:
    """A line for each thing as it is looked at; exit code 1 when one is missing or not in order."""
    missing = 0
    print(table_row(None), flush=True)  # noqa: T201 - the command's own words
    clock = MonotonicClock()
    radios = check_radios(config.radio, clock) if config.link.use != "tcp" else ()
    for finding in chain(check_devices(config.devices, config.body, clock), radios, check_system(config)):
        print(table_row(finding), flush=True)  # noqa: T201
        missing += not finding.found
    return EXIT_FAILED if missing else EXIT_OK


def _calibrate(config: AnyRobotConfig, args: argparse.Namespace) -> int:
    if args.what is None:
        raise Refused(f"calibrate what? One of {', '.join(PROCEDURES)}")
    clock = MonotonicClock()
    return EXIT_OK if calibrate(args.what, config, args.config, Terminal(clock), clock) else EXIT_FAILED


def _drive(config: AnyRobotConfig, args: argparse.Namespace) -> int:
    stop, clock = stop_on_signals(), MonotonicClock()
    bind = config.link.bind if args.bind is None else args.bind
    port = config.link.port if args.port is None else args.port
    config = replace(config, link=replace(config.link, bind=bind, port=port))
    with ExitStack() as opened:
        opened_link = open_link(config, clock)
        link = opened_link.link
        opened.callback(link.close)
        hardware = open_hardware(config.devices, config.body, clock)
        opened.callback(hardware.close)
        store = open_store(config.mission.state_folder, os.environ.get("STATE_DIRECTORY"))
        app = RobotApp(hardware, link, clock, config, secrets.randbits(32), store)
        _log.info("compiling; this takes a while the first time")
        compile_all(app.warm_up, os.environ.get("NUMBA_CACHE_DIR"))
        ask_for_real_time()
        service = ServiceManager(os.environ.get("NOTIFY_SOCKET"))
        run_robot(
            app, clock, stop, service, lambda: _log.info("ready: listening on %s", opened_link.where), take_priority
        )
    return EXIT_OK


def _new_pairing(path: Path) -> int:
    if path.exists():
        raise Refused(f"{path}: is there already; remove it first if the station shall need a new one too")
    write_new_pairing(path)
    print(f"{path}: {read_pairing(path).fingerprint}")  # noqa: T201 - the command's own words
    return EXIT_OK


def _work(args: argparse.Namespace) -> int:
    if args.new_pairing is not None:
        return _new_pairing(args.new_pairing.expanduser())
    if args.what is not None and args.command != "calibrate":
        raise Refused(f"{args.command} takes no {args.what}; it looks at everything")
    config = load_any_config(args.config)
    if args.command == "calibrate":
        return _calibrate(config, args)
    if args.command == "check":
        return _check(config)
    try:
        return _drive(config, args)
    except (DeviceError, LinkError) as error:  # not misuse: the service tries again, and the device may have come
        print(f"robot-app: {error}", file=sys.stderr)  # noqa: T201 - the command's own words
        return EXIT_FAILED


def main() -> int:
    args = _parser().parse_args()
    set_up_logging(args.verbose)
    return run("robot-app", lambda: _work(args))


if __name__ == "__main__":
    sys.exit(main())
