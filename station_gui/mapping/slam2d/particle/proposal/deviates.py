"""What particles are drawn with: normal deviates that stay alike over a short way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Deviates:
    """One Ornstein-Uhlenbeck process for each particle and direction of its match.

    Successive matches err alike, because they hang on the same walls and the same neighbouring scans. Particles that
    draw each step anew spoil the map that they are matched on, and their errors average out: they part slowly, into
    blurred copies of one path. Drawn alike over some metres their maps stay sharp and bend in different ways, as maps
    do that drift. A particle that is alone takes each match as it is: there is no other to be chosen instead.
    """

    def __init__(self, particles: int, alike_m: float) -> None:
        self._alike_m = alike_m
        self._now = np.zeros((particles, 3))

    def draw(self, rng: np.random.Generator, motion: FloatArray) -> FloatArray:
        """(N, 3): of mean 0 and, after some way, variance 1; `motion`: (3,), since the last draw. A radian is 1 m."""
        if len(self._now) == 1:
            return self._now
        way_m = float(np.hypot(motion[0], motion[1])) + abs(float(motion[2]))
        kept = math.exp(-way_m / self._alike_m)
        self._now = kept * self._now + math.sqrt(1.0 - kept * kept) * rng.standard_normal(self._now.shape)
        return self._now

    def adopt(self, parents: NDArray[np.int64]) -> None:
        """Particle i goes on as `parents[i]` would."""
        self._now = self._now[parents]
