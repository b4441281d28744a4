"""`radio-config`: sets up the ES920LR radio modules and measures what they carry."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from shared.command_line import Parser, number_in, run, set_up_logging, whole_number_in
from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES
from shared.link.es920lr.settings import BAUD_RATES, FACTORY_BAUD_RATE
from tools.radio_config import commands, key, range_commands
from tools.radio_config.changes import RULES, profile_names
from tools.radio_config.measure import SHORTEST_PAYLOAD_BYTES

_LONGEST_WAIT_S = 3_600
_EPILOG = """\
A PORT is a serial port (/dev/ttyUSB0), or one of the two radios of a transceiver (/dev/ttyACM0:A, /dev/ttyACM0:B).
A module that operates must be reset to be asked: the transceiver does it, elsewhere you are told when to switch its
power off and on. Afterwards it operates again.

  radio-config list
  radio-config set /dev/ttyUSB0 --profile fastest own_id=1 destination_id=2 --save
  radio-config copy /dev/ttyUSB0 /dev/ttyACM0:A /dev/ttyUSB1 /dev/ttyACM0:B --save
  radio-config check /dev/ttyUSB0 /dev/ttyACM0:A /dev/ttyUSB1 /dev/ttyACM0:B
"""


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="radio-config", description=__doc__, epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--verbose", action="store_true", help="log everything")
    sub = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    listing = _add(sub, "list", commands.list_ports, "list the serial ports")
    listing.add_argument("--profiles", action="store_true", help="list the profiles that come along instead")

    show = _add(sub, "show", commands.show, "show a module's settings")
    _add_ports(show, "port", None)

    change = _add(sub, "set", commands.set_values, "change settings")
    _add_ports(change, "port", None)
    change.add_argument("assignments", metavar="KEY=VALUE", nargs="*", help="as `show` names them")
    _add_profile(change)
    _add_writing(change)

    save = _add(sub, "save", commands.save, "write a module's settings to its flash memory")
    _add_ports(save, "port", None)

    load = _add(sub, "load", commands.load, "set what the factory has set")
    _add_ports(load, "port", None)
    load.add_argument("--save", action="store_true", help="write it to the flash memory")

    copy = _add(sub, "copy", commands.copy, "copy a module's settings to its partner, and to the second pair")
    _add_ports(copy, "source", None)
    copy.add_argument(
        "others", metavar="PORT", nargs="+", help="the partner; then, for two pairs, the second radio of each side"
    )
    copy.add_argument("--second-channel", type=int, metavar="N", help="of the second pair (default: the farthest)")
    _add_band(copy)
    _add_writing(copy)

    check = _add(sub, "check", commands.check, "check that modules agree; exit code 1 when they do not")
    _add_ports(check, "ports", "+")
    _add_band(check)

    reach = _add(sub, "range-test", range_commands.range_test, "measure strength and loss at each spreading factor")
    _add_ports(reach, "ports", "+")
    _add_test(reach)
    reach.add_argument("--count", type=whole_number_in(1, 10_000), default=20, help="packets each way (default: 20)")

    far = _add(sub, "echo", range_commands.echo_command, "be the far end of a range test: answer its packets")
    _add_ports(far, "port", None)
    _add_test(far)
    far.add_argument(
        "--seconds", type=number_in(0.1, 86_400), metavar="S", help="end by itself after this time (default: at Ctrl-C)"
    )

    air = _add(sub, "airtime", commands.airtime, "estimate airtime, packets a second and goodput; needs no module")
    air.add_argument("assignments", metavar="KEY=VALUE", nargs="*", help="as `show` names them")
    _add_profile(air)
    _add_key(sub)
    return parser


def _add_key(sub: argparse._SubParsersAction[Parser]) -> None:
    text = "make or show the pairing file, the same on robot and station: it keeps everybody else out"
    parser = sub.add_parser("key", help=text, description=text)
    kinds = parser.add_subparsers(dest="key_command", required=True, metavar="COMMAND")
    new = _add(kinds, "new", key.new, "make a new pairing file; then copy it to the other side (scp keeps its mode)")
    new.add_argument("--force", action="store_true", help="take the place of the one that is there")
    shown = _add(kinds, "show", key.show, "show its fingerprint: the same on both sides")
    for each in (new, shown):
        each.add_argument("file", type=Path, nargs="?", default=key.DEFAULT_FILE, help=f"(default: {key.DEFAULT_FILE})")


def _add(sub: argparse._SubParsersAction[Parser], name: str, work: commands.Work, text: str) -> argparse.ArgumentParser:
    parser = sub.add_parser(name, help=text, description=text)
    parser.set_defaults(work=work)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _add_ports(parser: argparse.ArgumentParser, name: str, count: int | str | None) -> None:
    parser.add_argument(name, metavar="PORT", nargs=count, help="for example /dev/ttyUSB0 or /dev/ttyACM0:A")
    parser.add_argument(
        "--baud",
        type=int,
        choices=BAUD_RATES,
        default=FACTORY_BAUD_RATE,
        help=f"rate to try first; the others are tried after it (default: {FACTORY_BAUD_RATE})",
    )
    parser.add_argument(
        "--wait",
        type=number_in(0, _LONGEST_WAIT_S),
        default=30.0,
        metavar="S",
        help="how long to wait for you to switch a module's power off and on (default: 30)",
    )


def _add_test(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sf", help="spreading factors (default: 7,8,9,10,11,12; with an echo the module's own)")
    parser.add_argument("--bandwidth-hz", type=int, help="instead of the first module's")
    payload = whole_number_in(SHORTEST_PAYLOAD_BYTES, MAX_PAYLOAD_BYTES)
    parser.add_argument("--payload", type=payload, default=20, help="bytes of a packet (default: 20)")
    parser.add_argument("--carrier-sense", choices=RULES, default="long", help="rule of the band (default: long)")


def _add_profile(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--profile", metavar="NAME", help=f"{', '.join(profile_names())}, or a TOML file")
    _add_band(parser)


def _add_band(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--payload", type=int, help="bytes of the longest packet (default: the profile's, or 50)")
    parser.add_argument(
        "--carrier-sense",
        choices=RULES,
        help="rule of the band: long allows 4 s, short 0.4 s and 360 s an hour (default: the profile's, or long)",
    )


def _add_writing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--save", action="store_true", help="write it to the flash memory too")
    parser.add_argument("--dry-run", action="store_true", help="say what would be changed, and change nothing")


def main() -> int:
    parser = _parser()
    args, rest = parser.parse_known_args()
    if strange := [text for text in rest if text.startswith("-") or "assignments" not in args]:
        parser.error(f"unrecognized arguments: {' '.join(strange)}")
    if rest:  # argparse gives up on KEY=VALUE where options stand between them
        args.assignments += rest
    set_up_logging(args.verbose)
    return run("radio-config", lambda: args.work(args))


if __name__ == "__main__":
    sys.exit(main())
