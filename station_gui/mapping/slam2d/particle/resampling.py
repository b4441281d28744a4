"""Choosing which particles go on (Grisetti et al. 2007, section III-B; Kitagawa 1996)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Weights:
    """What the particles are worth, and how evenly that is spread.

    A step's factor counts with `independent_share` of its logarithm, the share of beams that say anything of their own
    (`UpdateConfig`).
    """

    def __init__(self, particles: int, independent_share: float, resample_share: float) -> None:
        self._independent_share = independent_share
        self._resample_share = resample_share
        self._log_weights = np.zeros(particles)  # since the last resampling
        self._log_evidence = np.zeros(particles)  # of the whole path
        self._resamplings = 0
        self._weighings = 0
        self._share_sum = 0.0

    @property
    def resamplings(self) -> int:
        return self._resamplings

    @property
    def effective_share(self) -> float:
        """Mean of the effective number at each weighing, as a share of the particles; 1 where there was none."""
        return self._share_sum / self._weighings if self._weighings else 1.0

    def weigh(self, log_factors: FloatArray) -> bool:
        """Multiplies each weight by the factor with this logarithm, (N,); True where the particles want resampling."""
        gained = self._independent_share * (log_factors - log_factors.max())
        self._log_weights += gained
        self._log_evidence += gained
        share = effective_number(normalised(self._log_weights)) / len(gained)
        self._weighings += 1
        self._share_sum += share
        return share < self._resample_share

    def parents(self, offset: float) -> NDArray[np.int64]:
        """(N,): see `systematic`. The children weigh the same."""
        parents = systematic(normalised(self._log_weights), offset)
        self._log_weights = np.zeros(len(parents))
        self._resamplings += 1
        return parents

    def best(self, among: NDArray[np.bool_] | None = None) -> int:
        """The particle whose whole path is the likeliest; `among`: (N,)."""
        return int(np.argmax(self._log_evidence if among is None else np.where(among, self._log_evidence, -np.inf)))

    def adopt(self, parents: NDArray[np.int64]) -> None:
        """Particle i becomes a copy of `parents[i]`."""
        self._log_weights = self._log_weights[parents]
        self._log_evidence = self._log_evidence[parents]


def normalised(log_weights: FloatArray) -> FloatArray:
    """(N,): weights that add up to one."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def effective_number(weights: FloatArray) -> float:
    """Eq. 20: of normalised weights, from 1 (one particle has all) to N (all have the same)."""
    return float(1.0 / np.square(weights).sum())


def systematic(weights: FloatArray, offset: float) -> NDArray[np.int64]:
    """(N,): the parent of each new particle, ascending.

    `offset` is uniform in [0, 1); a particle of weight w has N·w children in the mean, rounded up or down.
    """
    count = len(weights)
    bounds = np.cumsum(weights)
    bounds[-1] = max(1.0, bounds[-1])
    ticks = (np.arange(count) + offset) / count
    return np.searchsorted(bounds, ticks, side="right").astype(np.int64).clip(max=count - 1)
