"""Kernels of the fused edges.

An edge is a row of `ends_m` (N, 2, 3), map frame. Upright ones go from below to above, level ones have one height.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

_SAMPLES = 8  # points of an edge that are looked at:
_IN_VIEW = 3  # so many have to be in the image, of a tall edge only the lower part may be,
_UNHIDDEN = 0.8  # and this share of them not hidden
_SCAN_SLACK_M = 0.10
_THROUGH_M = 0.20
_THROUGH_SIDE_M = 0.04
_THROUGH_FAR_M = 2.0
_THROUGH_BEAMS = 2


@njit(nogil=True, cache=True)
def _upright_gap_m(piece_m: F64, edge_m: F64, reach_m: float, gap_m: float) -> float:
    across = math.hypot(
        0.5 * (piece_m[0, 0] + piece_m[1, 0] - edge_m[0, 0] - edge_m[1, 0]),
        0.5 * (piece_m[0, 1] + piece_m[1, 1] - edge_m[0, 1] - edge_m[1, 1]),
    )
    along = max(piece_m[0, 2] - edge_m[1, 2], edge_m[0, 2] - piece_m[1, 2])
    if across > reach_m or along > gap_m:
        return math.inf
    return float(across + 0.1 * max(along, 0.0))


@njit(nogil=True, cache=True)
def _level_gap_m(piece_m: F64, edge_m: F64, reach_m: float, rise_m: float, gap_m: float, turn_rad: float) -> float:
    rise = abs(0.5 * (piece_m[0, 2] + piece_m[1, 2] - edge_m[0, 2] - edge_m[1, 2]))
    if rise > rise_m:
        return math.inf
    ux, uy = edge_m[1, 0] - edge_m[0, 0], edge_m[1, 1] - edge_m[0, 1]
    vx, vy = piece_m[1, 0] - piece_m[0, 0], piece_m[1, 1] - piece_m[0, 1]
    length, own = math.hypot(ux, uy), math.hypot(vx, vy)
    if length <= 0.0 or own <= 0.0:
        return math.inf
    # A short piece's direction is uncertain by its own noise.
    sine = abs(ux * vy - uy * vx) / (length * own)
    if sine > math.sin(turn_rad) + 0.5 * reach_m / max(min(length, own), reach_m):
        return math.inf
    if own > length:
        offset, low, high = _across(edge_m, piece_m)
        other = own
    else:
        offset, low, high = _across(piece_m, edge_m)
        other = length
    gap = max(low - other, -high)
    if offset > reach_m or gap > gap_m:
        return math.inf
    return float(offset + rise + 0.1 * max(gap, 0.0))


@njit(nogil=True, cache=True)
def _across(piece_m: F64, line_m: F64) -> tuple[float, float, float]:
    """The farther end's offset from a line, and where along it the piece begins and ends."""
    ux, uy = line_m[1, 0] - line_m[0, 0], line_m[1, 1] - line_m[0, 1]
    length = math.hypot(ux, uy)
    ux, uy = ux / length, uy / length
    ax, ay = piece_m[0, 0] - line_m[0, 0], piece_m[0, 1] - line_m[0, 1]
    bx, by = piece_m[1, 0] - line_m[0, 0], piece_m[1, 1] - line_m[0, 1]
    offset = max(abs(ux * ay - uy * ax), abs(ux * by - uy * bx))
    first, last = ux * ax + uy * ay, ux * bx + uy * by
    return offset, min(first, last), max(first, last)


@njit(nogil=True, cache=True)
def best_match(
    piece_m: F64,
    upright: int,
    ends_m: F64,
    kinds: U8,
    count: int,
    but: int,
    reach_m: float,
    rise_m: float,
    gap_m: float,
    turn_rad: float,
) -> int:
    """The edge of the same kind that a piece, (2, 3), belongs to; -1 for none. `but` is left out."""
    best, least = -1, math.inf
    for i in range(count):
        if kinds[i] != upright or i == but:
            continue
        if upright == 1:
            gap = _upright_gap_m(piece_m, ends_m[i], reach_m, gap_m)
        else:
            gap = _level_gap_m(piece_m, ends_m[i], reach_m, rise_m, gap_m, turn_rad)
        if gap < least:
            best, least = i, gap
    return best


