"""Each kernel against a plain numpy twin."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from robot_app.control import _kernels
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2

CELL_M = 0.05


def test_the_distance_field_is_that_of_scipy() -> None:
    points = np.random.default_rng(1).uniform(0.0, 2.0, (15, 2))
    field = np.empty((40, 40))
    _kernels.distance_field(points, 0.0, 0.0, CELL_M, 5.0, field)
    free = np.ones((40, 40), bool)
    free[tuple((points[:, ::-1] / CELL_M).astype(int).T)] = False
    np.testing.assert_allclose(field, CELL_M * ndimage.distance_transform_edt(free), atol=1e-9)


def test_the_field_is_flat_and_far_where_there_is_nothing() -> None:
    field = np.empty((20, 20))
    _kernels.distance_field(np.zeros((0, 2)), 0.0, 0.0, CELL_M, 3.0, field)
    np.testing.assert_allclose(field, 3.0)


def test_the_field_between_cells_is_that_of_scipy() -> None:
    field = np.random.default_rng(2).uniform(0.0, 1.0, (30, 30))
    for x, y in np.random.default_rng(3).uniform(0.1, 1.4, (20, 2)):
        twin = ndimage.map_coordinates(field, [[y / CELL_M - 0.5], [x / CELL_M - 0.5]], order=1)[0]
        assert _kernels.sample_field(field, 0.0, 0.0, CELL_M, x, y) == pytest.approx(twin)


def _sweep(points: NDArray[np.float64], steering: float, forward: bool, car: CarGeometry) -> tuple[float, float]:
    margins = np.full(len(points), 0.03)
    half = car.width_m / 2
    return _kernels.sweep(
        points, margins, np.zeros(3), steering, steering, 12.0, 1.0 if forward else -1.0, car.wheelbase_m,
        car.front_m, car.rear_m, half, 0.02, 1.0, np.empty(4),
    )  # fmt: skip


def _swept(points: NDArray[np.float64], steering: float, forward: bool, car: CarGeometry) -> float:
    """How far the car gets, from exact poses on the circle."""
    for step in range(1, 51):
        way = (0.02 if forward else -0.02) * step
        turn = way * car.curvature_per_m(steering)
        chord = way * float(np.sinc(turn / math.tau))
        at = Pose2(chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn).inverse().apply(points)
        dx = np.maximum(np.maximum(at[:, 0] - car.front_m, -car.rear_m - at[:, 0]), 0)
        dy = np.maximum(np.abs(at[:, 1]) - car.width_m / 2, 0)
        if (np.hypot(dx, dy) < 0.03).any():
            return (step - 1) * 0.02
    return 1.0


@pytest.mark.parametrize("forward", [True, False])
@pytest.mark.parametrize("steering", [-0.5, -0.2, 0.0, 0.4])
def test_the_swept_ground_is_that_of_exact_poses(steering: float, forward: bool, car: CarGeometry) -> None:
    generator = np.random.default_rng(7)
    for _ in range(10):
        points = generator.uniform(-1.2, 1.2, (6, 2))
        points = points[(np.abs(points[:, 1]) > 0.15) | (points[:, 0] > 0.4) | (points[:, 0] < -0.15)]
        free, _ = _sweep(points, steering, forward, car)
        assert free == pytest.approx(_swept(points, steering, forward, car), abs=0.021)


def test_a_wall_ahead_ends_the_way_at_the_margin(car: CarGeometry) -> None:
    wall = np.column_stack((np.full(9, 0.8), np.linspace(-0.2, 0.2, 9)))
    free, clearance = _sweep(wall, 0.0, True, car)
    assert 0.8 - 0.305 - 0.03 - 0.021 < free <= 0.8 - 0.305 - 0.03 + 1e-9
    assert clearance >= 0.03


def test_a_disc_rolls_round_an_outer_corner_at_its_radius() -> None:
    corner = np.array([[x, 0.5] for x in np.arange(0.5, 2.5, 0.02)] + [[2.48, y] for y in np.arange(-1.5, 0.5, 0.02)])
    field = np.empty((120, 120))
    _kernels.distance_field(corner, 0.0, -1.8, 0.03, 3.0, field)
    way = np.empty((60, 2))
    count = _kernels.roll_along(field, 0.0, -1.8, 0.03, np.array([1.2, 0.8]), -1.0, 0.3, 0.3, 0.03, way)
    assert count == 60
    gaps = np.min(np.hypot(*(way[:, None] - corner[None]).transpose(2, 0, 1)), axis=1)
    np.testing.assert_allclose(gaps, 0.3, atol=0.05)
    assert way[-1, 0] > 2.6
