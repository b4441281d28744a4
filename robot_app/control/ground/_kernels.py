"""Kernels of the ground that the robot has seen.

`evidence` (N, N) int8: 0 was never seen, above 0 something stands there, below it is free. `tries` (N, N) uint8: how
often the scanner should have seen a cell and did not. Cell (i, j) is row i, column j; its lower left corner is at
(`low_m` + (j, i) * `cell_m`), odom frame, with the same `low_m` for both.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.geometry.field._kernels import to_distances

Floats = NDArray[np.float64]
Bytes = NDArray[np.int8]
Counts = NDArray[np.uint8]
Marks = NDArray[np.uint16]

_HIT, _MOST, _LEAST = 3, 12, -8


@njit(nogil=True, cache=True)
def take_scan(
    evidence: Bytes,
    low_m: float,
    cell_m: float,
    scanner: Floats,
    first_rad: float,
    step_rad: float,
    range_min_m: float,
    reach_m: float,
    slack_m: float,
    ranges_m: Floats,
) -> None:
    """A cell is free where both beams beside it went on beyond it by `slack_m`; a hit speaks for something.

    `scanner` (3,): its pose, odom frame. `ranges_m` (B,): NaN where nothing was measured, which tells nothing.
    """
    size = len(evidence)
    beams = len(ranges_m)
    x0, y0 = scanner[0], scanner[1]
    first_row = max(0, math.floor((y0 - reach_m - low_m) / cell_m))
    last_row = min(size, math.floor((y0 + reach_m - low_m) / cell_m) + 1)
    first_column = max(0, math.floor((x0 - reach_m - low_m) / cell_m))
    last_column = min(size, math.floor((x0 + reach_m - low_m) / cell_m) + 1)
    turn = 2.0 * math.pi
    for i in range(first_row, last_row):
        dy = low_m + (i + 0.5) * cell_m - y0
        for j in range(first_column, last_column):
            dx = low_m + (j + 0.5) * cell_m - x0
            squared = dx * dx + dy * dy
            if squared > reach_m * reach_m:
                continue
            angle = math.atan2(dy, dx) - scanner[2] - first_rad
            beam = int((angle - turn * math.floor(angle / turn)) / step_rad)
            if beam >= beams - 1:
                continue
            beyond = math.sqrt(squared) + slack_m
            if ranges_m[beam] > beyond and ranges_m[beam + 1] > beyond:
                value = evidence[i, j] - 1
                evidence[i, j] = max(value, _LEAST) if value != 0 else -1
    for b in range(beams):
        if not range_min_m <= ranges_m[b] <= reach_m:
            continue
        j = math.floor((x0 + ranges_m[b] * math.cos(scanner[2] + first_rad + b * step_rad) - low_m) / cell_m)
        i = math.floor((y0 + ranges_m[b] * math.sin(scanner[2] + first_rad + b * step_rad) - low_m) / cell_m)
        if 0 <= i < size and 0 <= j < size:
            value = evidence[i, j] + _HIT
            evidence[i, j] = min(value, _MOST) if value != 0 else 1


@njit(nogil=True, cache=True)
def stand_on(evidence: Bytes, low_m: float, cell_m: float, points_m: Floats) -> None:
    """The body is there, so nothing else is: `points_m` (M, 2), odom frame."""
    size = len(evidence)
    for k in range(len(points_m)):
        j = math.floor((points_m[k, 0] - low_m) / cell_m)
        i = math.floor((points_m[k, 1] - low_m) / cell_m)
        if 0 <= i < size and 0 <= j < size:
            evidence[i, j] = min(evidence[i, j], -1)


@njit(nogil=True, cache=True)
def _is_closed(evidence: Bytes, i: int, j: int) -> bool:
    """Whether something stands in the cell or beside it: the beams of a far wall leave cells out between them."""
    for row in range(i - 1, i + 2):
        for column in range(j - 1, j + 2):
            if evidence[row, column] > 0:
                return True
    return False


@njit(nogil=True, cache=True)
def _free_way_m(
    evidence: Bytes, low_m: float, cell_m: float, scanner: Floats, angle_rad: float, reach_m: float
) -> tuple[float, float]:
    """How far a beam gets by what is known, `angle_rad` from the scanner's heading, and where it first meets a cell
    that was never seen."""
    size = len(evidence)
    ux = math.cos(scanner[2] + angle_rad)
    uy = math.sin(scanner[2] + angle_rad)
    walked = 0.0
    unseen_m = reach_m
    while walked < reach_m:
        j = int((scanner[0] + walked * ux - low_m) / cell_m)
        i = int((scanner[1] + walked * uy - low_m) / cell_m)
        if i < 1 or j < 1 or i >= size - 1 or j >= size - 1 or evidence[i, j] > 0:
            break
        if evidence[i, j] == 0:
            if _is_closed(evidence, i, j):
                break
            unseen_m = min(unseen_m, walked)
        walked += cell_m
    return walked, unseen_m


@njit(nogil=True, cache=True)
def unseen_in_sight(
    evidence: Bytes,
    tries: Counts,
    most_tries: int,
    marks: Marks,
    mark: int,
    low_m: float,
    cell_m: float,
    scanner: Floats,
    first_rad: float,
    step_rad: float,
    beams: int,
    reach_m: float,
) -> int:
    """How many cells that were never seen a scan from `scanner` (3,) would show, as far as it is known what stands
    in between. Each counts once, by its `marks` (N, N). As in `take_scan` two beams side by side have to pass: one
    alone slips between the cells of a far wall, and all that lies behind it would count."""
    found = 0
    before_m = 0.0
    here_m, unseen_m = _free_way_m(evidence, low_m, cell_m, scanner, first_rad, reach_m)
    for b in range(beams):
        angle = first_rad + (b + 1) * step_rad
        after_m, unseen_after_m = 0.0, reach_m
        if b + 1 < beams:
            after_m, unseen_after_m = _free_way_m(evidence, low_m, cell_m, scanner, angle, reach_m)
        ux = math.cos(scanner[2] + first_rad + b * step_rad)
        uy = math.sin(scanner[2] + first_rad + b * step_rad)
        last_m = min(here_m, max(before_m, after_m))
        walked = unseen_m
        while walked < last_m:
            j = int((scanner[0] + walked * ux - low_m) / cell_m)
            i = int((scanner[1] + walked * uy - low_m) / cell_m)
            if evidence[i, j] == 0 and marks[i, j] != mark:
                marks[i, j] = mark
                if tries[i, j] < most_tries:
                    found += 1
            walked += cell_m
        before_m, here_m, unseen_m = here_m, after_m, unseen_after_m
    return found


@njit(nogil=True, cache=True)
def views(
    evidence: Bytes,
    tries: Counts,
    most_tries: int,
    marks: Marks,
    mark: int,
    low_m: float,
    cell_m: float,
    scanners: Floats,
    first_rad: float,
    step_rad: float,
    beams: int,
    reach_m: float,
    found: NDArray[np.int64],
) -> None:
    """`unseen_in_sight` from each of `scanners` (M, 3) into `found` (M,), with marks from `mark` on."""
    for k in range(len(scanners)):
        found[k] = unseen_in_sight(
            evidence,
            tries,
            most_tries,
            marks,
            mark + k,
            low_m,
            cell_m,
            scanners[k],
            first_rad,
            step_rad,
            beams,
            reach_m,
        )


@njit(nogil=True, cache=True)
def count_tries(evidence: Bytes, tries: Counts, marks: Marks, mark: int, box: NDArray[np.int64]) -> None:
    """What should have been seen, as `marks` say, and still was not, within rows and columns of `box` (4,)."""
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            if marks[i, j] == mark and evidence[i, j] == 0 and tries[i, j] < 255:
                tries[i, j] += 1


@njit(nogil=True, cache=True)
def room_for_body(
    evidence: Bytes, box: NDArray[np.int64], cell_m: float, margin_m: float, room_m: Floats, other_m: Floats
) -> None:
    """Write into `room_m` (rows and columns of `box`) how large a disc may stand at each cell: `margin_m` from what
    stands there, and not on ground that nobody has seen. `other_m`: room to work in, of the same shape."""
    rows, columns = room_m.shape
    far = float((rows + columns) ** 2)
    for i in range(rows):
        for j in range(columns):
            value = evidence[box[0] + i, box[2] + j]
            room_m[i, j] = 0.0 if value > 0 else far
            other_m[i, j] = 0.0 if value == 0 else far
    to_distances(room_m, cell_m)
    to_distances(other_m, cell_m)
    for i in range(rows):
        for j in range(columns):
            room_m[i, j] = min(room_m[i, j] - margin_m, other_m[i, j])
