"""A straight line with a face, and where along it something stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BIN_M = 0.10  # along a wall
BIN_POINTS = 4  # that fill a bin


@dataclass(frozen=True, slots=True, eq=False)
class WallLine:
    """Points p with normal · p = rho; `along` is the normal turned by -90 degrees."""

    normal: FloatArray
    rho_m: float

    @property
    def along(self) -> FloatArray:
        return np.array([self.normal[1], -self.normal[0]])

    def across_m(self, points_m: FloatArray) -> FloatArray:
        return np.asarray(points_m @ self.normal - self.rho_m)


def total_least_squares(points_m: FloatArray, facing: FloatArray) -> WallLine:
    """Through (N, 2) points, facing where `facing` (2,) does."""
    middle = points_m.mean(axis=0)
    normal = np.linalg.eigh(np.cov((points_m - middle).T))[1][:, 0]
    normal = normal * (1.0 if normal @ facing >= 0 else -1.0)
    return WallLine(normal, float(normal @ middle))
