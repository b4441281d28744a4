"""Distances to upright boxes, and what of them a camera sees.

Boxes are rows of a (B, 8) array: the middle x, y, z, half the sides along the box's own x, its own y and z, cosine and
sine of its yaw.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F64 = NDArray[np.float64]
_PARALLEL = 1e-12


@njit(nogil=True, cache=True)
def _signed_distance(x: float, y: float, z: float, box: _F64) -> float:
    """To the faces of a box, negative inside of it."""
    dx, dy = x - box[0], y - box[1]
    qx = abs(box[6] * dx + box[7] * dy) - box[3]
    qy = abs(-box[7] * dx + box[6] * dy) - box[4]
    qz = abs(z - box[2]) - box[5]
    ox, oy, oz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    outside = math.sqrt(ox * ox + oy * oy + oz * oz)
    return float(outside + min(max(qx, qy, qz), 0.0))


@njit(nogil=True, cache=True)
def nearest_surface(points: _F64, boxes: _F64, distance: _F64, nearest: NDArray[np.int64]) -> None:
    """For each of `points` (N, 3) the signed `distance` (N,) to all boxes together, and the box of the nearest face."""
    for i in range(points.shape[0]):
        together, least = math.inf, math.inf
        for b in range(boxes.shape[0]):
            d = _signed_distance(points[i, 0], points[i, 1], points[i, 2], boxes[b])
            together = min(together, d)
            if abs(d) < least:
                least = abs(d)
                nearest[i] = b
        distance[i] = together


@njit(nogil=True, cache=True)
def _hides(box: _F64, from_x: float, from_y: float, from_z: float, to_x: float, to_y: float, to_z: float) -> bool:
    """Whether the way from one point to another leads through the box."""
    sx, sy = from_x - box[0], from_y - box[1]
    wx, wy = to_x - from_x, to_y - from_y
    low, high = 0.0, 1.0
    for axis in range(3):
        if axis == 0:
            start, step = box[6] * sx + box[7] * sy, box[6] * wx + box[7] * wy
        elif axis == 1:
            start, step = -box[7] * sx + box[6] * sy, -box[7] * wx + box[6] * wy
        else:
            start, step = from_z - box[2], to_z - from_z
        half = box[3 + axis]
        if abs(step) < _PARALLEL:
            if abs(start) >= half:
                return False
            continue
        first, second = (-half - start) / step, (half - start) / step
        low = max(low, min(first, second))
        high = min(high, max(first, second))
        if low >= high:
            return False
    return True


@njit(nogil=True, cache=True)
def seen_by_camera(points: _F64, cameras: _F64, lens: _F64, boxes: _F64, seen: NDArray[np.bool_]) -> None:
    """Which of `points` (N, 3) any of the `cameras` sees past the boxes.

    `cameras`: (V, 5): x, y, z, heading and pitch down. `lens`: tangents of half the field of view across and up, least
    and greatest depth.
    """
    count = cameras.shape[0]
    lucky = 0  # neighbours are mostly seen from the same place
    for i in range(points.shape[0]):
        seen[i] = False
        for k in range(count):
            v = (lucky + k) % count
            dx, dy, dz = points[i, 0] - cameras[v, 0], points[i, 1] - cameras[v, 1], points[i, 2] - cameras[v, 2]
            ch, sh = math.cos(cameras[v, 3]), math.sin(cameras[v, 3])
            cp, sp = math.cos(cameras[v, 4]), math.sin(cameras[v, 4])
            ahead, left = ch * dx + sh * dy, -sh * dx + ch * dy
            depth, up = cp * ahead - sp * dz, sp * ahead + cp * dz
            if depth < lens[2] or depth > lens[3] or abs(left) > lens[0] * depth or abs(up) > lens[1] * depth:
                continue
            hidden = False
            for b in range(boxes.shape[0]):
                if _hides(
                    boxes[b], cameras[v, 0], cameras[v, 1], cameras[v, 2], points[i, 0], points[i, 1], points[i, 2]
                ):
                    hidden = True
                    break
            if not hidden:
                seen[i] = True
                lucky = v
                break