@njit(nogil=True, cache=True)
def supported_extreme(values: F64, weights: F64, cut: F64, count: int, near: float, need: int) -> float:
    """The greatest value that is not alone.

    An end that the image's border cut (`cut` above 0) only says that the edge goes at least so far. Free ends count
    when `need` of them lie within `near`; their mean is the end, unless cut ones go beyond it.
    """
    free = -math.inf
    best = -math.inf
    for i in range(count):
        if cut[i] > 0.0 or values[i] <= best:
            continue
        found, weight, total = 0, 0.0, 0.0
        for j in range(count):
            if cut[j] == 0.0 and values[i] - near <= values[j] <= values[i]:
                found += 1
                weight += weights[j]
                total += weights[j] * values[j]
        if found >= need:
            best, free = values[i], total / weight
    reached = _at_least(values, count, need)
    return reached if reached > free + near else free


@njit(nogil=True, cache=True)
def _at_least(values: F64, count: int, need: int) -> float:
    """The `need`-th greatest value."""
    answer = -math.inf
    for i in range(count):
        above = 0
        for j in range(count):
            if values[j] > values[i] or (values[j] == values[i] and j < i):
                above += 1
        if above == need - 1:
            answer = values[i]
    return answer


@njit(nogil=True, cache=True)
def fuse_upright(
    pieces_m: F64, weights: F64, cut: F64, count: int, reach_m: float, near: float, work: F64, out: F64
) -> None:
    """One upright edge of `count` views, (K, 2, 3): mean place without outliers, and its ends. `work`: (3, K)."""
    x, y = _middle(pieces_m, weights, count, math.inf, 0.0, 0.0)
    for _ in range(3):
        x, y = _middle(pieces_m, weights, count, reach_m, x, y)
    need = min(2, count)
    for i in range(count):
        work[0, i] = pieces_m[i, 1, 2]
        work[1, i] = -pieces_m[i, 0, 2]
    out[0, 0] = out[1, 0] = x
    out[0, 1] = out[1, 1] = y
    out[1, 2] = supported_extreme(work[0], weights, cut[:, 1], count, near, need)
    out[0, 2] = -supported_extreme(work[1], weights, cut[:, 0], count, near, need)


@njit(nogil=True, cache=True)
def _middle(pieces_m: F64, weights: F64, count: int, reach_m: float, x: float, y: float) -> tuple[float, float]:
    """Weighted mean place of the views within `reach_m` of (x, y), or of all where there is none."""
    sum_w, sum_x, sum_y = 0.0, 0.0, 0.0
    all_w, all_x, all_y = 0.0, 0.0, 0.0
    for i in range(count):
        px = 0.5 * (pieces_m[i, 0, 0] + pieces_m[i, 1, 0])
        py = 0.5 * (pieces_m[i, 0, 1] + pieces_m[i, 1, 1])
        w = weights[i]
        all_w, all_x, all_y = all_w + w, all_x + w * px, all_y + w * py
        if math.hypot(px - x, py - y) <= reach_m:
            sum_w, sum_x, sum_y = sum_w + w, sum_x + w * px, sum_y + w * py
    if sum_w > 0.0:
        return sum_x / sum_w, sum_y / sum_w
    return all_x / all_w, all_y / all_w


@njit(nogil=True, cache=True)
def fuse_level(pieces_m: F64, weights: F64, cut: F64, count: int, near: float, work: F64, out: F64) -> None:
    """One level edge of `count` views: total least squares of their ends, weighted by length; `work`: (3, K)."""
    sum_w, mx, my, mz = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        own = math.hypot(pieces_m[i, 1, 0] - pieces_m[i, 0, 0], pieces_m[i, 1, 1] - pieces_m[i, 0, 1])
        w = weights[i] * own
        work[2, i] = w
        sum_w += w
        mx += 0.5 * w * (pieces_m[i, 0, 0] + pieces_m[i, 1, 0])
        my += 0.5 * w * (pieces_m[i, 0, 1] + pieces_m[i, 1, 1])
        mz += 0.5 * w * (pieces_m[i, 0, 2] + pieces_m[i, 1, 2])
    mx, my, mz = mx / sum_w, my / sum_w, mz / sum_w
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(count):
        for k in range(2):
            dx, dy = pieces_m[i, k, 0] - mx, pieces_m[i, k, 1] - my
            xx += work[2, i] * dx * dx
            xy += work[2, i] * dx * dy
            yy += work[2, i] * dy * dy
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    ux, uy = math.cos(angle), math.sin(angle)
    need = min(2, count)
    for sign in range(2):
        s = 1.0 if sign == 0 else -1.0
        for i in range(count):
            a = s * (ux * (pieces_m[i, 0, 0] - mx) + uy * (pieces_m[i, 0, 1] - my))
            b = s * (ux * (pieces_m[i, 1, 0] - mx) + uy * (pieces_m[i, 1, 1] - my))
            work[0, i] = max(a, b)
            work[1, i] = cut[i, 0] if a > b else cut[i, 1]
        t = s * supported_extreme(work[0], weights, work[1], count, near, need)
        out[1 - sign, 0], out[1 - sign, 1], out[1 - sign, 2] = mx + t * ux, my + t * uy, mz


