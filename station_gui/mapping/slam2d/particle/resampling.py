"""Choosing which particles go on (Grisetti et al. 2007, section III-B; Kitagawa 1996)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
