"""Kernel: which floor a scanner sees."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.geometry.rays import cast_rays

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@njit(nogil=True, cache=True)
def look(
    scanners: Floats,
    beams_rad: Floats,
    segments_m: Floats,
    range_m: float,
    cell_m: float,
    directions_rad: Floats,
    ranges_m: Floats,
    seen: Bools,
) -> None:
    """Mark in `seen` (rows, columns) what the beams pass from `scanners` (N, 3), x, y, heading, room frame.

    `beams_rad` (B,) from the heading; `directions_rad` and `ranges_m` (B,) are room to work in.
    """
    rows, columns = seen.shape
    for n in range(len(scanners)):
        x0, y0 = scanners[n, 0], scanners[n, 1]
        for k in range(len(beams_rad)):
            directions_rad[k] = scanners[n, 2] + beams_rad[k]
        cast_rays(x0, y0, directions_rad, segments_m, range_m, ranges_m)
        for k in range(len(beams_rad)):
            last = range_m if math.isnan(ranges_m[k]) else ranges_m[k]
            ux = math.cos(directions_rad[k])
            uy = math.sin(directions_rad[k])
            walked = 0.0
            while walked < last:
                i = math.floor((y0 + walked * uy) / cell_m)
                j = math.floor((x0 + walked * ux) / cell_m)
                if 0 <= i < rows and 0 <= j < columns:
                    seen[i, j] = True
                walked += 0.5 * cell_m
