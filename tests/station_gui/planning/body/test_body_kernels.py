"""The car's rectangle against brute force."""

import math

import numpy as np
import pytest
from scipy import ndimage

from shared.geometry.se2 import Pose2
from station_gui.planning.body import _kernels

CELL_M = 0.02
FRAME = np.array([-1.0, -2.0, CELL_M])
CAR = np.array([0.045, 0.305, 0.10, 0.05, 0.15])


def _field(blocked: np.ndarray) -> np.ndarray:
    return np.maximum(ndimage.distance_transform_edt(~blocked) - 0.5, 0.0) * CELL_M


def _twin(blocked: np.ndarray, pose: np.ndarray) -> float:
    """From the rectangle to the nearest blocked cell's middle, less half a cell."""
    rows, columns = np.nonzero(blocked)
    centres = np.column_stack((columns + 0.5, rows + 0.5)) * CELL_M + FRAME[:2]
    at = Pose2.from_array(pose).inverse().apply(centres)
    dx = np.maximum(np.maximum(-CAR[0] - at[:, 0], at[:, 0] - CAR[1]), 0.0)
    dy = np.maximum(np.abs(at[:, 1]) - CAR[2], 0.0)
    return float(np.hypot(dx, dy).min()) - CELL_M / 2


def test_the_clearance_is_that_of_the_true_rectangle() -> None:
    generator = np.random.default_rng(1)
    blocked = np.zeros((150, 150), bool)
    blocked[tuple(generator.integers(0, 150, (2, 25)))] = True
    field = _field(blocked)
    for _ in range(400):
        pose = generator.uniform((-0.5, -1.5, -math.pi), (1.5, 0.5, math.pi))
        clear, true = _kernels.body_clearance(field, FRAME, CAR, *pose), _twin(blocked, pose)
        assert clear == pytest.approx(min(max(true, 0.0), 0.2), abs=0.016)


def test_a_thin_leg_under_the_middle_of_the_car_is_not_missed() -> None:
    blocked = np.zeros((100, 100), bool)
    blocked[50, 50] = True
    for along in np.linspace(-0.03, 0.29, 20):
        x, y = FRAME[0] + 50.5 * CELL_M - along, FRAME[1] + 50.5 * CELL_M
        assert _kernels.body_clearance(_field(blocked), FRAME, CAR, x, y, 0.0) == 0.0


def test_beyond_the_map_nothing_is_clear() -> None:
    assert _kernels.clearance_at(np.ones((10, 10)), np.array([0.0, 0.0, 0.1]), -0.3, 0.5) == 0.0
