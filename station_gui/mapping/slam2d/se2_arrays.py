"""SE(2) on bare arrays (3,): for inner loops where a Pose2 per step would be too slow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def compose(a: FloatArray, b: FloatArray) -> FloatArray:
    """a @ b."""
    x, y, theta = float(a[0]), float(a[1]), float(a[2])
    c, s = math.cos(theta), math.sin(theta)
    bx, by = float(b[0]), float(b[1])
    return np.array([x + c * bx - s * by, y + s * bx + c * by, math.remainder(theta + float(b[2]), math.tau)])


def between(a: FloatArray, b: FloatArray) -> FloatArray:
    """inv(a) @ b: b as seen from a."""
    dx, dy, theta = float(b[0] - a[0]), float(b[1] - a[1]), float(a[2])
    c, s = math.cos(theta), math.sin(theta)
    return np.array([c * dx + s * dy, -s * dx + c * dy, math.remainder(float(b[2]) - theta, math.tau)])


def compose_all(a: FloatArray, b: FloatArray) -> FloatArray:
    """a @ b row by row: (N, 3) and (N, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    return np.column_stack(
        (
            a[:, 0] + c * b[:, 0] - s * b[:, 1],
            a[:, 1] + s * b[:, 0] + c * b[:, 1],
            np.remainder(a[:, 2] + b[:, 2] + math.pi, math.tau) - math.pi,
        )
    )


def between_all(a: FloatArray, b: FloatArray) -> FloatArray:
    """inv(a) @ b row by row: (N, 3) and (N, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    turn = np.remainder(b[:, 2] - a[:, 2] + math.pi, math.tau) - math.pi
    return np.column_stack((c * dx + s * dy, c * dy - s * dx, turn))


def rotate_information(information: FloatArray, theta_rad: float) -> FloatArray:
    """(3, 3) information about (x, y, theta) in a frame turned by `theta_rad` against the one it is given in."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ information @ turn.T)