@njit(nogil=True, cache=True)
def in_view(x: float, y: float, z: float, camera: F64) -> bool:
    """Whether a point, robot frame, is in the middle of the image.

    `camera`: x_m, z_m, pitch_down_rad, half of the view's width and height as tangents, near_m, far_m, rim.
    """
    dx, dz = x - camera[0], z - camera[1]
    c, s = math.cos(camera[2]), math.sin(camera[2])
    depth, up = c * dx - s * dz, s * dx + c * dz
    if depth < camera[5] or depth > camera[6]:
        return False
    inside: bool = abs(y) <= camera[7] * camera[3] * depth and abs(up) <= camera[7] * camera[4] * depth
    return inside


@njit(nogil=True, cache=True)
def _nearest_echo_m(
    bearing: float, half_rad: float, ranges_m: F64, first_rad: float, step_rad: float
) -> tuple[float, int]:
    """The shortest range of the beams within `half_rad` of a bearing, and how many there are; NaN where one is lost."""
    low = math.ceil((bearing - half_rad - first_rad) / step_rad)
    high = math.floor((bearing + half_rad - first_rad) / step_rad)
    nearest = math.inf
    if low < 0 or high >= len(ranges_m) or high < low:
        return math.nan, 0
    for i in range(low, high + 1):
        if math.isnan(ranges_m[i]):
            return math.nan, high - low + 1
        nearest = min(nearest, ranges_m[i])
    return nearest, high - low + 1


@njit(nogil=True, cache=True)
def judge(
    ends_m: F64,
    kinds: U8,
    count: int,
    pose: F64,
    camera: F64,
    scanner: F64,
    ranges_m: F64,
    first_rad: float,
    step_rad: float,
    scan_height_m: float,
    verdict: U8,
) -> None:
    """What one look says of each edge that it did not see: 0 nothing, 1 it should have been seen, 2 looked through.

    `pose`: (3,) map_from_robot; `scanner`: (3,) robot_from_scanner; `camera` as of `in_view`. An edge is in view when
    the camera could see it and the scan reached as far: what hides it from the scanner hides it from the camera too,
    or may.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(count):
        verdict[i] = 0
        far = math.hypot(ends_m[i, 0, 0] - pose[0], ends_m[i, 0, 1] - pose[1])
        if far > camera[6] + 3.0:
            continue
        inside, seen = 0, 0
        for k in range(_SAMPLES):
            t = (k + 0.5) / _SAMPLES
            mx = ends_m[i, 0, 0] + t * (ends_m[i, 1, 0] - ends_m[i, 0, 0]) - pose[0]
            my = ends_m[i, 0, 1] + t * (ends_m[i, 1, 1] - ends_m[i, 0, 1]) - pose[1]
            z = ends_m[i, 0, 2] + t * (ends_m[i, 1, 2] - ends_m[i, 0, 2])
            x, y = c * mx + s * my, -s * mx + c * my
            if not in_view(x, y, z, camera):
                continue
            inside += 1
            away = math.hypot(x - scanner[0], y - scanner[1])
            bearing = math.atan2(y - scanner[1], x - scanner[0]) - scanner[2]
            echo, beams = _nearest_echo_m(bearing, 1.5 * step_rad, ranges_m, first_rad, step_rad)
            seen += 1 if beams > 0 and echo > away - _SCAN_SLACK_M else 0
        if inside >= _IN_VIEW and seen >= _UNHIDDEN * inside:
            verdict[i] = 1
        if kinds[i] == 1 and ends_m[i, 0, 2] < 0.5 * scan_height_m and ends_m[i, 1, 2] > 1.5 * scan_height_m:
            mx, my = ends_m[i, 0, 0] - pose[0], ends_m[i, 0, 1] - pose[1]
            x, y = c * mx + s * my - scanner[0], -s * mx + c * my - scanner[1]
            away = math.hypot(x, y)
            if 0.2 < away < _THROUGH_FAR_M:
                half = max(math.atan2(_THROUGH_SIDE_M, away), 1.5 * step_rad)
                echo, beams = _nearest_echo_m(math.atan2(y, x) - scanner[2], half, ranges_m, first_rad, step_rad)
                if beams >= _THROUGH_BEAMS and echo > away + _THROUGH_M:
                    verdict[i] = 2
