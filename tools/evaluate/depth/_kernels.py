"""Reading a whole depth image and writing its cloud: the least that any extraction has to do."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F32 = NDArray[np.float32]


@njit(nogil=True, cache=True)
def back_project(
    depth: NDArray[np.uint16], unit_m: float, fx: float, fy: float, cx: float, cy: float, cloud_m: _F32
) -> None:
    """Reads every pixel of `depth` (H, W) and writes its point by the camera's equations: `cloud_m` (H, W, 3)."""
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z = depth[i, j] * unit_m
            cloud_m[i, j, 0] = (j + 0.5 - cx) * z / fx
            cloud_m[i, j, 1] = (i + 0.5 - cy) * z / fy
            cloud_m[i, j, 2] = z


@njit(nogil=True, cache=True)
def back_project_tabled(depth: NDArray[np.uint16], unit_m: float, slope_x: _F32, slope_y: _F32, cloud_m: _F32) -> None:
    """The same with the slopes of all columns and rows worked out beforehand."""
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z = np.float32(depth[i, j] * unit_m)
            cloud_m[i, j, 0] = slope_x[j] * z
            cloud_m[i, j, 1] = slope_y[i] * z
            cloud_m[i, j, 2] = z
