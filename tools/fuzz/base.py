"""What is fuzzed, and how it is judged: offered so many bytes in its own process, watched for time and memory."""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

_WARM_UP_SHARE = 0.2  # all bounded memories are full by then
_READINGS = 8
_BARELY = 2**20
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
MOST_GROWTH_BYTES = 4 * _BARELY  # what the allocator may hold on to; a byte for each foreign one would be twice that


class FuzzError(Exception):
    """A bound was broken, or what is sound was not taken any more."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """`foreign`: portions that nobody had sent. `forgeries`: of them, taken for the other side's."""

    foreign: int
    forgeries: int
    sound: int  # taken, of those that were said in between
    refused: int  # of the sound ones


class Target(Protocol):
    """What is called by one name in the table."""

    def throw(self) -> int:
        """A round of foreign bytes, and something sound in between; how many bytes that were."""
        ...

    def verdict(self) -> Verdict:
        """At the end. Raises `FuzzError` when what is sound is not taken any more."""
        ...


MakeTarget = Callable[[np.random.Generator], Target]


@dataclass(frozen=True, slots=True)
class Outcome:
    """`slowest_s`: the longest round. `grown_bytes`: of the process, from a fifth of the bytes to all of them."""

    offered_bytes: int
    took_s: float
    slowest_s: float
    grown_bytes: int
    verdict: Verdict

    @property
    def passed(self) -> bool:
        return self.verdict.forgeries == self.verdict.refused == 0 and self.grown_bytes <= MOST_GROWTH_BYTES


def fuzz(target: Target, total_bytes: int, tell: Callable[[int], None] = lambda _: None) -> Outcome:
    """`tell` is called with the bytes so far after each round. Raises what the target raises."""
    began_s = time.monotonic()
    offered, slowest_s = 0, 0.0
    warm = next_reading = int(_WARM_UP_SHARE * total_bytes)
    first = most = 0
    while offered < total_bytes:
        round_s = time.monotonic()
        offered += target.throw()
        slowest_s = max(slowest_s, time.monotonic() - round_s)
        tell(offered)
        if offered >= next_reading:
            next_reading += max(1, (total_bytes - warm) // _READINGS)
            held = resident_bytes()
            first, most = first or held, held
    return Outcome(offered, time.monotonic() - began_s, slowest_s, max(0, most - first), target.verdict())


def resident_bytes() -> int:
    """Of this process, without what the allocators could give back."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * _PAGE_BYTES


def require(holds: bool, complaint: str) -> None:
    """Raises `FuzzError`."""
    if not holds:
        raise FuzzError(complaint)
