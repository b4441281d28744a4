"""`radio-config key`: the pairing file of robot and station."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from shared.command_line import EXIT_OK, Refused
from shared.link.pairing import Pairing, read_pairing, write_new_pairing
from tools.radio_config.session import say

DEFAULT_FILE = Path("~/.config/low-bandwidth-mapper/pairing.pem")


def new(args: argparse.Namespace) -> int:
    """Raises `Refused` when there is a file already."""
    path = args.file.expanduser()
    if path.exists() and not args.force:
        raise Refused(f"{path}: is there already; --force takes a new key, and the other side needs the new file too")
    write_new_pairing(path)
    say("Copy it to the other side, and name it on both: [link] pairing of robot.toml, pairing of station.toml.")
    return _tell(read_pairing(path), args.json)


def show(args: argparse.Namespace) -> int:
    return _tell(read_pairing(args.file.expanduser()), args.json)


def _tell(pairing: Pairing, as_json: bool) -> int:
    if as_json:
        print(json.dumps({"file": str(pairing.path), "fingerprint": pairing.fingerprint}))
    else:
        print(f"{pairing.path}: {pairing.fingerprint}")
    return EXIT_OK
