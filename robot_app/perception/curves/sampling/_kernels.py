"""Kernels that smooth and judge curves and choose sample nodes along them; arguments as in `tracing._kernels`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED, crowd_share, is_smooth

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

FEW_POINTS = 3
RIM_CELLS = 3.0  # how far in depth a point may lie from the surface that it is the rim of
DOUBT_CELLS = 4.0  # what is added for a curve of one point
MOST_LOOSE_CELLS = 3.0  # what is farther off in depth is no worse


@njit(nogil=True, cache=True, **UNCOUNTED)
def lay_out(point_m: F32, order: I32, start: I32, closed: U8, curves: int, cell_width: float, path_m: F32) -> None:
    """`path_m`: (E, 3) the points in the order of the curves, those that jump out and back again moved in between.

    So does a pixel on an edge that mixes what is near with what is far.
    """
    for curve in range(curves):
        first, size = start[curve], start[curve + 1] - start[curve]
        for k in range(size):
            p = order[first + k]
            for axis in range(3):
                path_m[first + k, axis] = point_m[p, axis]
            if size < 3 or (closed[curve] == 0 and (k == 0 or k == size - 1)):
                continue
            a, b = order[first + (k - 1) % size], order[first + (k + 1) % size]
            square = 0.0
            for axis in range(3):
                square += (point_m[p, axis] - 0.5 * (point_m[a, axis] + point_m[b, axis])) ** 2
            if square > (1.25 * cell_width * point_m[p, 2]) ** 2:
                for axis in range(3):
                    path_m[first + k, axis] = 0.5 * (point_m[a, axis] + point_m[b, axis])


@njit(nogil=True, cache=True, **UNCOUNTED)
def _mean(path_m: F32, first: int, size: int, low: int, high: int, axis: int) -> float:
    total = 0.0
    for k in range(low, high + 1):
        total += path_m[first + k % size, axis]
    return total / (high - low + 1)


@njit(nogil=True, cache=True, **UNCOUNTED)
def smooth(
    path_m: F32, start: I32, closed: U8, curves: int, arm: int, smooth_m: F32, corner_m: F32, score: F32, arc_m: F32
) -> None:
    """In the order of the curves, from the means of up to `arm` points before and after each:

    `smooth_m` (E, 3) the mean of all of them, `corner_m` (E, 3) where the two sides meet if they are straight,
    `score` (E,) how sharply: 1 at ends and right angles, 0 in the middle of a straight edge, and `arc_m` (E,) the
    length of the curve up to there.
    """
    for curve in range(curves):
        first, size = start[curve], start[curve + 1] - start[curve]
        for k in range(size):
            reach = arm if closed[curve] == 1 else min(arm, k, size - 1 - k)
            reach = min(reach, (size - 1) // 2)
            score[first + k] = 1.0
            if reach < 2:
                for axis in range(3):
                    corner_m[first + k, axis] = smooth_m[first + k, axis] = path_m[first + k, axis]
                if closed[curve] == 0 and 0 < k < size - 1:
                    score[first + k] = 0.25
                continue
            # Straight sides u and v from corner c: their means are c + (reach + 1) / 2 of each, that of the middle
            # three points is c + (u + v) / 3.
            back = 1.0 / (0.75 * (reach + 1) - 1.0)
            dot, square_a, square_b = 0.0, 0.0, 0.0
            for axis in range(3):
                before = _mean(path_m, first, size, k - reach, k - 1, axis)
                after = _mean(path_m, first, size, k + 1, k + reach, axis)
                middle = _mean(path_m, first, size, k - 1, k + 1, axis)
                smooth_m[first + k, axis] = (reach * (before + after) + path_m[first + k, axis]) / (2 * reach + 1)
                corner = middle - back * (0.5 * (before + after) - middle)
                corner_m[first + k, axis] = corner
                dot += (before - corner) * (after - corner)
                square_a += (before - corner) ** 2
                square_b += (after - corner) ** 2
            norm = math.sqrt(square_a * square_b)
            score[first + k] = min(1.0, 1.0 + dot / norm) if norm > 0.0 else 1.0
        arc = 0.0
        for k in range(size):
            if k > 0:
                square = 0.0
                for axis in range(3):
                    square += (smooth_m[first + k, axis] - smooth_m[first + k - 1, axis]) ** 2
                arc += math.sqrt(square)
            arc_m[first + k] = arc


@njit(nogil=True, cache=True, **UNCOUNTED)
def _extent_m(place_m: F32, first: int, last: int) -> float:
    """The diagonal of the box round places first to last."""
    square = 0.0
    for axis in range(3):
        low, high = place_m[first, axis], place_m[first, axis]
        for k in range(first + 1, last):
            low, high = min(low, place_m[k, axis]), max(high, place_m[k, axis])
        square += (high - low) ** 2
    return math.sqrt(square)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _apart_cells(point_uv: F32, a: int, b: int) -> float:
    du, dv = point_uv[a, 0] - point_uv[b, 0], point_uv[a, 1] - point_uv[b, 1]
    apart: float = math.sqrt(du * du + dv * dv)
    return apart


@njit(nogil=True, cache=True, **UNCOUNTED)
def looseness(point_m: F32, point_uv: F32, order: I32, first: int, last: int, cell_width: float) -> float:
    """How loosely the points of a curve hang together: by how many cells more than one they lie apart in the image, and
    by how many widths of a cell each is off in depth from the line between the two beside it. The means of both are
    added, and the more the fewer points they are of, for that may be chance.

    Along a straight edge the inverse depth is linear in the image, however steeply it runs into the depth: there the
    points lie far apart in space, but neither in the image nor off that line. Those of speckle do both.
    """
    before = _apart_cells(point_uv, order[first], order[first + 1])
    apart, off = before, 0.0
    for k in range(first + 1, last - 1):
        p = order[k]
        after = _apart_cells(point_uv, p, order[k + 1])
        apart += after
        q = (after / point_m[order[k - 1], 2] + before / point_m[order[k + 1], 2]) / (before + after)
        off += min(abs(q * point_m[p, 2] - 1.0) / cell_width, MOST_LOOSE_CELLS)
        before = after
    count = last - first
    loose: float = apart / (count - 1) - 1.0 + off / (count - 2) + DOUBT_CELLS / count
    return loose


@njit(nogil=True, cache=True, **UNCOUNTED)
def raggedness(point_uv: F32, order: I32, first: int, last: int) -> float:
    """How far the points of a curve lie from the line between those two before and two after, mean, in cells."""
    inner = last - first - 4
    if inner <= 0:
        return 0.0
    off = 0.0
    for k in range(first + 2, last - 2):
        a, p, b = order[k - 2], order[k], order[k + 2]
        du, dv = point_uv[b, 0] - point_uv[a, 0], point_uv[b, 1] - point_uv[a, 1]
        across = abs(du * (point_uv[p, 1] - point_uv[a, 1]) - dv * (point_uv[p, 0] - point_uv[a, 0]))
        off += min(across / max(math.sqrt(du * du + dv * dv), 0.5), MOST_LOOSE_CELLS)
    return off / inner


@njit(nogil=True, cache=True, **UNCOUNTED)
def _is_on_surface(inverse: F32, i: int, j: int, depth_m: float, cell_width: float, noise: float) -> bool:
    """Whether a point seen in cell (i, j) is on the rim of something smooth: that comes to it, and does not pass it."""
    for axis in range(4):
        di, dj = (axis == 2) * 1 - (axis == 3) * 1, (axis == 0) * 1 - (axis == 1) * 1
        if is_smooth(inverse, i + di, j + dj, di, dj, noise):
            rim = 2.0 * inverse[i + di, j + dj] - inverse[i + 2 * di, j + 2 * dj]
            if abs(rim * depth_m - 1.0) < RIM_CELLS * cell_width:
                return True
    return False


@njit(nogil=True, cache=True, **UNCOUNTED)
def is_on_surface(
    inverse: F32, point_m: F32, point_uv: F32, order: I32, first: int, last: int, cell_width: float, noise: float
) -> bool:
    """Whether at least half of a curve's points are on the rim of something smooth."""
    on = 0
    for k in range(first, last):
        p = order[k]
        on += _is_on_surface(inverse, int(point_uv[p, 1]), int(point_uv[p, 0]), point_m[p, 2], cell_width, noise)
    return 2 * on >= last - first


