"""The car among boxes, against points laid over both."""

import math

import numpy as np

from shared.geometry.se2 import Pose2
from tools.evaluate.goals import _kernels

CAR = np.array([0.045, 0.305, 0.10])
BOXES = np.array([[1.0, 1.0, math.cos(0.4), math.sin(0.4), 0.3, 0.1], [2.2, 0.8, 1.0, 0.0, 0.02, 0.02]])
FAR_CELL_M = 0.02


def _far_m() -> np.ndarray:
    """0 everywhere in the room would hide nothing; here the true distance to the nearest box."""
    centres = (np.arange(100) + 0.5) * FAR_CELL_M
    x, y = np.meshgrid(np.append(centres, centres + 2.0), centres)
    far = np.full(x.shape, np.inf)
    for px, py, c, s, hx, hy in BOXES:
        along = np.maximum(np.abs(c * (x - px) + s * (y - py)) - hx, 0.0)
        aside = np.maximum(np.abs(-s * (x - px) + c * (y - py)) - hy, 0.0)
        far = np.minimum(far, np.hypot(along, aside))
    return far


def _touches(pose: np.ndarray, more_m: float = 0.0) -> bool:
    """Whether one of many points of the car, made larger on all sides, lies in a box."""
    u, v = np.meshgrid(np.linspace(-0.045 - more_m, 0.305 + more_m, 60), np.linspace(-0.1 - more_m, 0.1 + more_m, 36))
    body = Pose2.from_array(pose).apply(np.column_stack((u.ravel(), v.ravel())))
    for px, py, c, s, hx, hy in BOXES:
        local = (body - (px, py)) @ np.array([[c, -s], [s, c]])
        if (np.abs(local) < (hx, hy)).all(axis=1).any():
            return True
    return False


def test_a_free_pose_is_one_that_covers_no_point_of_a_box() -> None:
    generator, far = np.random.default_rng(1), _far_m()
    free = touching = 0
    for _ in range(400):
        pose = generator.uniform((0.3, 0.3, -math.pi), (3.0, 1.6, math.pi))
        found = _kernels.is_free(BOXES, CAR, far, FAR_CELL_M, *pose)
        if _touches(pose):
            touching += 1
            assert not found
        elif not _touches(pose, 0.01):  # points 6 mm apart miss corners: in between nothing is said
            free += 1
            assert found
    assert free > 50
    assert touching > 50


def test_beyond_the_room_nothing_is_free() -> None:
    assert not _kernels.is_free(BOXES, CAR, _far_m(), FAR_CELL_M, -0.5, 0.5, 0.0)
