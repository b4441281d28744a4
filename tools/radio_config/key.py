"""`radio-config key`: the pairing file of robot and station."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path

from shared.command_line import EXIT_OK, Refused
from shared.link.pairing import Pairing, read_pairing

DEFAULT_FILE = Path("~/.config/low-bandwidth-mapper/pairing.pem")
_OPENSSL = (
    "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
    "-days", "36500", "-subj", "/CN=low-bandwidth-mapper", "-keyout", "-", "-out", "-",
)  # fmt: skip
_TIMEOUT_S = 30.0


def new(args: argparse.Namespace) -> int:
    """Raises `Refused` when there is a file already, or no openssl."""
    path = args.file.expanduser()
    if path.exists() and not args.force:
        raise Refused(f"{path}: is there already; --force takes a new key, and the other side needs the new file too")
    write_new_pairing(path)
    return _tell(read_pairing(path), args.json)


def show(args: argparse.Namespace) -> int:
    return _tell(read_pairing(args.file.expanduser()), args.json)


def write_new_pairing(path: Path) -> None:
    """A fresh key, readable by its owner alone. Raises `Refused` without openssl, `OSError` where it cannot be put."""
    try:
        made = subprocess.run(_OPENSSL, capture_output=True, check=True, timeout=_TIMEOUT_S).stdout
    except FileNotFoundError as error:
        raise Refused("there is no openssl program to make the key with; `sudo apt install openssl`") from error
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        raise Refused(f"openssl makes no key: {error}") from error
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.unlink(missing_ok=True)
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(made)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)


def _tell(pairing: Pairing, as_json: bool) -> int:
    if as_json:
        print(json.dumps({"file": str(pairing.path), "fingerprint": pairing.fingerprint}))
    else:
        print(f"{pairing.path}: {pairing.fingerprint}")
    return EXIT_OK
