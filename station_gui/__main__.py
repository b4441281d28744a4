"""`station-gui`: the operator's window."""

from __future__ import annotations

import argparse
import os
import secrets
import sys
from dataclasses import replace
from pathlib import Path

from shared.command_line import Parser, Refused, address, existing_file, run, set_up_logging
from station_gui.comms.target import Target
from station_gui.config import RecordingConfig, load_config
from station_gui.mapping.saved_map import MapFileError, read_map
from station_gui.model.station import Station


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="station-gui",
        description="The operator's window: connects to a robot, shows its live 2D and 3D map, commands it.",
        epilog="example: station-gui --connect 192.168.1.20:47100",
    )
    parser.add_argument("--connect", metavar="HOST:PORT", type=address, help="connect to this robot at once")
    parser.add_argument(
        "--radio",
        metavar="PORT",
        nargs="+",
        help="connect over LoRa at these ports, beside --connect for when Wi-Fi fails; "
        "for example /dev/ttyACM0:A /dev/ttyACM0:B",
    )
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="settings instead of the station.toml that comes along"
    )
    parser.add_argument("--recordings", metavar="DIR", help="where missions are recorded; '' records nothing")
    parser.add_argument("--map", metavar="FILE", type=existing_file, help="begin with this map and go on mapping in it")
    parser.add_argument("--localise", action="store_true", help="only localise in the --map; it is not changed")
    parser.add_argument("--verbose", action="store_true", help="log everything")
    return parser


def _work(args: argparse.Namespace) -> int:
    config = load_config(args.config)
    if args.recordings is not None:
        config = replace(config, recording=RecordingConfig(args.recordings))
    if sys.platform == "linux" and not any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    ):
        raise Refused("there is no display; start it on a desktop, or with: xvfb-run -a station-gui")
    if args.localise and args.map is None:
        raise Refused("--localise needs the --map to localise in")
    if args.map is not None:
        read_map(args.map)  # a file that is no map is refused before the window opens

    def when_open(station: Station, _: object) -> None:
        if args.map is not None:
            station.open_map(args.map, localise=args.localise)

    from station_gui.app import run_window  # noqa: PLC0415 - Qt is loaded only once a window can open

    host, port = args.connect or ("", 0)
    target = Target(host, port, tuple(args.radio or ()))
    return run_window(config, secrets.randbits(31), target if str(target) else None, when_open)


def main() -> int:
    args = _parser().parse_args()
    set_up_logging(args.verbose)
    return run("station-gui", lambda: _work(args), also=(MapFileError,))


if __name__ == "__main__":
    sys.exit(main())
