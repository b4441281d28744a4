"""Step 1: which points are edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_app.drivers.base import DepthImage
from robot_app.perception import _kernels as kernels
from robot_app.perception.config import EdgeConfig
from robot_app.perception.curves import _kernels as bends
from robot_app.perception.point_cloud import EdgeCloud

UNIT_M = 0.00025
lengths = st.floats(0.001, 5.0)


def edge_measure_twin(left_m: float, right_m: float, alpha: float) -> float:
    """Equation 8 as it is printed."""
    return max(abs(left_m - right_m) - left_m * alpha, abs(left_m - right_m) - right_m * alpha)


def cloud_of(world, image: DepthImage) -> EdgeCloud:
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, world.mount)
    cloud.update(image)
    return cloud


def edges_of(cloud: EdgeCloud) -> np.ndarray:
    return cloud.edge_m[: cloud.edges]


@settings(deadline=None)
@given(lengths, lengths, st.floats(0.0, 10.0))
def test_the_edge_measure_is_equation_8(left_m: float, right_m: float, alpha: float) -> None:
    assert kernels.edge_measure(left_m, right_m, alpha) == pytest.approx(edge_measure_twin(left_m, right_m, alpha))


def test_distances_between_cells_are_those_of_their_points(world) -> None:
    rng = np.random.default_rng(1)
    z = rng.uniform(1.0, 2.0, (120, 160)).astype(np.float32)
    slope_x, slope_y = world.intrinsics.ray_slopes()
    a = np.array([slope_x[2 + 4 * 50], slope_y[2 + 4 * 30], 1.0]) * z[30, 50]
    b = np.array([slope_x[2 + 4 * 51], slope_y[2 + 4 * 30], 1.0]) * z[30, 51]
    assert kernels._between(z, slope_x, slope_y, 4, 30, 50, 30, 51) == pytest.approx(np.linalg.norm(a - b), rel=1e-5)


def test_the_decimated_image_keeps_what_is_in_range() -> None:
    depth = np.arange(64 * 64, dtype=np.uint16).reshape(64, 64)
    z = np.zeros((16, 16), np.float32)
    count = kernels.decimate(depth, 0.001, 4, 0.5, 3.0, z)
    twin = depth[2::4, 2::4] * 0.001
    twin[(twin < 0.5) | (twin > 3.0)] = 0.0
    assert count == np.count_nonzero(twin)
    np.testing.assert_allclose(z, twin, atol=1e-6)


def test_a_wall_that_fills_the_view_has_no_edges(world) -> None:
    depth = np.full((480, 640), round(1.0 / UNIT_M), np.uint16)
    noise = np.random.default_rng(1).integers(-8, 9, depth.shape)
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, (depth + noise).astype(np.uint16), UNIT_M))
    assert cloud.points == 19200
    assert cloud.edges == 0


def test_a_slanted_wall_has_no_edges(world) -> None:
    slope_x, _ = world.intrinsics.ray_slopes()
    depth_m = np.broadcast_to(2.0 / (1.0 - 1.2 * slope_x), (480, 640))
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    assert cloud.edges == 0


def test_an_occluding_edge_belongs_to_the_near_surface(world) -> None:
    depth_m = np.full((480, 640), 3.0)
    depth_m[:, :301] = 1.0
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    columns = edges[:, 0] / edges[:, 2] * world.intrinsics.fx + world.intrinsics.cx
    assert len(edges) >= 118
    assert np.abs(edges[:, 2] - 1.0).max() < 0.001
    np.testing.assert_allclose(columns, 300.5, atol=0.1)


def test_flying_pixels_and_the_shadow_beside_an_edge_are_no_edges(world) -> None:
    depth_m = np.full((480, 640), 3.0)
    depth_m[:, :300] = 1.0
    depth_m[:, 300:303] = (1.4, 1.9, 2.5)
    depth_m[:, 303:320] = 0.0
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    assert cloud.edges >= 118
    assert np.abs(edges_of(cloud)[:, 2] - 1.0).max() < 0.001


def test_a_hole_in_a_surface_is_no_edge(world) -> None:
    depth_m = np.full((480, 640), 2.0)
    depth_m[200:230, 300:340] = 0.0
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    assert cloud.edges == 0


def test_the_top_of_a_wall_against_open_space_is_an_edge_and_the_image_border_is_not(world) -> None:
    depth_m = np.full((480, 640), 2.0)
    depth_m[:100] = 0.0
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    rows = edges[:, 1] / edges[:, 2] * world.intrinsics.fy + world.intrinsics.cy
    assert len(edges) > 150
    np.testing.assert_allclose(rows, 100.5, atol=0.1)


def test_something_too_near_to_be_measured_makes_no_edge_on_what_is_behind_it(world) -> None:
    depth_m = np.full((480, 640), 2.0)
    depth_m[:, :300] = 0.0
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    assert cloud.edges == 0


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
def test_two_walls_that_meet_make_a_crease_where_they_meet(world, noise_m: float) -> None:
    slope_x, _ = world.intrinsics.ray_slopes()
    depth_m = np.broadcast_to(np.minimum(2.0 / (1.0 + slope_x), 2.0 / (1.0 - 0.8 * slope_x)), (480, 640))
    depth_m = depth_m + np.random.default_rng(1).normal(0.0, noise_m, depth_m.shape) if noise_m else depth_m
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    assert len(edges) > 80
    assert np.median(np.abs(edges[:, 0])) < 0.01


@pytest.mark.parametrize("depth_m", [0.8, 1.5, 2.0])
def test_a_front_that_stands_four_centimetres_before_another_has_an_edge(world, depth_m: float) -> None:
    rng = np.random.default_rng(1)
    front_m = np.full((480, 640), depth_m + 0.04)
    front_m[:, :301] = depth_m
    noisy_m = front_m + rng.normal(0.0, 0.0025, front_m.shape)
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(noisy_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    columns = edges[:, 0] / edges[:, 2] * world.intrinsics.fx + world.intrinsics.cx
    assert len(edges) > 80
    assert np.abs(np.median(columns) - 300.5) < 3.0
    assert np.quantile(np.abs(edges[:, 2] - depth_m), 0.9) < 0.01


def test_a_face_of_five_cells_has_an_edge_on_either_side(world) -> None:
    slope_x, _ = world.intrinsics.ray_slopes()
    # A front, a side face turned by 90 degrees to it, and another front, all at 45 degrees to the camera.
    first, side, second = 1.0 / (1.0 + slope_x), 1.0 / (1.0 - slope_x), 1.09 / (1.0 + slope_x)
    depth_m = np.broadcast_to(np.where(slope_x < 0.0, first, np.minimum(side, second)), (480, 640))
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    columns = edges[:, 0] / edges[:, 2] * world.intrinsics.fx + world.intrinsics.cx
    inner = world.intrinsics.cx + world.intrinsics.fx * (0.09 / 2.09)
    for column in (world.intrinsics.cx, inner):
        assert np.count_nonzero(np.abs(columns - column) < 3.0) > 80


def test_what_is_round_has_no_crease(world) -> None:
    slope_x = world.intrinsics.ray_slopes()[0][None, :].repeat(480, 0)
    radius_m, middle_m = 0.06, 1.0
    square = slope_x**2 + 1.0
    inside = middle_m**2 - square * (middle_m**2 - radius_m**2)
    depth_m = np.where(inside > 0.0, (middle_m - np.sqrt(np.maximum(inside, 0.0))) / square, 0.0)
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, np.round(depth_m / UNIT_M).astype(np.uint16), UNIT_M))
    edges = edges_of(cloud)
    assert np.count_nonzero(np.abs(edges[:, 0]) < 0.4 * radius_m) == 0


def test_the_floor_alone_has_no_edges(world) -> None:
    cloud = cloud_of(world, world.image([], np.random.default_rng(1)))
    assert cloud.points > 5000
    assert cloud.edges == 0


def test_an_image_of_another_size_is_refused(world) -> None:
    cloud = EdgeCloud(EdgeConfig(), world.intrinsics, world.mount)
    with pytest.raises(ValueError, match="intrinsics say"):
        cloud.update(DepthImage(0.0, np.zeros((240, 320), np.uint16), UNIT_M))


def test_the_number_of_samples_is_bounded(world) -> None:
    noise = np.random.default_rng(1).integers(2000, 16000, (480 // 16, 640 // 16)).repeat(16, 0).repeat(16, 1)
    cloud = EdgeCloud(EdgeConfig(max_samples=50), world.intrinsics, FarFloor())
    cloud.update(DepthImage(0.0, noise.astype(np.uint16), UNIT_M))
    assert cloud.edges > 1000
    assert 25 < cloud.samples <= 50


class FarFloor:
    """A camera so high that no floor is in view."""

    def robot_from_optical(self) -> np.ndarray:
        return np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 100], [0, 0, 0, 1]], np.float64)


@pytest.mark.parametrize("step", [1, 40])
def test_cells_are_worth_a_look_where_a_pair_is_marked_and_four_cells_on_either_side_lie_on_a_line(step: int) -> None:
    rng = np.random.default_rng(3)
    faces = rng.uniform(0.3, 1.0, 120)[np.arange(1200) // step // 11]  # eleven cells wide
    flat = (faces + rng.normal(0, 0.01, 1200)).astype(np.float32)
    flat[rng.integers(0, 1200, 60)] = 0.0
    marks = rng.integers(0, 2, 1200).astype(np.uint8)
    worth = np.full(1200, 7, np.uint8)
    bends.keep_between_straight(flat, step, 0.02, 0.01, np.zeros(1200, np.float32), marks, worth)

    def straight(at: int, way: int) -> bool:
        cells = flat[[at + way * k for k in (1, 2, 3, 4)]].astype(float)
        rest = cells - np.polyval(np.polyfit(range(4), cells, 1), range(4))
        return bool(cells.min() > 0 and np.abs(rest).max() <= 0.02 + 0.01 * flat[at])

    expected = [
        4 * step <= at < 1200 - 4 * step
        and flat[at] > 0
        and bool(marks[at] | marks[at - step])
        and straight(at, -step)
        and straight(at, step)
        for at in range(1200)
    ]
    assert 10 < sum(expected) < 500
    assert worth.tolist() == [int(worth_it) for worth_it in expected]
