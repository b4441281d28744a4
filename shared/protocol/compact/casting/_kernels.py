"""Rays cast against the outlines that earlier scans left, in whole numbers.

Lengths are 1/16 mm, angles 2**-20 turns, sines 2**-20. A pose is x, y, angle. A sweep is `motion` (5,): forward speed
in mm/s, turn rate in angle units per second, ns between beams, first beam's angle and the step between beams, both
in 2**-12 angle units; the scanner sits `mount` (3,) on the robot.
A stored scan is (B, 4) int64: x, y, range (0 where nothing was measured), count of scans that it is the mean of.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]

TURN_MASK = (1 << 20) - 1


@njit(nogil=True, cache=True)
def sine(angle: int, table: Ints) -> int:
    """Of any angle, in 2**-20; `table` is `tables.SINE`."""
    angle &= 1048575
    quarter = angle >> 18
    rest = angle & 262143
    if quarter & 1:
        rest = 262144 - rest
    at = rest >> 6
    part = rest & 63
    value: int = (table[at] * (64 - part) + table[at + 1] * part + 32) >> 6
    return -value if quarter >= 2 else value


@njit(nogil=True, cache=True)
def bearing(x: int, y: int, table: Ints) -> int:
    """The angle of (x, y), 0 to 2**20 - 1; `table` is `tables.ATAN`."""
    ax = abs(x)
    ay = abs(y)
    if ax == 0 and ay == 0:
        return 0
    ratio = (ay << 18) // ax if ax >= ay else (ax << 18) // ay
    at = ratio >> 6
    part = ratio & 63
    angle: int = table[at]
    if at < 4096:
        angle += ((table[at + 1] - angle) * part) >> 6
    if ay > ax:
        angle = 262144 - angle
    if x < 0:
        angle = 524288 - angle
    if y < 0:
        angle = -angle
    return angle & 1048575


@njit(nogil=True, cache=True)
def aim(pose: Ints, motion: Ints, mount: Ints, sines: Ints, rays: Ints) -> None:
    """`rays`: (B, 4) out: where each beam starts and where it points (cosine, sine), as the robot moves on."""
    for i in range(rays.shape[0]):
        t_ns = i * motion[2]
        turned = motion[1] * t_ns // 1000000000
        way = motion[0] * 16 * t_ns // 1000000000
        along = pose[2] + (turned >> 1)
        heading = pose[2] + turned
        c = sine(heading + 262144, sines)
        s = sine(heading, sines)
        x = pose[0] + ((way * sine(along + 262144, sines)) >> 20)
        y = pose[1] + ((way * sine(along, sines)) >> 20)
        rays[i, 0] = x + ((mount[0] * c - mount[1] * s) >> 20)
        rays[i, 1] = y + ((mount[0] * s + mount[1] * c) >> 20)
        angle = heading + mount[2] + ((motion[3] + i * motion[4]) >> 12)
        rays[i, 2] = sine(angle + 262144, sines)
        rays[i, 3] = sine(angle, sines)


@njit(nogil=True, cache=True)
def place(ranges_mm: Ints, counts: Ints, rays: Ints, scan: Ints) -> None:
    """Store a scan of whole millimetres, 0 where nothing was measured."""
    for i in range(rays.shape[0]):
        r = ranges_mm[i] * 16
        scan[i, 0] = rays[i, 0] + ((r * rays[i, 2]) >> 20)
        scan[i, 1] = rays[i, 1] + ((r * rays[i, 3]) >> 20)
        scan[i, 2] = r
        scan[i, 3] = counts[i]


@njit(nogil=True, cache=True)
def cast(scan: Ints, rays: Ints, motion: Ints, atans: Ints, hits: Ints) -> None:
    """What the rays meet first of the outline through a stored scan's points.

    `hits`: (B, 4) out: range (0 when nothing), the count there, and the outline's direction (dx, dy).
    """
    beams = rays.shape[0]
    for i in range(beams):
        hits[i, 0] = 0
    middle = beams // 2
    mx = rays[middle, 0]
    my = rays[middle, 1]
    # angles relative to the middle ray, in beams of 1/256
    toward = bearing(rays[middle, 2], rays[middle, 3], atans)
    step = max(1, motion[4])
    last = -1
    last_index: int = 0
    for j in range(scan.shape[0]):
        if scan[j, 2] == 0:
            continue
        relative = (bearing(scan[j, 0] - mx, scan[j, 1] - my, atans) - toward) & 1048575
        if relative >= 524288:
            relative -= 1048576
        index: int = (relative << 20) // step + (middle << 8)
        if last >= 0 and j - last <= 2:
            dx = scan[j, 0] - scan[last, 0]
            dy = scan[j, 1] - scan[last, 1]
            limit = max(960, (min(scan[j, 2], scan[last, 2]) * 31) >> 8)
            if dx * dx + dy * dy < limit * limit and index > last_index - 51 and index - last_index < 3072:
                first = max(0, (last_index - 512) >> 8)
                final = min(beams - 1, (index + 767) >> 8)
                for i in range(first, final + 1):
                    ex = scan[last, 0] - rays[i, 0]
                    ey = scan[last, 1] - rays[i, 1]
                    if abs(ex) > 1048576 or abs(ey) > 1048576:
                        continue
                    c = rays[i, 2]
                    s = rays[i, 3]
                    den = c * dy - s * dx
                    along = ex * s - ey * c
                    t = ex * dy - ey * dx
                    if den < 0:
                        den = -den
                        along = -along
                        t = -t
                    if den < 1048576 or t <= 0:
                        continue
                    if along * 128 < -19 * den or along * 128 > 147 * den:
                        continue
                    r = (t << 20) // den
                    if r < 320:
                        continue
                    if hits[i, 0] == 0 or r < hits[i, 0]:
                        hits[i, 0] = r
                        hits[i, 1] = min(scan[j, 3], scan[last, 3])
                        hits[i, 2] = dx
                        hits[i, 3] = dy
        last = j
        last_index = index


@njit(nogil=True, cache=True)
def look(scans: Ints, rays: Ints, motion: Ints, atans: Ints, hits: Ints, views: Ints) -> None:
    """What a scan along `rays` is expected to measure.

    `scans` (K, B, 4), newest first; `views` (B, 8) out: range in mm and count of the newest scan that saw something
    there, the same of the next one, and how squarely the beam meets the first (1 to 5, 0 when unknown).
    """
    views[:, :] = 0
    for k in range(scans.shape[0]):
        cast(scans[k], rays, motion, atans, hits)
        for i in range(rays.shape[0]):
            if hits[i, 0] == 0:
                continue
            if views[i, 0] == 0:
                views[i, 0] = (hits[i, 0] + 8) >> 4
                views[i, 1] = hits[i, 1]
            elif views[i, 2] == 0:
                views[i, 2] = (hits[i, 0] + 8) >> 4
                views[i, 3] = hits[i, 1]
            if k == 0:
                across = abs(rays[i, 2] * hits[i, 3] - rays[i, 3] * hits[i, 2]) >> 20
                views[i, 4] = 1 + min(4, 5 * across // max(1, abs(hits[i, 2]), abs(hits[i, 3])))


@njit(nogil=True, cache=True)
def settle(decoded: Ints, step: int, most: int, settled: Ints, counts: Ints) -> None:
    """The ranges to remember: where the expected one was met, its mean with the new one, which has less noise."""
    for i in range(decoded.shape[0]):
        off = decoded[i, 0] - decoded[i, 1]
        settled[i] = decoded[i, 0]
        counts[i] = 1
        if decoded[i, 1] > 0 and abs(off) <= step:
            n = min(decoded[i, 2], most)
            settled[i] = decoded[i, 1] + off * max(160, 256 // (n + 1)) // 256
            counts[i] = min(n + 1, most)
