"""The emulated radios as a program of their own: `python -m tools.simulator.radio.network FILE`.

Two modules for the robot, and two behind the emulated transceiver for the station, at the settings that come with
`[radio]`. Their ports are written into FILE; the program ends when its standard input does.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from shared.command_line import EXIT_OK, Parser, Refused, run, seed, set_up_logging
from shared.link.radio_config import RadioConfig
from tools.simulator.devices.mega_build import MegaUnavailableError
from tools.simulator.parent import wait_for_parent
from tools.simulator.radio.live import LiveRadios


def _work(args: argparse.Namespace) -> int:
    try:
        radios = LiveRadios(RadioConfig().settings(0), args.seed)
    except MegaUnavailableError as error:
        raise Refused(f"no transceiver can be emulated: {error}") from error
    with radios:
        ports = {"robot": radios.robot_ports, "station": [f"{radios.station_port}:{letter}" for letter in "AB"]}
        args.file.write_text(f"{json.dumps(ports)}\n", "utf-8")
        wait_for_parent()
    return EXIT_OK


def main() -> int:
    parser = Parser(prog="network", description=__doc__)
    parser.add_argument("file", metavar="FILE", type=Path, help="write the ports here once the radios are there")
    parser.add_argument("--seed", type=seed, default=1, help="of the air (default: 1)")
    args = parser.parse_args()
    set_up_logging(verbose=False)
    return run("network", lambda: _work(args))


if __name__ == "__main__":
    sys.exit(main())
