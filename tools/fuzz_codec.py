"""Throw bytes at the decoder of profile COMPACT: random, mutated, truncated, replayed, between sound ones.

`python -m tools.fuzz_codec LOG --bytes 10000000`. It must take every sound datagram and nothing else.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tracemalloc
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from shared.command_line import EXIT_FAILED, EXIT_OK, existing_file, seed
from shared.messages import Observation
from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import Encoder
from tools.evaluate.link.codec import recorded, thinned
from tools.logs.urg import UrgReader

_REMEMBERED = 300
_FOREIGN_TO_A_SOUND_ONE = 20


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz_codec", description=__doc__)
    parser.add_argument("log", type=existing_file, help="URG-04LX log or mission (.mcap) that sound datagrams are of")
    parser.add_argument("--bytes", type=int, default=1_000_000, help="to throw (default: a million)")
    parser.add_argument("--seed", type=seed, default=1)
    args = parser.parse_args()
    forged, refused, counts = fuzz(_observations(args.log), args.bytes, np.random.default_rng(args.seed))
    print(f"forged {forged}, sound ones refused {refused}; {counts}")
    return EXIT_FAILED if forged or refused else EXIT_OK


def _observations(log: Path) -> list[Observation]:
    return recorded(log) if log.suffix == ".mcap" else [thinned(o) for o in UrgReader(log)]


def fuzz(observations: list[Observation], total: int, rng: np.random.Generator) -> tuple[int, int, str]:
    """How many foreign datagrams were believed, how many sound ones were not, and the decoder's counts."""
    encoder, decoder = Encoder(), Decoder()
    remembered: deque[bytes] = deque([b"\x80\0\0"], maxlen=_REMEMBERED)
    offered = forged = refused = 0
    size_bytes = 0
    tracemalloc.start()
    for turn, observation in enumerate(_endless(observations)):
        sound = encoder.encode(observation).datagram
        for _ in range(_FOREIGN_TO_A_SOUND_ONE):
            data = _foreign(sound, remembered, rng)
            offered += len(data)
            forged += decoder.decode(data) is not None and data != sound
        refused += decoder.decode(sound) is None
        encoder.acknowledge(rng.bytes(3))
        encoder.acknowledge(decoder.feedback())
        remembered.append(sound)
        if turn == _REMEMBERED:
            size_bytes = tracemalloc.get_traced_memory()[0]
        if offered >= total:
            break
    grown_bytes = tracemalloc.get_traced_memory()[0] - size_bytes if size_bytes else 0
    tracemalloc.stop()
    return forged, refused, f"{decoder.counts}, {offered} bytes, memory grew by {grown_bytes}"


def _endless(observations: list[Observation]) -> Iterator[Observation]:
    """Over and over, numbered on."""
    for sequence, observation in enumerate(itertools.cycle(observations)):
        yield replace(observation, sequence=sequence)


def _foreign(sound: bytes, remembered: deque[bytes], rng: np.random.Generator) -> bytes:
    match rng.integers(5):
        case 0:
            return rng.bytes(int(rng.integers(0, 120)))
        case 1:
            damaged = bytearray(sound)
            for _ in range(int(rng.integers(1, 5))):
                damaged[rng.integers(len(damaged))] ^= int(rng.integers(1, 256))
            return bytes(damaged) if bytes(damaged) != sound else b""
        case 2:
            return sound[: rng.integers(len(sound))]
        case 3:
            return remembered[int(rng.integers(len(remembered)))]
        case _:
            other = remembered[int(rng.integers(len(remembered)))]
            cut = int(rng.integers(1, len(sound)))
            spliced = sound[:cut] + other[cut:]
            return spliced if spliced != sound else b""


if __name__ == "__main__":
    sys.exit(main())
