"""How far a scan is shifted against odometry, in the steps in which that is sent."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting

Triple = tuple[int, int, int]

UNIT = 80  # 5 mm, ahead and to the left
HEADING_UNIT = 320  # 1.9 mrad
LARGEST = 255


def rotated(x: int, y: int, angle: int) -> tuple[int, int]:
    c, s = int(casting.sine(angle + tables.TURN // 4, tables.SINE)), int(casting.sine(angle, tables.SINE))
    return (c * x - s * y) >> tables.SINE_BITS, (s * x + c * y) >> tables.SINE_BITS


def corrected(pose: Triple, correction: Triple) -> Triple:
    """The pose (1/16 mm, angle units) after a correction in its own frame."""
    x, y, heading = pose
    dx, dy = rotated(correction[0] * UNIT, correction[1] * UNIT, heading)
    return x + dx, y + dy, (heading + correction[2] * HEADING_UNIT) % tables.TURN


def quantised(shift: NDArray[np.float64], heading: int) -> Triple:
    """The correction nearest to a shift (3,) of a pose."""
    angle = heading / tables.TURN * math.tau
    c, s = math.cos(angle), math.sin(angle)
    ahead, aside = (c * shift[0] + s * shift[1]) / UNIT, (c * shift[1] - s * shift[0]) / UNIT
    return _within(ahead), _within(aside), _within(shift[2] / HEADING_UNIT)


def _within(value: float) -> int:
    return max(-LARGEST, min(LARGEST, round(value)))