@njit(nogil=True, cache=True, **UNCOUNTED)
def _mean_share(crowd: I32, point_uv: F32, order: I32, first: int, last: int) -> float:
    """`crowd_share` along a curve."""
    share = 0.0
    for k in range(first, last):
        share += crowd_share(crowd, int(point_uv[order[k], 1]), int(point_uv[order[k], 0]))
    return share / (last - first)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _roughness(score: F32, first: int, last: int) -> float:
    """The mean `score` of a curve without its ends; 0 where it is too short to tell."""
    inner = last - first - 4
    if inner <= 2:
        return 0.0
    total = 0.0
    for k in range(first + 2, last - 2):
        total += score[k]
    return total / inner


@njit(nogil=True, cache=True, **UNCOUNTED)
def measure(
    smooth_m: F32,
    score: F32,
    order: I32,
    point_m: F32,
    point_uv: F32,
    start: I32,
    curves: int,
    crowd: I32,
    quiet_share: float,
    min_extent_m: float,
    min_cells: float,
    max_roughness: float,
    inverse: F32,
    noise: float,
    max_looseness: float,
    loose_range_m: float,
    max_raggedness: float,
    cell_width: float,
    detail_extent_m: float,
    max_detail: float,
    extent_m: F32,
    detail: F32,
) -> None:
    """`extent_m`: (K,) the diagonal of the box round each curve; 0 for those that are noise.

    `crowd`: as `count_crowd` fills it; where it is denser than `quiet_share`, curves must be better in proportion.
    Curves of more than `max_looseness` are noise beyond `loose_range_m`, and those of which it and their raggedness are
    more than `max_raggedness` if they are on no surface's rim.
    `inverse`: (R, C) as `mark_floor` fills it; `noise`: its, 1/m.

    `detail`: (K,) 1 for curves of `detail_extent_m` and more; smaller ones are drawn finer in proportion.
    """
    for curve in range(curves):
        first, last = start[curve], start[curve + 1]
        extent = 0.0 if last - first < FEW_POINTS else _extent_m(smooth_m, first, last)
        range_m = smooth_m[(first + last) // 2, 2]
        if extent < max(min_extent_m, min_cells * cell_width * range_m):
            extent = 0.0
        else:
            crowding = max(1.0, _mean_share(crowd, point_uv, order, first, last) / quiet_share)
            loose = looseness(point_m, point_uv, order, first, last, cell_width)
            rough = _roughness(score, first, last) * crowding > max_roughness
            far_and_loose = range_m > loose_range_m and loose > max_looseness
            ragged = (loose + raggedness(point_uv, order, first, last)) * crowding > max_raggedness
            if (
                rough
                or far_and_loose
                or (ragged and not is_on_surface(inverse, point_m, point_uv, order, first, last, cell_width, noise))
            ):
                extent = 0.0
        extent_m[curve] = extent
        detail[curve] = min(max(1.0, detail_extent_m / max(extent, 1e-3)), max_detail)


@njit(nogil=True, cache=True, **UNCOUNTED)
def choose_samples(
    corner_m: F32,
    smooth_m: F32,
    score: F32,
    arc_m: F32,
    start: I32,
    closed: U8,
    curves: int,
    extent_m: F32,
    detail: F32,
    full_extent_m: float,
    corner_gain: float,
    spacing_m: float,
    limit: int,
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
) -> int:
    """The sample nodes A: ends, corners and points at equal distances along the curves; returns how many.

    A corner is the highest score within three points of it. The samples of small curves lie closer, by their `detail`,
    and so do the nodes that are learned from them.
    """
    wanted = 0.0
    for curve in range(curves):
        if extent_m[curve] > 0.0:
            wanted += 3.0 + arc_m[start[curve + 1] - 1] * detail[curve] / spacing_m
    spacing_m = spacing_m * max(1.0, wanted / (0.9 * limit))
    count = 0
    for curve in range(curves):
        if extent_m[curve] == 0.0:
            continue
        first, size = start[curve], start[curve + 1] - start[curve]
        share = min(1.0, extent_m[curve] / full_extent_m)
        size_weight = max(share * share * share, 0.02)
        last_arc = -1e9
        for k in range(size):
            here = score[first + k]
            corner = here > 0.3
            if corner:
                for step in range(-3, 4):
                    other = k + step
                    if closed[curve] == 1:
                        other %= size
                    elif other < 0 or other >= size:
                        continue
                    if score[first + other] > here or (step < 0 and score[first + other] == here):
                        corner = False
            end = closed[curve] == 0 and (k == 0 or k == size - 1)
            if not corner and not end and arc_m[first + k] - last_arc < spacing_m / detail[curve]:
                continue
            if count >= limit:
                return count
            last_arc = arc_m[first + k]
            for axis in range(3):
                sample_m[count, axis] = corner_m[first + k, axis] if corner or end else smooth_m[first + k, axis]
            if corner or end:
                sample_weight[count] = (1.0 + corner_gain * here) * size_weight
            else:
                sample_weight[count] = (1.0 + corner_gain * min(here, 0.2)) * size_weight
            sample_curve[count] = curve
            count += 1
    return count
