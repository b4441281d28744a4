"""Are the codec's states the same on another machine, bit for bit?

    python -m tools.codec_states write FOLDER LOG...     encodes logs, on one machine
    python -m tools.codec_states read FILE...            decodes them, on any: numpy and numba are enough
    python -m tools.codec_states again FILE...           decodes, encodes what came out and writes that beside it

Each prints SHA-256 over all that every state holds and over all observations; where they agree, so do the machines.
`read` says nothing about `write`'s log, `again` lets the other machine encode: its files are then read on the first.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import platform
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from shared.command_line import EXIT_FAILED, EXIT_OK, Parser, existing_file, run
from shared.messages import Observation
from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import Encoder

_SUFFIX = ".datagrams"
_AGAIN = ".again"


class _Digest:
    """Of datagrams that are decoded one after the other."""

    def __init__(self) -> None:
        self.decoder = Decoder()
        self.count = self.bytes = 0
        self._states, self._observations = hashlib.sha256(), hashlib.sha256()

    def take(self, datagram: bytes) -> Observation:
        observation = self.decoder.decode(datagram)
        if observation is None:
            raise ValueError(f"datagram {self.count} was refused: {self.decoder.counts}")
        self.count += 1
        self.bytes += len(datagram)
        _add(self._states, next(reversed(self.decoder._states.values())))  # noqa: SLF001 - what it holds is the point
        _add(self._observations, observation)
        return observation

    def __str__(self) -> str:
        states, observations = self._states.hexdigest()[:32], self._observations.hexdigest()[:32]
        return f"{self.count} observations, {self.bytes} bytes, states {states}, observations {observations}"


def _add(digest: Any, value: Any) -> None:
    """Everything that is in it, to the last bit."""
    if isinstance(value, np.ndarray):
        digest.update(value.tobytes())
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            _add(digest, getattr(value, field.name))
    elif isinstance(value, float):
        digest.update(struct.pack("<d", value))
    else:
        digest.update(repr(value).encode())


def _write(folder: Path, logs: list[Path]) -> None:
    from tools.evaluate.link.codec import observations_of  # noqa: PLC0415 - what reads logs is not on every machine

    folder.mkdir(parents=True, exist_ok=True)
    for log in logs:
        name, observations = observations_of(log)
        print(encode_to(observations, folder / f"{name}{_SUFFIX}"), flush=True)


def encode_to(observations: list[Observation], file: Path) -> str:
    """What there is to say of it."""
    encoder, digest = Encoder(in_order=True), _Digest()
    with file.open("wb") as out:
        for observation in observations:
            datagram = encoder.encode(observation).datagram
            out.write(struct.pack("<I", len(datagram)) + datagram)
            digest.take(datagram)
    return f"{file.name}: {digest}"


def read(file: Path) -> tuple[list[Observation], str]:
    """The observations, and what there is to say of them. Raises `ValueError` when a datagram is refused."""
    digest = _Digest()
    observations = [digest.take(datagram) for datagram in _datagrams(file)]
    return observations, f"{file.name}: {digest}"


def _datagrams(file: Path) -> Iterator[bytes]:
    data, at = file.read_bytes(), 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        yield data[at + 4 : at + 4 + length]
        at += 4 + length


def main() -> int:
    parser = Parser(prog="codec_states", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    write = commands.add_parser("write")
    write.add_argument("folder", type=Path)
    write.add_argument("files", nargs="+", type=existing_file)
    for name in ("read", "again"):
        commands.add_parser(name).add_argument("files", nargs="+", type=existing_file)
    args = parser.parse_args()
    return run("codec_states", lambda: _run(args))


def _run(args: argparse.Namespace) -> int:
    began_s = time.monotonic()
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}")
    try:
        if args.command == "write":
            _write(args.folder, args.files)
        for file in args.files if args.command != "write" else ():
            observations, said = read(file)
            print(said, flush=True)
            if args.command == "again":
                print(encode_to(observations, file.with_name(f"{file.stem}{_AGAIN}{_SUFFIX}")), flush=True)
    except ValueError as error:
        print(error)
        return EXIT_FAILED
    print(f"{time.monotonic() - began_s:.0f} s")
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
