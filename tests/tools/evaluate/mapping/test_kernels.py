from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tools.evaluate.mapping._kernels import nearest_surface, seen_by_camera

LENS = np.array([math.tan(math.radians(35)), math.tan(math.radians(25)), 0.5, 9.0])


def box(x: float, y: float, z: float, hx: float, hy: float, hz: float, yaw: float = 0.0) -> NDArray[np.float64]:
    return np.array([[x, y, z, hx, hy, hz, math.cos(yaw), math.sin(yaw)]])


def distance(points: NDArray[np.float64], boxes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    found, nearest = np.empty(len(points)), np.zeros(len(points), np.int64)
    nearest_surface(points, boxes, found, nearest)
    return found, nearest


def seen(points: list[tuple[float, float, float]], boxes: NDArray[np.float64], pitch: float = 0.0) -> list[bool]:
    found = np.zeros(len(points), np.bool_)
    cameras = np.array([[0.0, 0.0, 0.2, 0.0, pitch], [0.0, 0.0, 0.2, math.pi, pitch]])
    seen_by_camera(np.array(points), cameras, LENS, boxes, found)
    return [bool(one) for one in found]


def test_the_distance_to_a_turned_box_is_that_of_points_on_its_faces() -> None:
    rng = np.random.default_rng(1)
    boxes = box(1.0, -0.5, 0.4, 0.3, 0.2, 0.4, yaw=0.7)
    points = rng.uniform((0.0, -1.5, 0.0), (2.0, 0.5, 1.2), (200, 3))
    cube = rng.uniform(-1, 1, (60_000, 3))
    axis = rng.integers(3, size=len(cube))
    cube[np.arange(len(cube)), axis] = np.sign(cube[np.arange(len(cube)), axis])
    local = cube * (0.3, 0.2, 0.4)
    c, s = math.cos(0.7), math.sin(0.7)
    faces = np.column_stack((1.0 + c * local[:, 0] - s * local[:, 1], -0.5 + s * local[:, 0] + c * local[:, 1],
                             0.4 + local[:, 2]))  # fmt: skip
    by_hand = np.array([np.linalg.norm(faces - point, axis=1).min() for point in points])
    np.testing.assert_allclose(np.abs(distance(points, boxes)[0]), by_hand, atol=0.01)


def test_inside_is_negative_and_the_nearest_box_is_named() -> None:
    boxes = np.concatenate((box(0, 0, 0.5, 0.5, 0.5, 0.5), box(3, 0, 0.5, 0.5, 0.5, 0.5)))
    found, nearest = distance(np.array([[0.4, 0.0, 0.5], [2.0, 0.0, 0.5], [1.0, 0.0, 0.5]]), boxes)
    assert found.tolist() == pytest.approx([-0.1, 0.5, 0.5])
    assert nearest.tolist() == [0, 1, 0]


def test_a_box_hides_what_is_behind_it_and_nothing_else() -> None:
    boxes = box(1.0, 0.0, 0.2, 0.1, 0.1, 0.2)
    assert seen([(2.0, 0.0, 0.2), (2.0, 0.6, 0.2), (0.89, 0.0, 0.2), (2.0, 0.0, 0.9)], boxes) == [
        False,
        True,
        True,
        True,
    ]


def test_the_field_of_view_and_the_range_are_the_cameras() -> None:
    far = box(50.0, 0.0, 0.2, 0.1, 0.1, 0.2)
    inside, outside = math.radians(34.5), math.radians(35.5)
    across = [(math.cos(a), math.sin(a), 0.2) for a in (inside, outside)]
    up = [(1.0, 0.0, 0.2 + math.tan(math.radians(a))) for a in (24.5, 25.5, -24.5, -25.5)]
    ranges = [(0.49, 0.0, 0.2), (0.51, 0.0, 0.2), (8.9, 0.0, 0.2), (9.1, 0.0, 0.2), (-1.0, 0.0, 0.2)]
    assert seen([*across, *up, *ranges], far) == [True, False, True, False, True, False, False, True, True, False, True]


def test_a_camera_that_looks_down_sees_lower() -> None:
    far = box(50.0, 0.0, 0.2, 0.1, 0.1, 0.2)
    low, high = (1.0, 0.0, 0.2 - math.tan(math.radians(30))), (1.0, 0.0, 0.2 + math.tan(math.radians(20)))
    assert seen([low, high], far, pitch=math.radians(10)) == [True, False]
