import math

import numpy as np
import pytest

from shared.geometry.rays import cast_rays, point_to_segment_m, polygon_clearance_m, segments_gap_m

SQUARE = np.array([[0.0, 0, 2, 0], [2, 0, 2, 2], [2, 2, 0, 2], [0, 2, 0, 0]])


def _twin(x: float, y: float, direction: float, segments: np.ndarray, range_max: float) -> float:
    """Solve origin + t u = a + s (b - a) for each segment with numpy."""
    hits = []
    for x0, y0, x1, y1 in segments:
        matrix = np.array([[math.cos(direction), x0 - x1], [math.sin(direction), y0 - y1]])
        if abs(np.linalg.det(matrix)) > 1e-12:
            t, s = np.linalg.solve(matrix, [x0 - x, y0 - y])
            if t >= 0 and 0 <= s <= 1:
                hits.append(t)
    nearest = min(hits, default=math.inf)
    return nearest if nearest <= range_max else math.nan


def test_rays_hit_what_the_plain_solution_hits() -> None:
    generator = np.random.default_rng(1)
    segments = generator.uniform(-3, 3, (20, 4))
    directions = generator.uniform(-math.pi, math.pi, 50)
    ranges = np.empty(50)
    cast_rays(0.1, -0.2, directions, segments, 2.5, ranges)
    twin = [_twin(0.1, -0.2, d, segments, 2.5) for d in directions]
    np.testing.assert_allclose(ranges, twin, atol=1e-9)


def test_a_ray_in_a_square_room_ends_at_its_wall() -> None:
    ranges = np.empty(2)
    cast_rays(1.0, 1.0, np.array([0.0, math.pi / 4]), SQUARE, 4.0, ranges)
    np.testing.assert_allclose(ranges, [1.0, math.sqrt(2)])


def test_a_point_is_nearest_to_an_end_or_to_the_middle_of_a_segment() -> None:
    assert point_to_segment_m(1.0, 1.0, 0.0, 0.0, 2.0, 0.0) == pytest.approx(1.0)
    assert point_to_segment_m(3.0, 0.0, 0.0, 0.0, 2.0, 0.0) == pytest.approx(1.0)
    assert point_to_segment_m(0.0, 2.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(2.0)


def test_segments_that_cross_have_no_gap() -> None:
    assert segments_gap_m(np.array([0.0, 0, 2, 2]), np.array([0.0, 2, 2, 0])) == 0.0
    assert segments_gap_m(np.array([0.0, 0, 2, 0]), np.array([0.0, 0.3, 2, 0.5])) == pytest.approx(0.3)


def test_a_polygon_touched_from_inside_or_across_has_no_clearance() -> None:
    box = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert polygon_clearance_m(box, np.array([[0.4, 0.4, 0.6, 0.6]])) == 0.0
    assert polygon_clearance_m(box, np.array([[-1.0, 0.5, 2.0, 0.5]])) == 0.0
    assert polygon_clearance_m(box, np.array([[1.25, -1.0, 1.25, 2.0]])) == pytest.approx(0.25)
