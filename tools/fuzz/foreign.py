"""What a stranger, a bad wire or an old recording makes of sound bytes."""

from __future__ import annotations

from collections import deque

import numpy as np

_REMEMBERED = 300


class Strangers:
    """Knows what was said lately."""

    def __init__(self, rng: np.random.Generator, longest_random: int) -> None:
        self._rng = rng
        self._longest = longest_random
        self._remembered: deque[bytes] = deque(maxlen=_REMEMBERED)

    def remember(self, sound: bytes) -> None:
        self._remembered.append(sound)

    def next(self, sound: bytes) -> bytes:
        """Random, mutated, truncated, replayed, or put together of two; `sound` has not been said yet."""
        rng = self._rng
        match rng.integers(6):
            case 0:
                return rng.bytes(int(rng.integers(0, self._longest)))
            case 1:
                return mutated(sound, rng)
            case 2:
                return sound[: rng.integers(len(sound))]
            case 3 if self._remembered:
                return self._remembered[int(rng.integers(len(self._remembered)))]
            case 4 if self._remembered:
                other = self._remembered[int(rng.integers(len(self._remembered)))]
                cut = int(rng.integers(len(sound)))
                return sound[:cut] + other[cut:]
            case _:
                return sound[:1] + rng.bytes(len(sound) - 1)


def mutated(sound: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes changed, or a stretch cut out, or said twice."""
    damaged = bytearray(sound)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(damaged)))
        match rng.integers(6):
            case 0:
                del damaged[at : at + int(rng.integers(1, 8))]
            case 1:
                damaged[at:at] = damaged[at : at + int(rng.integers(1, 8))]
            case _:
                damaged[at] ^= int(rng.integers(1, 256))
        if not damaged:
            break
    return bytes(damaged)
